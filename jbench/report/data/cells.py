"""Cells: the runs of a database that share all settings except seed and steps."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from jbench.names import ALGORITHMS, FULL, TASKS
from jbench.report.data.curves import BoolArray, Curve, FloatArray, IntArray
from jbench.report.data.returns import Returns
from jbench.report.formatting import display_name
from jbench.settings.alike import comparable
from jbench.settings.base import settings_hash
from jbench.settings.run import Run

SOLVED = 900
"""Episode return from which a task counts as solved (paper, Figure 9)."""

OURS = "ours"
"""Source of the runs in the reported results."""

IMPORTED = "imported, not verified"
"""Source of imported learning curves."""


@dataclass(frozen=True, eq=False)
class Cell:
    """One run per seed of a task, algorithm, representation and variant, for one kind of return.

    A point is a training episode or an evaluation. A seed that diverged counts with return 0, the
    minimum, at every point after its divergence, up to the end of the other seeds.

    Attributes:
        representation: `full`, or an encoder's kind and size, such as `dae12`.
        variant: hash of the settings without seed and steps.
        label: settings that distinguish the variant from others; may be empty.
        seeds: (seeds,) in ascending order.
        returns: (seeds, points) returns; NaN after a run's end, or if not finite.
        control_steps: (seeds, points) control steps at each point; NaN after the run's end.
        lengths: (seeds,) number of points of each run.
        steps: (seeds,) control steps of training: as planned for finished runs, else up to the last
            episode.
        diverged: (seeds,) whether the run diverged.
        notes: notes for the reader, a clause each.
        robots: number of augmented robots in sequence; 0 for the plain robot.
        robot_episodes: episodes with each robot, in the longest run.
        processor_time: (seeds, points) processor time at each point in s; NaN if not recorded.
        variances: (seeds, points) variance of the mean return of each evaluation, estimated by the
            variance of its episodes over their number; NaN for training episodes, and if unknown.
        settings: settings of the run with the first seed.
        source: `OURS`, or the name of another source.
        words: the variant's name in legends, without defaults; see `variants.variant_words`.
        runs: (seeds,) ids of the runs.
    """

    kind: Returns
    task: str
    algo: str
    representation: str
    variant: str
    label: str
    seeds: IntArray
    returns: FloatArray
    control_steps: FloatArray
    lengths: IntArray
    steps: IntArray
    diverged: BoolArray
    notes: tuple[str, ...]
    robots: int
    robot_episodes: int
    processor_time: FloatArray
    variances: FloatArray
    settings: Run
    source: str = OURS
    words: str = ""
    runs: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the cell in notes."""
        return self.prefix + self.name_in_source

    @property
    def name_in_source(self) -> str:
        """Name of the cell in notes on one source."""
        return " ".join(filter(None, (self.task, self.algo, self.representation, self.label)))

    @property
    def key(self) -> tuple[str, str, str, str, str]:
        """Key that the cells of both kinds of return of the same runs share."""
        return self.task, self.algo, self.representation, self.variant, self.source

    @property
    def prefix(self) -> str:
        """Prefix of names for the source; empty for our runs."""
        return "" if self.source == OURS else f"{self.source}: "

    @property
    def representation_label(self) -> str:
        """The representation, and the settings that distinguish the variant."""
        return ", ".join(filter(None, (self.representation, self.label)))

    @property
    def representation_words(self) -> str:
        """The representation, and the variant's name in legends."""
        return ", ".join(filter(None, (self.representation, self.words)))

    @property
    def short_name(self) -> str:
        """Name within a task: `TD3`, `TD3, stable-baselines3`, `DDPG on dae12`."""
        return self.prefix + ", ".join(filter(None, (self.learner, self.words)))

    @property
    def learner(self) -> str:
        """Algorithm and encoding: `TD3`, `DDPG on dae12`."""
        algo = display_name(self.algo)
        return algo if self.representation == FULL else f"{algo} on {self.representation}"

    @property
    def columns(self) -> dict[str, str]:
        """The first columns of the numbers of a figure."""
        return {
            "task": self.task,
            "source": self.source,
            "algo": self.algo,
            "representation": self.representation_label,
            "returns": self.kind.name,
        }

    @property
    def tags(self) -> dict[str, str]:
        """What a page filters by."""
        return page_tags(self.algo, self.representation, self.source, self.task)

    @property
    def last_step(self) -> float:
        """The last control step that every seed has reached."""
        ends = self.control_steps[np.arange(len(self.lengths)), self.lengths - 1]
        return float(ends.min())

    @property
    def longest(self) -> float:
        """The last control step that any seed has reached."""
        return float(np.nanmax(self.control_steps))

    @property
    def trained(self) -> tuple[int, int]:
        """Smallest and largest number of control steps of training of the seeds."""
        return int(self.steps.min()), int(self.steps.max())

    @property
    def diverged_count(self) -> int:
        """Number of seeds that diverged."""
        return int(self.diverged.sum())

    def lengths_up_to(self, control_steps: float | None) -> IntArray:
        """Returns the number of points (seeds,) up to a control step; None: of all points."""
        if control_steps is None:
            return self.lengths
        points = np.arange(1, self.returns.shape[1] + 1)
        within = self.control_steps <= control_steps
        return np.asarray(np.max(np.where(within, points, 0), axis=1), np.int64)

    def same_but(self, other: "Cell", *names: str) -> bool:
        """Returns whether two cells differ only in these settings; see `alike.comparable`."""
        return comparable(self.settings, *names) == comparable(other.settings, *names)


def page_tags(
    algo: str, representation: str, source: str, task: str | None = None
) -> dict[str, str]:
    """Returns what a page filters series and rows by; those of several tasks have no task."""
    tags = {
        "algorithm": display_name(algo),
        "representation": representation,
        "source": source,
    }
    return tags if task is None else {"task": task, **tags}


def verified(cells: Iterable[Cell]) -> list[Cell]:
    """Returns the cells of runs, without imported curves."""
    return [cell for cell in cells if cell.source != IMPORTED]


def of_kind(cells: Iterable[Cell], kind: Returns) -> list[Cell]:
    """Returns the cells of one kind of return."""
    return [cell for cell in cells if cell.kind is kind]


def groups_same_but(cells: Iterable[Cell], name: str) -> list[list[Cell]]:
    """Returns groups of cells of one source that differ only in a setting; see `same_but`."""
    groups: dict[tuple[str, str], list[Cell]] = {}
    for cell in cells:
        groups.setdefault((cell.source, comparable(cell.settings, name)), []).append(cell)
    return list(groups.values())


def in_order(names: Iterable[str], known: tuple[str, ...]) -> list[str]:
    """Returns distinct names: the known ones in their order, then the others alphabetically."""
    return sorted(set(names), key=lambda name: _rank(name, known))


def _rank(name: str, known: tuple[str, ...]) -> tuple[int, str]:
    """Returns the sort key of a name in `in_order`."""
    return (known.index(name), "") if name in known else (len(known), name)


def file_name(*parts: str) -> str:
    """Returns a valid and unique file name that starts with these parts."""
    plain = "-".join(re.sub(r"[^A-Za-z0-9_.]", "_", part)[:60] for part in parts)
    if plain == "-".join(parts):
        return plain
    return f"{plain}-{settings_hash({'name': parts})}"


def paper_order(cell: Cell) -> tuple[Any, ...]:
    """Returns the sort key of a cell: task, algorithm and representation as in the paper."""
    # The sort is stable: variants stay in the order of their labels.
    return (
        _rank(cell.task, TASKS),
        _rank(cell.algo, ALGORITHMS),
        cell.representation != FULL,
        cell.representation,
        cell.source,
    )


class LearnedCurve(NamedTuple):
    """A cell and its learning curve."""

    cell: Cell
    curve: Curve
