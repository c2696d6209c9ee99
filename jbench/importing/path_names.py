"""Names of a run that its file lacks and its path has, as loggers name their folders."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from jbench.importing.request import parse_seed
from jbench.wording import in_prose

_SEED = re.compile(
    r"(?:^|[^a-z0-9])seed[_=-]?(?P<seed>\d+)(?![a-z0-9])|_s(?P<s>\d+)$", re.IGNORECASE
)
"""A seed within a name: seed3, hopper-seed_3, seed=3, and td3_s3 of Spinning Up."""

_CLEANRL = re.compile(r"(.+?)__(.+)__(\d+)__\d+")
"""Folder of a run of CleanRL: environment, script, seed, time."""

_NUMBERED = re.compile(r"(.+)_(\d+)")
"""Folder of a run of RL Baselines3 Zoo: environment, number of the run."""

_CLASS_OF_SB3 = re.compile(
    r"(A2C|ARS|CrossQ|DDPG|DQN|MaskablePPO|PPO|QRDQN|RecurrentPPO|SAC|TD3|TQC|TRPO)_(\d+)"
)
"""Folder of stable-baselines3 in the one of its argument `tensorboard_log`: class and number."""


class PathNames(NamedTuple):
    """The labels of a run in the path of its file.

    Attributes:
        digits: of the seed.
        has_seed: if not, the seed is the number of the run, or 0.
        is_task_of_path: if not, the file itself names the task.
    """

    path: Path
    task: str
    method: str
    digits: str
    has_seed: bool
    is_task_of_path: bool = True

    @property
    def seed(self) -> int:
        """The seed, for a file without one; a RequestError if the number is too large."""
        return parse_seed(self.digits, f"{self.path}: the seed is")


def without_seed(name: str) -> str:
    """Returns a name without the seed in it; empty if it has nothing else."""
    if name.isdecimal():
        return ""
    return _SEED.sub("", name).strip("_-=. ")


def _last_seed(names: Iterable[str]) -> str:
    """Returns the digits of the last seed in names; "" if there is none."""
    digits = ""
    for name in names:
        for match in _SEED.finditer(name):
            digits = match["seed"] or match["s"]

    return digits


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
    digits = _last_seed([*folders, path.stem])
    if digits:
        return PathNames(path, task, method, digits, has_seed=True)

    folder = path.resolve().parent.name
    if match := _CLASS_OF_SB3.fullmatch(folder):
        above = [label for label in labels[:-1] if label.lower() != match[1].lower()]
        task = above[-1] if above else "task"
        return PathNames(path, task, match[1], match[2], has_seed=False)

    if folder.isdecimal():
        return PathNames(path, task, method, folder, has_seed=True)

    if match := _NUMBERED.fullmatch(folder):
        return PathNames(path, match[1], method, match[2], has_seed=False)

    return PathNames(path, task, method, "0", has_seed=False)


def names_of_run(run: str, path: Path) -> PathNames:
    """Returns the labels in the name that a tracker shows of a run; the task may be the file's."""
    if match := _CLEANRL.fullmatch(run):
        return PathNames(path, match[1], match[2], match[3], has_seed=True)

    task = without_seed(path.stem) or "task"
    if match := _SEED.search(run):
        digits = match["seed"] or match["s"]
        return PathNames(path, task, without_seed(run) or "method", digits, has_seed=True)

    if match := _NUMBERED.fullmatch(run):
        return PathNames(path, task, match[1], match[2], has_seed=False)

    return PathNames(path, task, run, "0", has_seed=False)


def notes_on_names(named: Iterable[PathNames]) -> list[str]:
    """Returns what a reader has to know of labels that files lack: sentences by method and task."""
    by_labels: dict[tuple[str, str], list[PathNames]] = {}
    for names in named:
        by_labels.setdefault((names.method, names.task), []).append(names)

    return [_note_on(names) for names in by_labels.values()]


def _note_on(named: list[PathNames]) -> str:
    """Returns the sentence on the files of one method and task."""
    first = named[0]
    file = f"{first.path.resolve().parent.name}/{first.path.name}"
    labels = [f"method {first.method}"]
    if first.is_task_of_path:
        labels.append(f"task {first.task}")

    if len(named) == 1:
        labels.append(f"seed {first.seed}")
        return f"{file}: {in_prose(labels, 'and')} are those of its path."

    seeds = sorted({names.seed for names in named})
    if len(seeds) == 1:
        labels.append(f"seed {seeds[0]}")
    else:
        labels.append(f"seeds {', '.join(map(str, seeds))}")

    return f"{len(named)} files such as {file}: {in_prose(labels, 'and')} are those of their paths."
