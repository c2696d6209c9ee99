"""Log of a run: its episodes, evaluations and paths, and when they are committed."""

import time
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pydantic import BaseModel, Field

from jbench.errors import WorkError
from jbench.names import CONTROL_TIMESTEP
from jbench.settings.base import Settings
from jbench.simulation.rollout import PATH_EVERY, Path
from jbench.store import Record, schema

POLICY_EVALUATION = "policy_evaluation"
"""Key of a finished run's summary: the number of the evaluation that ran the kept policy."""

_MAX_PARTS = 32  # files of a table before they are merged
_MAX_COMMIT_SHARE = 0.02  # fraction of a run's time that its commits may take


class Position(BaseModel):
    """Progress of a run.

    Attributes:
        control_steps: control steps over all environments.
        episodes: number of training episodes.
        evaluations: number of evaluations.
        last_evaluation: control steps at the last evaluation.
        wall_time: s, without interruptions.
        processor_time: s; None in checkpoints of older versions, where it is unknown.
    """

    model_config = Settings.model_config

    control_steps: int = Field(default=0, ge=0)
    episodes: int = Field(default=0, ge=0)
    evaluations: int = Field(default=0, ge=0)
    last_evaluation: int = Field(default=0, ge=0)
    wall_time: float = Field(default=0.0, ge=0)
    processor_time: float | None = Field(default=None, ge=0)


class RunLog:
    """Pending rows of a run, and its progress.

    Attributes:
        evaluations: number of evaluations.
    """

    def __init__(self, record: Record, position: Position | None = None) -> None:
        """Starts the run's clock.

        Args:
            position: where the run resumes; None for the beginning. The next commit drops rows
                that were committed after it.
        """
        self._record = record
        self._rows: dict[str, list[dict[str, Any]]] = {name: [] for name in schema.LOG_TABLES}
        start = position or Position(processor_time=0.0)
        self._episodes, self.evaluations = start.episodes, start.evaluations
        self._last_evaluation = start.last_evaluation
        self._began = time.perf_counter() - start.wall_time
        self._processor_time = start.processor_time
        self._before: dict[str, pa.Table] | None = None
        # Of the first evaluation and of the latest one, which replace the committed ones.
        self._paths, self._paths_changed = schema.PATHS.empty_table(), False
        if position is not None:
            before = rows_before(record, position)
            self._paths = before.pop("paths")
            self._paths_changed = self._paths.num_rows < record.rows("paths")
            if any(rows.num_rows < record.rows(name) for name, rows in before.items()):
                self._before = before

    def wall_time(self) -> float:
        """Returns the seconds that the run has taken, without interruptions."""
        return time.perf_counter() - self._began

    def add_processor_time(self, seconds: float) -> None:
        """Adds to the run's processor time."""
        if self._processor_time is not None:
            self._processor_time += seconds

    def summary(self, control_steps: int, *, evaluated: bool) -> dict[str, Any]:
        """Returns the entries of a finished run's manifest.

        Args:
            control_steps: made in the run.
            evaluated: whether the kept policy is the one that the last evaluation ran.
        """
        return {
            "wall_time": self.wall_time(),
            "processor_time": self._processor_time,
            "steps_done": control_steps,
            **({POLICY_EVALUATION: self.evaluations - 1} if evaluated else {}),
        }

    def position(self, control_steps: int) -> Position:
        """Returns the progress, pending rows included."""
        return Position(
            control_steps=control_steps,
            episodes=self._episodes,
            evaluations=self.evaluations,
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

    def evaluation(
        self,
        control_steps: int,
        returns_and_lengths: list[tuple[float, int]],
        path: Path | None = None,
    ) -> None:
        """Adds the episodes of one evaluation.

        Args:
            path: of the first of them. Those of the run's first and of its latest evaluation are
                kept.
        """
        for episode, (episode_return, length) in enumerate(returns_and_lengths):
            row = {"evaluation": self.evaluations, "episode": episode}
            self._add("evaluations", control_steps, episode_return, length, row)
        if path is not None:
            first = self._paths.filter(pc.equal(self._paths["evaluation"], 0))
            self._paths = pa.concat_tables([first, self._path_rows(control_steps, path)])
            self._paths_changed = True
        self.evaluations += 1
        self._last_evaluation = control_steps

    def metrics(self, control_steps: int, values: Mapping[str, float]) -> None:
        """Adds values that a training loop logs, by name."""
        row = {"run": self._record.id, "control_steps": control_steps}
        row["wall_time"] = self.wall_time()
        self._rows["metrics"] += [{**row, "name": name, "value": values[name]} for name in values]

    def pending(self) -> tuple[dict[str, pa.Table], Collection[str]]:
        """Returns the pending rows by table, and the tables whose committed rows they replace.

        They do when a table has many files, so that a long run does not end with thousands.
        """
        tables = {
            name: pa.Table.from_pylist(self._rows[name], columns)
            for name, columns in schema.LOG_TABLES.items()
        }
        paths = {"paths": self._paths} if self._paths_changed else {}
        before = self._before
        if before is None and any(len(self._record.parts(name)) >= _MAX_PARTS for name in tables):
            before = self._committed()
        if before is None:
            return {**tables, **paths}, paths
        joined = {name: pa.concat_tables([before[name], tables[name]]) for name in tables}
        return {**joined, **paths}, {*joined, *paths}

    def mark_committed(self) -> None:
        """Clears the pending rows."""
        self._rows = {name: [] for name in self._rows}
        self._before, self._paths_changed = None, False

    def commit(self) -> float:
        """Commits the pending rows atomically; returns the seconds that it took."""
        began = time.perf_counter()
        tables, replace = self.pending()
        self._record.append(tables, replace=replace)
        self.mark_committed()
        return time.perf_counter() - began

    def _committed(self) -> dict[str, pa.Table]:
        """Returns the committed rows by table, without paths."""
        return {name: self._record.read(name) for name in schema.LOG_TABLES}

    def _path_rows(self, control_steps: int, path: Path) -> pa.Table:
        """Returns the rows of the path of the evaluation that is being added."""
        count = len(path.points)
        constant = {
            "run": self._record.id,
            "evaluation": self.evaluations,
            "control_steps": control_steps,
            **{f"target_{name}": path.target.get(name) for name in ("x", "y", "yaw")},
        }
        x, y, heading = path.points.T
        times = (np.arange(count) * (PATH_EVERY * CONTROL_TIMESTEP)).astype(np.float32)
        columns = {"time": times, "x": x, "y": y, "heading": heading}
        repeated = {name: [value] * count for name, value in constant.items()}
        return pa.table({**columns, **repeated}, schema=schema.PATHS)

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


def rows_before(record: Record, position: Position) -> dict[str, pa.Table]:
    """Returns the committed rows of a run up to a checkpoint, by table.

    Rows are compared by number, since an evaluation may be at the checkpoint's control step.

    Raises:
        WorkError: if the rows are damaged.
    """
    evaluated = pc.field("evaluation") < position.evaluations
    logged = pc.field("control_steps") <= position.control_steps
    return {
        "episodes": record.read("episodes").filter(pc.field("episode") < position.episodes),
        "evaluations": record.read("evaluations").filter(evaluated),
        "metrics": record.read("metrics").filter(logged),
        "paths": record.read("paths").filter(evaluated),
    }


class ProcessorClock:
    """Processor time (user and system) of this process, over all its threads."""

    def __init__(self) -> None:
        self._last = time.process_time()

    def share(self, logs: Sequence[RunLog]) -> None:
        """Divides the time since the last call equally among runs."""
        now = time.process_time()
        for log in logs:
            log.add_processor_time((now - self._last) / len(logs))
        self._last = now


class CommitTimer:
    """Decides when to commit, so that commits take at most `_MAX_COMMIT_SHARE` of the time."""

    def __init__(self, every: float) -> None:
        """Starts the timer; the first commit is due at once, so that a run is soon in the results.

        Args:
            every: minimum seconds between two commits; 0 to commit always.
        """
        self._every = every
        self._next = time.perf_counter()

    def is_due(self) -> bool:
        """Returns whether it is time to commit."""
        return time.perf_counter() >= self._next

    def restart(self, seconds: float) -> None:
        """Restarts the timer after a commit that took this many seconds."""
        wait = max(self._every, seconds / _MAX_COMMIT_SHARE) if self._every else 0.0
        self._next = time.perf_counter() + wait
