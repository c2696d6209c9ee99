"""Configurations: the runs that share all settings except seed and steps, one run per seed."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import (
    ALGORITHMS,
    EPISODE_STEPS,
    FULL,
    REPRESENTATION,
    TASKS,
    Order,
    ReturnsName,
    kind_in,
)
from jbench.report.data.curves import Curve, learning_curve
from jbench.report.data.returns import FILE, TRAINING, has_solved_return
from jbench.report.request import WINDOW
from jbench.settings.alike import comparable
from jbench.statistics import FloatArray, IntArray

OWN = "own"
"""Source of the runs in the reported results."""

IMPORTED = "imported"
"""Source of imported learning curves."""

SEQUENCE_WINDOW = 20
"""Episodes in a moving average, within each robot's episodes (the authors' script)."""

KEY = ["task", "algo", "representation", "variant"]
"""Columns of runs that name a configuration."""

ID = ("configuration", "label", "source", "task", "algo", "representation", "kind", "words")
"""Columns of a frame that name a configuration."""

_SIZE_OF_TASK = ("scaled", "planar", "planar-no-yaw", "planar-mirror", "heading", "raw")
"""Kinds whose number of latents follows from the task, so that names leave it out."""


class Configuration:
    """The runs of a configuration, and their points of one kind of return.

    A point is a training episode or an evaluation. A seed that diverged counts with return 0, the
    minimum, at every point after its divergence, up to the end of the other seeds.

    Attributes:
        kind: of return.
        representation: `full`, or an encoder's kind and size, such as `dae12`.
        variant: hash of the settings without seed and steps.
        seeds: (seeds,) in ascending order.
        returns: (seeds, points) returns; NaN after a run's end, or if not finite.
        control_steps: (seeds, points) control steps at each point; NaN after the run's end.
        processor_time: (seeds, points) processor time at each point in s; NaN if not recorded.
        deviations: (seeds, points) standard deviation of the episodes of each evaluation; NaN for
            training episodes, and if unknown.
        counts: (seeds, points) number of episodes of each evaluation; 1 for training episodes.
        lengths: (seeds,) number of points of each run.
        last_step: last control step that every seed has reached.
        longest: last control step that any seed has reached.
        steps: (seeds,) control steps of training: as planned for finished runs, else up to the last
            episode.
        diverged: (seeds,) whether the run diverged.
        finished: (seeds,) whether the run is finished.
        notes: notes for the reader, a clause each.
        robots: number of augmented robots in sequence; 0 for the plain robot.
        robot_episodes: episodes with each robot, in the longest run.
        settings: settings of the run with the first seed.
        draws: number of different encoders of the runs.
        runs: (seeds,) ids of the runs.
        source: `OWN`, or the name of another source.
        words: settings that differ from the defaults; see `variants.variant_words`.
    """

    def __init__(
        self, kind: ReturnsName, runs: pd.DataFrame, points: Mapping[str, FloatArray]
    ) -> None:
        """Collects what is known of runs.

        Args:
            kind: of return.
            runs: a row for each seed; see `build.build`.
            points: (seeds, points) arrays by the names `points.FIELDS`.
        """
        first, self.kind = runs.iloc[0], kind
        self.task, self.algo, self.representation, self.variant = map(str, first[KEY])
        self.source, self.words = OWN, ""
        self.notes: tuple[str, ...] = ()
        self.returns, self.control_steps = points["returns"], points["control_steps"]
        self.processor_time = points["processor_time"]
        self.deviations, self.counts = points["deviations"], points["counts"]
        self.seeds, self.runs = runs["seed"].to_numpy(np.int64), tuple(runs["run"])
        self.diverged = runs["diverged"].notna().to_numpy()
        self.finished = (runs["status"] == "finished").to_numpy()
        self.draws, self.settings = runs["encoder"].nunique(), first["typed"]
        self.lengths = self.lengths_up_to(np.inf)
        planned = runs["steps"].fillna(0).to_numpy(np.int64)
        ends = self.control_steps[np.arange(len(runs)), self.lengths - 1]
        self.last_step, self.longest = float(ends.min()), float(np.nanmax(self.control_steps))
        self.steps = np.where(self.finished & (planned > 0), planned, ends).astype(np.int64)
        if self.diverged.any() and not self.diverged.all():
            longest = self.steps[~self.diverged].max()
            self.steps[self.diverged] = np.maximum(self.steps[self.diverged], longest)
        self.robots = 0 if self.settings.augment is None else self.settings.robots
        episodes = max(int(planned.max()) // EPISODE_STEPS, self.returns.shape[1])
        self.robot_episodes = -(-episodes // self.robots) if self.robots else 0

    @property
    def key(self) -> tuple[str, str, str, str, str]:
        """Key that both kinds of return of the same runs share."""
        return self.task, self.algo, self.representation, self.variant, self.source

    @property
    def label(self) -> str:
        """Name within a task: `TD3 dae12, bfloat16`."""
        return self._prefix + self._label_in_source

    @property
    def name(self) -> str:
        """Unique name in its source: `face_direction TD3 dae12`."""
        return f"{self.task} {self._label_in_source}"

    @property
    def configuration(self) -> str:
        """Unique name in a report: `reference: face_direction TD3 dae12`."""
        return self._prefix + self.name

    @property
    def _label_in_source(self) -> str:
        name = f"{self._shown_algo} {shown_representation(self.representation)}"
        return ", ".join(filter(None, (name.rstrip(), self.words)))

    @property
    def _prefix(self) -> str:
        return "" if self.source in (OWN, FILE) else f"{self.source}: "

    @property
    def _shown_algo(self) -> str:
        return self.algo if self.source == FILE else display_name(self.algo)

    @property
    def has_solved_return(self) -> bool:
        """Whether `SOLVED` counts; what solves tasks of other robots is unknown."""
        return has_solved_return([self.task], [self.source])

    @property
    def identity(self) -> dict[str, str]:
        """The columns `ID`."""
        shown = shown_representation(self.representation)
        words = self._shown_algo, shown, kind_in(self.representation), self.words
        values = self.configuration, self.label, self.source, self.task, *words
        return dict(zip(ID, values, strict=True))

    def lengths_up_to(self, control_steps: float) -> IntArray:
        """Returns the number of points (seeds,) up to a control step."""
        points = np.arange(1, self.returns.shape[1] + 1)
        within = self.control_steps <= control_steps
        return np.asarray(np.max(np.where(within, points, 0), axis=1), np.int64)

    def comparable(self, *names: str) -> tuple[str, str]:
        """Returns what configurations of a source share that differ only in these settings."""
        return self.source, comparable(self.settings, *names)

    def curve(self, order: Order = "quantile-first", window: int = WINDOW) -> Curve:
        """Returns the curve: a moving average of episodes, or the single evaluations.

        On a sequence of robots, the episodes of each robot are averaged separately: an average
        across the switch from one robot to the next would hide it.
        """
        smoothed = self.kind == TRAINING
        if not smoothed or self.robots <= 1:
            window = window if smoothed else 1
            return learning_curve(self.returns, self.control_steps, self.lengths, order, window)
        parts = []
        for first in range(0, self.returns.shape[1], self.robot_episodes):
            columns = slice(first, first + self.robot_episodes)
            returns, control_steps = self.returns[:, columns], self.control_steps[:, columns]
            lengths = np.clip(self.lengths - first, 0, returns.shape[1])
            parts.append(learning_curve(returns, control_steps, lengths, order, SEQUENCE_WINDOW))
        names = ("control_steps", "seeds", "quantiles", "each", "widths")
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in names
        }
        return replace(parts[0], **joined)


def display_name(algo: str) -> str:
    """Returns an algorithm's name as the paper writes it, or as its author does.

    The label `TD3` of a recorded or imported algorithm differs from that of jbench's td3.
    """
    if algo in ALGORITHMS:
        return algo.upper()
    return f"{algo} (label)" if algo in map(str.upper, ALGORITHMS) else algo


def shown_representation(representation: str) -> str:
    """Returns a representation's name, without the size where the task determines it."""
    match = REPRESENTATION.fullmatch(representation)
    if match is None or match["kind"] not in _SIZE_OF_TASK:
        return representation
    return "-".join(filter(None, match.group("kind", "scale", "rescale")))


def verified(configurations: Iterable[Configuration]) -> list[Configuration]:
    """Returns the configurations of runs, without imported curves."""
    return [one for one in configurations if one.source != IMPORTED]


def with_returns(configurations: Iterable[Configuration], kind: ReturnsName) -> list[Configuration]:
    """Returns the configurations of one kind of return."""
    return [one for one in configurations if one.kind == kind]


def differing_in(configurations: Iterable[Configuration], name: str) -> list[list[Configuration]]:
    """Returns groups on the plain robot that differ only in a setting, and the settings it implies.

    They have the same source, and two members or more.
    """
    groups: dict[tuple[str, str], list[Configuration]] = {}
    for one in configurations:
        if not one.robots:
            groups.setdefault(one.comparable(name), []).append(one)
    return [group for group in groups.values() if len(group) > 1]


def in_order(names: Iterable[str], known: tuple[str, ...] = TASKS) -> list[str]:
    """Returns distinct names: the known ones in their order, then the others alphabetically."""
    return sorted(set(names), key=lambda name: _rank(name, known))


def _rank(name: str, known: tuple[str, ...]) -> tuple[int, str]:
    return (known.index(name), "") if name in known else (len(known), name)


def paper_order(configuration: Configuration) -> tuple[Any, ...]:
    """Returns the sort key: task, algorithm and representation as in the paper."""
    # The sort is stable: variants stay in the order of their words.
    ranks = _rank(configuration.task, TASKS), _rank(configuration.algo, ALGORITHMS)
    representation = configuration.representation
    return *ranks, representation != FULL, representation, configuration.source


def make_names_unique(configurations: Sequence[Configuration]) -> None:
    """Adds a hash to the words of all but the first of the configurations with the same name.

    Names are made per source, where recorded settings may differ in nothing that has a name.
    """
    known: dict[str, str] = {}
    for one in configurations:
        if known.setdefault(one.configuration, one.variant) != one.variant:
            one.words = ", ".join(filter(None, (one.words, one.variant)))


def concatenated(parts: Sequence[pd.DataFrame], columns: Sequence[str]) -> pd.DataFrame:
    """Returns frames as one with these columns, which has no rows if they have none."""
    known = [part for part in parts if len(part)] or [pd.DataFrame(columns=[*columns])]
    return pd.concat(known, ignore_index=True).reindex(columns=[*columns])
