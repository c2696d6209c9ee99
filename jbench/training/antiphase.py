"""Trains groups of seeds in antiphase: robots of one group step while a GPU updates another group.

A group is trained as if it were alone, so its results do not depend on the others.
"""

import contextlib
from collections import deque
from collections.abc import Generator, Sequence
from typing import TypeVar

import numpy as np
import torch

MIN_SEEDS = 20
"""With at least this many seeds there are two groups; smaller stacks use a GPU less well."""

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def number_of_groups(seeds: int, device: torch.device) -> int:
    """Returns in how many groups to train these seeds."""
    return 2 if device.type == "cuda" and seeds >= MIN_SEEDS else 1


def divided(items: Sequence[_Item], parts: int) -> list[list[_Item]]:
    """Returns consecutive items in at most this many parts of about the same number."""
    shares = np.array_split(np.arange(len(items)), min(parts, len(items)))
    return [[items[i] for i in share] for share in shares]


def take_turns(
    trainings: Sequence[Generator[None, None, _Result]], device: torch.device
) -> list[_Result]:
    """Resumes trainings in turn until all have ended.

    Args:
        trainings: each yields when it has begun updates that a GPU makes in the background.
        device: of all trainings. Each has its own stream on a GPU, so that the policy of one can
            act while others are updated.

    Returns:
        What the trainings returned.
    """
    results: dict[int, _Result] = {}
    with contextlib.ExitStack() as opened:
        turns = deque(range(len(trainings)))
        streams = [torch.cuda.Stream(device) for _ in turns] if device.type == "cuda" else None
        for training in trainings:
            opened.callback(training.close)
        while turns:
            index = turns.popleft()
            # torch.cuda.stream(None) would initialize CUDA, which takes memory of a GPU.
            with torch.cuda.stream(streams[index]) if streams else contextlib.nullcontext():
                try:
                    next(trainings[index])
                    turns.append(index)
                except StopIteration as end:
                    results[index] = end.value
    return [results[index] for index in range(len(trainings))]
