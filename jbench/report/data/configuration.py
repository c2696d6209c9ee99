"""Configurations: the runs that share all settings except seed and steps, one run per seed."""

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np
import pandas as pd

from jbench.array_types import IntArray
from jbench.names import Order, ReturnsName
from jbench.report.data.common_steps import CommonPoints, SeedPoints, at_common_steps, distinct
from jbench.report.data.curves import Curve, SeedCurve, learning_curve, seed_curve
from jbench.report.data.points import Points
from jbench.report.data.scores import Scores
from jbench.report.data.source_names import FILE, OWN, has_solved_return
from jbench.report.request import WINDOW
from jbench.representation_names import kind_in, shown_representation
from jbench.returns import EVALUATION
from jbench.settings.algorithms import display_name
from jbench.settings.recorded import comparable
from jbench.studies.quantities import margin
from jbench.task_specs import return_range

SEQUENCE_WINDOW = 20  # episodes in a moving average, of one robot each (the authors' script)
KEY = ["task", "algo", "representation", "variant"]  # columns of runs that name a configuration
ID = (
    "configuration",
    "label",
    "source",
    "task",
    "algo",
    "representation",
    "kind",
    "words",
    "returns",
)
"""Columns of a frame that name a configuration and its kind of return."""


class Configuration:
    """The runs of a configuration, one per seed, and their points of one kind of return.

    A point is a training episode or an evaluation. A seed that diverged counts with the
    `diverged_return` at every point after its divergence, up to the end of the other seeds.

    Attributes:
        returns_name: which returns its points have, evaluation or training.
        returns, control_steps, processor_time, deviations, counts: (seeds, points); see `Points`.
        diverged_at: (seeds,) control steps after which each diverged; NaN if it did not.
        diverged_returns: (seeds,) return that each counts with from then on; see `diverged_return`.
        lengths: (seeds,) number of points of each run.
        last_step: last control step that every seed has reached.
        longest: last control step that any seed has reached.
        steps: (seeds,) control steps of training: as planned for finished runs, else up to the last
            episode.
        evaluate_every: (seeds,) control steps between evaluations; 0 if they are unknown.
        trained: control steps of the shortest run, up to its last evaluation. For training returns
            they are those of training: the same for agents that were trained equally long, wherever
            their last episodes ended.
        notes: a clause each.
        robots: number of augmented robots in sequence; 0 for the plain robot.
        robot_episodes: episodes with each robot, in the longest run.
        draws: number of different encoders of the runs.
        return_range: least and largest return of the task, or those that a reader chose to
            normalize by; None if they are unknown.
        has_solved_return: whether it is known from which return the task is solved.
        margin: difference of final returns within which two configurations are similar; 0 if
            nothing is, as for a file and for a task whose largest return is unknown.
        each_word: settings that its names have, such as `batch_size=64`.
        words: these settings, with commas.
        label: name within a task: `TD3 dae12, bfloat16`.
        name: unique name in its source: `face_direction TD3 dae12`.
        configuration: unique name in a report: `reference: face_direction TD3 dae12`.
        is_named_by_source: whether its names begin with the source.
        shown: name that a reader chose for the representation, or for a method of a file; or None.
        scores: what `analysis.scores.seed_scores` has computed, by its control step.
        beside: other methods on the task that may have been logged at other control steps, with
            whose means over the run those of this one are compared.
    """

    def __init__(
        self,
        returns_name: ReturnsName,
        runs: pd.DataFrame,
        points: Points,
        source: str,
        words: Sequence[str],
    ) -> None:
        """Collects what is known of runs.

        Args:
            runs: a row for each seed, in ascending order; see `build.build`.
            points: of the runs in the same order.
            words: settings that differ from the defaults, a word each; see
                `variants.variant_words`.
        """
        first = runs.iloc[0]
        self.returns_name = returns_name
        self.source = source
        self.task = str(first["task"])
        self.algo = str(first["algo"])
        self.representation = str(first["representation"])
        self.variant = str(first["variant"])
        self.is_named_by_source = source not in (OWN, FILE)
        self.notes: tuple[str, ...] = ()
        self.shown: str | None = None
        self.beside: Sequence[Configuration] = ()
        self.scores: dict[int | None, Scores] = {}

        self.returns = points.returns
        self.control_steps = points.control_steps
        self.processor_time = points.processor_time
        self.deviations = points.deviations
        self.counts = points.counts

        self.seeds = runs["seed"].to_numpy(np.int64)
        self.runs = tuple(runs["run"])
        self.diverged_at = runs["diverged"].to_numpy(float)
        self.diverged = np.isfinite(self.diverged_at)
        self.diverged_returns = runs["lowest"].to_numpy(float)
        self.finished = (runs["status"] == "finished").to_numpy()
        self.draws = runs["encoder"].nunique()
        self.settings = first["typed"]
        self.evaluate_every = [getattr(run, "evaluate_every", 0) for run in runs["typed"]]
        self.has_solved_return = has_solved_return([self.task], [source])
        self.return_range = None if source == FILE else return_range(self.task)
        self.margin = 0.0 if source == FILE else margin(self.task)

        self.lengths = self.lengths_up_to(np.inf)
        planned = runs["steps"].fillna(0).to_numpy(np.int64)
        ends = self.control_steps[np.arange(len(runs)), self.lengths - 1]
        self.last_step = float(ends.min())
        self.longest = float(np.nanmax(self.control_steps))
        self.steps = np.where(self.finished & (planned > 0), planned, ends).astype(np.int64)
        if self.diverged.any() and not self.diverged.all():
            longest = self.steps[~self.diverged].max()
            self.steps[self.diverged] = np.maximum(self.steps[self.diverged], longest)
        is_evaluated = returns_name == EVALUATION
        self.trained = int(self.last_step if is_evaluated else self.steps.min())

        self.robots = 0 if self.settings.augment is None else self.settings.robots
        episodes = max(int(planned.max()) // self.settings.episode_steps, self.returns.shape[1])
        self.robot_episodes = -(-episodes // self.robots) if self.robots else 0
        self.set_words(words)

    @property
    def named_by(self) -> str:
        """The column whose name a reader may choose."""
        return "algo" if self.source == FILE else "representation"

    def set_words(self, words: Sequence[str]) -> None:
        """Sets the names, with settings in words."""
        source = self.source
        self.each_word = tuple(words)
        self.words = ", ".join(words)
        algo = self.algo if source == FILE else display_name(self.algo)
        shown = shown_representation(self.representation)
        kind = kind_in(self.representation)
        if self.shown is not None and source == FILE:
            algo = self.shown
        elif self.shown is not None:
            shown = self.shown
            kind = self.shown

        label = ", ".join(filter(None, (f"{algo} {shown}".rstrip(), *words)))
        prefix = f"{source}: " if self.is_named_by_source else ""
        self.label = f"{prefix}{label}"
        self.name = f"{self.task} {label}"
        self.configuration = f"{prefix}{self.name}"
        # The columns `ID`.
        self.identity = {
            "configuration": self.configuration,
            "label": self.label,
            "source": source,
            "task": self.task,
            "algo": algo,
            "representation": shown,
            "kind": kind,
            "words": self.words,
            "returns": self.returns_name,
        }

    def lengths_up_to(self, control_steps: float) -> IntArray:
        """Returns the number of points (seeds,) up to a control step."""
        points = np.arange(1, self.returns.shape[1] + 1)
        within = self.control_steps <= control_steps
        return np.asarray(np.max(np.where(within, points, 0), axis=1), np.int64)

    @cached_property
    def points(self) -> list[SeedPoints]:
        """The finite returns of each seed; those at the same control step are one, their mean."""
        finite = np.isfinite(self.returns) & np.isfinite(self.control_steps)
        return [
            distinct(steps[row], values[row])
            for steps, values, row in zip(self.control_steps, self.returns, finite, strict=True)
        ]

    def points_up_to(self, control_steps: float) -> list[SeedPoints]:
        """Returns the finite returns of each seed up to a control step."""
        ends = [np.searchsorted(steps, control_steps, "right") for steps, _ in self.points]
        return [
            (steps[:end], returns[:end])
            for end, (steps, returns) in zip(ends, self.points, strict=True)
        ]

    @cached_property
    def common(self) -> CommonPoints:
        """The points of its seeds at control steps that all of them have reached."""
        return at_common_steps(
            self.returns_name, self.returns, self.control_steps, self.processor_time
        )

    def curve(self, order: Order = "quantile-first", window: int = WINDOW) -> Curve:
        """Returns the curve: a moving average of episodes, or the single evaluations.

        On a sequence of robots, the episodes of each robot are averaged separately: an average
        across the switch from one robot to the next would hide it.
        """
        common = self.common
        parts = [
            learning_curve(common.returns[:, robot], common.control_steps[robot], order, most)
            for robot, most in self._windows(len(common.control_steps), window)
        ]
        return Curve(
            order,
            parts[0].window,
            np.concatenate([part.control_steps for part in parts]),
            parts[0].seeds,
            np.concatenate([part.quantiles for part in parts], axis=1),
            np.concatenate([part.widths for part in parts]),
            [self._seed_curve(row, window) for row in range(len(self.seeds))],
        )

    def _seed_curve(self, row: int, window: int) -> SeedCurve:
        """Returns the curve of one seed, averaged for each robot separately."""
        logged = np.isfinite(self.control_steps[row])
        returns = self.returns[row, logged]
        control_steps = self.control_steps[row, logged]
        parts = [
            seed_curve(returns[robot], control_steps[robot], most)
            for robot, most in self._windows(len(returns), window)
        ]
        return SeedCurve(
            np.concatenate([part.control_steps for part in parts]),
            np.concatenate([part.values for part in parts]),
            np.concatenate([part.widths for part in parts]),
            parts[0].window,
        )

    def _windows(self, points: int, window: int) -> list[tuple[slice, int]]:
        """Returns the points of each robot of a sequence, and how many are averaged at most."""
        if self.returns_name == EVALUATION:
            return [(slice(points), 1)]
        if self.robots <= 1 or not points:
            return [(slice(points), window)]
        width = self.robot_episodes
        starts = range(0, points, width)
        return [(slice(start, start + width), SEQUENCE_WINDOW) for start in starts]


Configurations = Sequence[Configuration]
Curves = Sequence[tuple[Configuration, Curve]]


def with_returns(configurations: Iterable[Configuration], name: ReturnsName) -> list[Configuration]:
    """Returns the configurations of one kind of return."""
    return [config for config in configurations if config.returns_name == name]


def differing_in(configurations: Iterable[Configuration], name: str) -> list[list[Configuration]]:
    """Returns groups of one source, of the plain robot, that differ only by a setting's effects."""
    groups: dict[tuple[str, str], list[Configuration]] = {}
    for config in configurations:
        if not config.robots:
            key = config.source, comparable(config.settings, name)
            groups.setdefault(key, []).append(config)
    return [group for group in groups.values() if len(group) > 1]
