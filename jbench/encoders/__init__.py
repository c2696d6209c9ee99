"""Encoders: reduced-order representations of an observation, and their training."""

from jbench.encoders.find import encoder_code, find_draws, find_encoder
from jbench.encoders.load import LoadedEncoder, load_encoder, load_run_encoder
from jbench.encoders.saved import Encoder
from jbench.encoders.wrapper import action_signs, on_observations

__all__ = [
    "Encoder",
    "LoadedEncoder",
    "action_signs",
    "encoder_code",
    "find_draws",
    "find_encoder",
    "load_encoder",
    "load_run_encoder",
    "on_observations",
]
