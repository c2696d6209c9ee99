"""What a run writes down: its episodes and evaluations, and when it commits them."""

import time
from collections.abc import Sequence
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
from pydantic import BaseModel, Field

from jbench.errors import WorkError
from jbench.settings.base import Settings
from jbench.store import Record, schema

_TABLES = {"episodes": schema.EPISODES, "evaluations": schema.EVALUATIONS}
_MOST_PARTS = 32  # of a table, before they are joined
_LARGEST_SHARE = 0.02  # of a run's time that its commits may take


class Position(BaseModel):
    """How far a run is.

    Attributes:
        control_steps: over all its environments.
        episodes: rows of training episodes.
        evaluations: how many were made.
        last_evaluation: control steps at the last one.
        wall_time: s that the run has taken, without the time between a kill and the resumption.
        processor_time: s of processor time that it has taken; None if it is not known, in
            checkpoints of an older version.
    """

    model_config = Settings.model_config

    control_steps: int = Field(default=0, ge=0)
    episodes: int = Field(default=0, ge=0)
    evaluations: int = Field(default=0, ge=0)
    last_evaluation: int = Field(default=0, ge=0)
    wall_time: float = Field(default=0.0, ge=0)
    processor_time: float | None = Field(default=None, ge=0)


class RunLog:
    """The rows of a run that wait for a commit, and how far it is."""

    def __init__(self, record: Record, position: Position | None = None) -> None:
        """Starts the run's clock.

        Args:
            record: of the run.
            position: from which it goes on; None for the beginning. Rows that were committed after
                it do not count any more: the next commit leaves them out.
        """
        self._record = record
        self._rows: dict[str, list[dict[str, Any]]] = {name: [] for name in _TABLES}
        start = position or Position(processor_time=0.0)
        self._episodes, self._evaluations = start.episodes, start.evaluations
        self._last_evaluation = start.last_evaluation
        self._began = time.perf_counter() - start.wall_time
        self._processor_time = start.processor_time
        self._before: dict[str, pa.Table] | None = None
        if position is not None:
            self._before = self._rows_of(position)

    def wall_time(self) -> float:
        """Returns the seconds that the run has taken."""
        return time.perf_counter() - self._began

    def add_processor_time(self, seconds: float) -> None:
        """Adds processor time that the run has taken."""
        if self._processor_time is not None:
            self._processor_time += seconds

    def summary(self, control_steps: int) -> dict[str, Any]:
        """Returns what the manifest of a finished run says of its length."""
        return {
            "wall_time": self.wall_time(),
            "processor_time": self._processor_time,
            "steps_done": control_steps,
        }

    def position(self, control_steps: int) -> Position:
        """Returns how far the run is with the rows that wait."""
        return Position(
            control_steps=control_steps,
            episodes=self._episodes,
            evaluations=self._evaluations,
            last_evaluation=self._last_evaluation,
            wall_time=self.wall_time(),
            processor_time=self._processor_time,
        )

    def episode(
        self, control_steps: int, episode_return: float, length: int, losses: dict[str, float]
    ) -> None:
        """Adds a training episode that has just ended.

        Raises:
            WorkError: if the table has no column for one of the losses.
        """
        unknown = sorted(losses.keys() - schema.LOSSES)
        if unknown:
            raise WorkError(
                f"The table episodes has no column for {', '.join(unknown)}; the losses that it "
                f"has are {', '.join(schema.LOSSES)}."
            )
        row = {"episode": self._episodes, **losses}
        self._add("episodes", control_steps, episode_return, length, row)
        self._episodes += 1

    def evaluation(self, control_steps: int, returns_and_lengths: list[tuple[float, int]]) -> None:
        """Adds the episodes of one evaluation."""
        for episode, (episode_return, length) in enumerate(returns_and_lengths):
            row = {"evaluation": self._evaluations, "episode": episode}
            self._add("evaluations", control_steps, episode_return, length, row)
        self._evaluations += 1
        self._last_evaluation = control_steps

    def waiting(self) -> tuple[dict[str, pa.Table], bool]:
        """Returns the rows that wait, by table, and whether they stand for all that there are.

        Now and then these are joined with those that are committed, so that a run of days does not
        end up in thousands of files.
        """
        tables = {
            name: pa.Table.from_pylist(self._rows[name], columns)
            for name, columns in _TABLES.items()
        }
        before = self._before
        if before is None and any(len(self._record.parts(name)) >= _MOST_PARTS for name in tables):
            before = {name: self._record.read(name, columns) for name, columns in _TABLES.items()}
        if before is None:
            return tables, False
        return {name: pa.concat_tables([before[name], tables[name]]) for name in tables}, True

    def committed(self) -> None:
        """Forgets the rows that waited."""
        self._rows = {name: [] for name in self._rows}
        self._before = None

    def commit(self) -> float:
        """Commits the rows that wait, all or none; returns the seconds that it took."""
        began = time.perf_counter()
        tables, replace = self.waiting()
        self._record.append(tables, replace=replace)
        self.committed()
        return time.perf_counter() - began

    def _rows_of(self, position: Position) -> dict[str, pa.Table] | None:
        """Returns the committed rows that came before a checkpoint, or None if there are no others.

        The last evaluation may be of the same control step: the rows are told by their numbers.
        """
        found = {name: self._record.read(name, columns) for name, columns in _TABLES.items()}
        episodes, evaluations = found["episodes"], found["evaluations"]
        counted = {
            "episodes": episodes.filter(pc.less(episodes["episode"], position.episodes)),
            "evaluations": evaluations.filter(
                pc.less(evaluations["evaluation"], position.evaluations)
            ),
        }
        same = all(counted[name].num_rows == found[name].num_rows for name in found)
        return None if same else counted

    def _add(
        self,
        table: str,
        control_steps: int,
        episode_return: float,
        length: int,
        row: dict[str, Any],
    ) -> None:
        self._rows[table].append(
            {
                "run": self._record.id,
                "control_steps": control_steps,
                "episode_return": episode_return,
                "length": length,
                "wall_time": self.wall_time(),
                "processor_time": self._processor_time,
                **row,
            }
        )


class ProcessorClock:
    """Processor time of this process, user and system, of all its threads."""

    def __init__(self) -> None:
        """Starts the clock."""
        self._last = time.process_time()

    def share(self, logs: Sequence[RunLog]) -> None:
        """Adds the time since the last call to some runs, in equal shares."""
        now = time.process_time()
        for log in logs:
            log.add_processor_time((now - self._last) / len(logs))
        self._last = now


class Pace:
    """When it is time to commit: so seldom that it costs next to nothing."""

    def __init__(self, every: float) -> None:
        """Waits for the first time.

        Args:
            every: seconds between two commits, at least; 0 for whenever there is something.
        """
        self._every = every
        self._next = time.perf_counter() + every

    def due(self) -> bool:
        """Returns whether it is time."""
        return time.perf_counter() >= self._next

    def spent(self, seconds: float) -> None:
        """Waits for the next time after a commit that took some seconds."""
        wait = max(self._every, seconds / _LARGEST_SHARE) if self._every else 0.0
        self._next = time.perf_counter() + wait
