"""The roles of files with which a run resumes, as manifests name them."""

import re

CHECKPOINT = re.compile(r"checkpoint-(\d+)-(\d+)\.safetensors")
"""Of the state of a run, with its control steps and the row of its replay buffer."""


def checkpoint_role(control_steps: int, replay_row: int) -> str:
    """Returns the role of the state of a run."""
    return f"checkpoint-{control_steps:012d}-{replay_row:012d}.safetensors"
