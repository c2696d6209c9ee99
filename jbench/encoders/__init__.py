"""Reduced-order representations of an observation, and how they are trained."""

from jbench.encoders.saved import Encoder, find_encoder, load_encoder

__all__ = ["Encoder", "find_encoder", "load_encoder"]
