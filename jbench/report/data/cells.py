"""Cells: the runs of a database that share all their settings but seed and steps."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from jbench.names import ALGORITHMS, FULL, TASKS
from jbench.report.data.curves import BoolArray, Curve, FloatArray, IntArray
from jbench.report.data.returns import Returns
from jbench.settings.alike import comparable
from jbench.settings.base import settings_hash
from jbench.settings.run import Run

SOLVED = 900
"""Episode return from which a task counts as solved (paper, Figure 9)."""

OURS = "ours"
"""The source of the runs of the results that are reported."""


@dataclass(frozen=True)
class Cell:
    """One run for each seed of a task, algorithm, representation and variant: one kind of return.

    A point is a training episode, or an evaluation. A seed that diverged counts with return 0, the
    least possible, in every point after its divergence, and reaches as far as the other seeds.

    Attributes:
        kind: of its returns.
        task: what was learned.
        algo: by which algorithm.
        representation: `full`, or an encoder's kind and size: `dae12`.
        variant: hash of the settings but seed and steps.
        label: the settings that set it apart from the other variants; empty where there are none.
        seeds: (seeds,) rising.
        returns: (seeds, points) returns; NaN past a run's end, or if not finite.
        control_steps: (seeds, points) of the run at each point; NaN past the run's end.
        lengths: (seeds,) points up to each run's end.
        steps: (seeds,) control steps that each seed was trained for: of a finished run those asked
            for, of others those of its episodes.
        diverged: (seeds,) whether the run diverged.
        notes: what a reader should know, a clause each.
        robots: augmented robots that were learned on in turn; 0 for the plain robot.
        robot_episodes: episodes with each of them, in the longest run.
        processor_time: (seeds, points) s of processor time at each point; NaN if not recorded.
        settings: of its runs, one seed's.
        source: whose runs they are: `OURS`, or another name.
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
    settings: Run
    source: str = OURS

    @property
    def name(self) -> str:
        """Names the cell for a reader."""
        name = f"{self.task} {self.algo} {self.representation} {self.label or self.variant}"
        return f"{self.prefix}{name}"

    @property
    def key(self) -> tuple[str, str, str, str, str]:
        """What the cells of both kinds of return of the same runs share, and no others."""
        return self.task, self.algo, self.representation, self.variant, self.source

    @property
    def prefix(self) -> str:
        """Whose runs they are, in front of a name; nothing for ours."""
        return "" if self.source == OURS else f"{self.source}: "

    @property
    def seen(self) -> str:
        """What its agents see, and the settings that set it apart from other variants."""
        return ", ".join(filter(None, (self.representation, self.label)))

    @property
    def last_step(self) -> float:
        """The last control step that every seed has a point at or after."""
        ends = self.control_steps[np.arange(len(self.lengths)), self.lengths - 1]
        return float(ends.min())

    def lengths_up_to(self, control_steps: float | None) -> IntArray:
        """Returns each seed's points up to a control step, or all of them, (seeds,)."""
        if control_steps is None:
            return self.lengths
        points = np.arange(1, self.returns.shape[1] + 1)
        within = self.control_steps <= control_steps
        return np.asarray(np.max(np.where(within, points, 0), axis=1), np.int64)

    def same_but(self, other: "Cell", *names: str) -> bool:
        """Returns whether two cells differ in nothing else than these settings.

        Seeds, steps and how often agents are evaluated are no difference; nor is what can't stay
        the same where a named setting does not, as the encoder of another representation.
        """
        mine, others = (comparable(cell.settings, *names) for cell in (self, other))
        return mine == others


def of_kind(cells: Iterable[Cell], kind: Returns) -> list[Cell]:
    """Returns the cells of one kind of return."""
    return [cell for cell in cells if cell.kind is kind]


def in_order(names: Iterable[str], known: tuple[str, ...]) -> list[str]:
    """Returns distinct names: the known ones in their order, then the others in the alphabet's."""
    distinct = set(names)
    return [name for name in known if name in distinct] + sorted(distinct - set(known))


def file_name(*parts: str) -> str:
    """Returns a file name that starts with these parts, whatever they hold."""
    plain = "-".join(re.sub(r"[^A-Za-z0-9_.]", "_", part)[:60] for part in parts)
    if plain == "-".join(parts):
        return plain
    return f"{plain}-{settings_hash({'name': parts})}"


def paper_order(cell: Cell) -> tuple[Any, ...]:
    """Returns what cells are sorted by: task, algorithm and representation as in the paper."""
    # Stable, so that variants stay in the order of their labels.
    return (
        (TASKS.index(cell.task), "") if cell.task in TASKS else (len(TASKS), cell.task),
        (ALGORITHMS.index(cell.algo), "")
        if cell.algo in ALGORITHMS
        else (len(ALGORITHMS), cell.algo),
        cell.representation != FULL,
        cell.representation,
        cell.source,
    )


class LearnedCurve(NamedTuple):
    """A cell and the curve that its runs give."""

    cell: Cell
    curve: Curve
