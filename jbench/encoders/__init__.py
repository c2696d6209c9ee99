"""Encoders: reduced-order representations of an observation, and their training."""

from jbench.encoders.saved import Encoder, find_draws, find_encoder, load_encoder
from jbench.encoders.wrapper import action_signs, on_observations

__all__ = [
    "Encoder",
    "action_signs",
    "find_draws",
    "find_encoder",
    "load_encoder",
    "on_observations",
]
