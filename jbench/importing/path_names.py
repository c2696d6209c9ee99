"""Names of a run that its file lacks and its path has, as loggers name their folders."""

import re
from pathlib import Path
from typing import NamedTuple

from jbench.importing.request import parse_seed

_SEED = re.compile(
    r"(?:^|[^a-z0-9])seed[_=-]?(?P<seed>\d+)(?![a-z0-9])|_s(?P<s>\d+)$", re.IGNORECASE
)
"""A seed within a name: seed3, hopper-seed_3, seed=3, and td3_s3 of Spinning Up."""

_CLEANRL = re.compile(r"(.+?)__(.+)__(\d+)__\d+")
"""Folder of a run of CleanRL: environment, script, seed, time."""

_NUMBERED = re.compile(r"(.+)_(\d+)")
"""Folder of a run of RL Baselines3 Zoo: environment, number of the run."""


class PathNames(NamedTuple):
    """The labels of a run in the path of its file."""

    path: Path
    task: str
    method: str
    digits: str  # of the seed
    has_seed: bool  # else the seed is the number of the run, or 0

    @property
    def seed(self) -> int:
        """The seed, for a file without one; a RequestError if the number is too large."""
        return parse_seed(self.digits, f"{self.path}: the seed is")


def without_seed(name: str) -> str:
    """Returns a name without the seed in it; empty if it has nothing else."""
    return "" if name.isdecimal() else _SEED.sub("", name).strip("_-=. ")


def names_in_path(path: Path) -> PathNames:
    """Returns the labels of a run by the folders of its file.

    The folder of a run is that of its task, and the folder above it that of its method. Folders
    that have the seed alone are neither.
    """
    folders = path.resolve().parent.parts[1:]
    for folder in folders:
        if match := _CLEANRL.fullmatch(folder):
            return PathNames(path, match[1], match[2], match[3], has_seed=True)

    labels = [label for label in map(without_seed, folders) if label]
    task = labels[-1] if labels else "task"
    method = labels[-2] if len(labels) > 1 else "method"
    found = [match for name in (*folders, path.stem) for match in _SEED.finditer(name)]
    if found:
        digits = found[-1]["seed"] or found[-1]["s"]
        return PathNames(path, task, method, digits, has_seed=True)

    folder = folders[-1] if folders else ""
    if folder.isdecimal():
        return PathNames(path, task, method, folder, has_seed=True)

    if match := _NUMBERED.fullmatch(folder):
        return PathNames(path, match[1], method, match[2], has_seed=False)

    return PathNames(path, task, method, "0", has_seed=False)
