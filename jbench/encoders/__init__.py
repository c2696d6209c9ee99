"""Encoders: reduced-order representations of an observation, and their training."""

from jbench.encoders.saved import Encoder, find_draws, find_encoder, load_encoder

__all__ = ["Encoder", "find_draws", "find_encoder", "load_encoder"]
