"""Log of a run: its episodes, evaluations and paths, and when they are committed."""

import contextlib
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
from pydantic import Field

from jbench.settings.base import Settings
from jbench.store import Record, schema
from jbench.task_specs import CONTROL_TIMESTEP
from jbench.tasks.task import PATH_EVERY, RobotPath

POLICY_EVALUATION = "policy_evaluation"
"""Key of a finished run's summary: the number of the evaluation that ran the kept policy."""

_MAX_PARTS = 32  # files of a table before they are merged
_MAX_COMMIT_SHARE = 0.02  # fraction of a run's time that its commits may take


class Position(Settings):
    """Progress of a run: control steps of all environments, counts, and s without interruptions.

    The processor time is None in checkpoints of older versions, where it is unknown.
    """

    control_steps: int = Field(default=0, ge=0)
    episodes: int = Field(default=0, ge=0)
    evaluations: int = Field(default=0, ge=0)
    last_evaluation: int = Field(default=0, ge=0)
    wall_time: float = Field(default=0.0, ge=0)
    processor_time: float | None = Field(default=None, ge=0)


class RunLog:
    """Pending rows of a run, and its progress, which includes them but for steps and wall time."""

    def __init__(self, record: Record, position: Position | None = None) -> None:
        """Starts the clock of a run, which resumes at a position; rows after it will be dropped."""
        self._record = record
        self._rows: dict[str, list[dict[str, Any]]] = {name: [] for name in schema.RUN_TABLES}
        self.progress = position or Position(processor_time=0.0)
        self._began = time.perf_counter() - self.progress.wall_time
        # Tables that the next commit replaces. The first and the latest path are kept.
        self._replacements: dict[str, pa.Table] = {}
        self._paths = schema.PATHS.empty_table()
        if position is not None:
            before = rows_before(record, position)
            self._paths = before["paths"]
            self._replacements = {
                name: rows for name, rows in before.items() if len(rows) < record.rows(name)
            }

    def summary(self, control_steps: int, *, evaluated: bool) -> dict[str, Any]:
        """Returns the entries of a manifest; `evaluated`: the kept policy is the last evaluated."""
        entries = {
            "wall_time": self._wall_time(),
            "processor_time": self.progress.processor_time,
            "steps_done": control_steps,
        }
        if evaluated:
            entries[POLICY_EVALUATION] = self.progress.evaluations - 1
        return entries

    def position(self, control_steps: int) -> Position:
        """Returns the progress at a control step."""
        now = {"control_steps": control_steps, "wall_time": self._wall_time()}
        return self.progress.model_copy(update=now)

    def is_evaluation_due(self, every: int, control_steps: int) -> bool:
        """Returns whether a multiple of `every` was passed since the last evaluation."""
        return control_steps // every != self.progress.last_evaluation // every

    def episode(
        self,
        control_steps: int,
        episode_return: float,
        losses: Mapping[str, float],
        length: int,
    ) -> None:
        """Adds a training episode that has just ended, after these control steps of the run.

        `length` are the control steps of the episode.
        """
        number = self.progress.episodes
        row = {
            "episode": number,
            "episode_return": episode_return,
            "length": length,
            **losses,
        }
        self._add("episodes", control_steps, row)
        self._advance(episodes=number + 1)

    def evaluation(
        self,
        control_steps: int,
        returns: Sequence[float],
        lengths: Sequence[int],
        path: RobotPath | None = None,
    ) -> None:
        """Adds an evaluation, with the path of its first episode; the first and last are kept."""
        number = self.progress.evaluations
        for episode, (episode_return, length) in enumerate(zip(returns, lengths, strict=True)):
            row = {
                "evaluation": number,
                "episode": episode,
                "episode_return": episode_return,
                "length": length,
            }
            self._add("evaluations", control_steps, row)
        if path is not None:
            self._set_latest_path(path, control_steps)

        self._advance(evaluations=number + 1, last_evaluation=control_steps)

    def _set_latest_path(self, path: RobotPath, control_steps: int) -> None:
        """Replaces the latest path, but not that of the first evaluation."""
        names = {
            "run": self._record.id,
            "evaluation": self.progress.evaluations,
            "control_steps": control_steps,
            "target_x": path.target.get("x"),
            "target_y": path.target.get("y"),
            "target_yaw": path.target.get("yaw"),
        }
        points = [
            {**names, "time": n * PATH_EVERY * CONTROL_TIMESTEP, "x": x, "y": y, "heading": yaw}
            for n, (x, y, yaw) in enumerate(path.points.tolist())
        ]
        first = self._paths.filter(pc.field("evaluation") == 0)
        latest = pa.Table.from_pylist(points, schema.PATHS)
        self._paths = pa.concat_tables([first, latest])
        self._replacements["paths"] = self._paths

    def add_processor_time(self, seconds: float) -> None:
        """Adds processor time to that of the run, if that is known."""
        before = self.progress.processor_time
        if before is not None:
            self._advance(processor_time=before + seconds)

    def metrics(self, control_steps: int, values: Mapping[str, float]) -> None:
        """Adds values that a training loop logs, by name."""
        for name, value in values.items():
            self._add("metrics", control_steps, {"name": name, "value": value})

    def commit(self, files: Mapping[str, bytes] | None = None, drop: Collection[str] = ()) -> None:
        """Commits pending rows and a checkpoint atomically.

        When a table has many files, its rows are written again as one, so that a long run does not
        end with thousands. The checkpoint's files are by role; `drop` are roles to remove.
        """
        record = self._record
        replaced = self._replacements
        if any(len(record.parts(name)) >= _MAX_PARTS for name in schema.LOG_TABLES):
            committed = {name: record.read(name) for name in schema.LOG_TABLES}
            replaced = {**committed, **self._replacements}

        tables = {}
        for name, columns in schema.RUN_TABLES.items():
            rows = pa.Table.from_pylist(self._rows[name], columns)
            if name in replaced:
                rows = pa.concat_tables([replaced[name], rows])
            tables[name] = rows

        record.append(tables, files, drop=drop, replace=replaced)
        self._rows = {name: [] for name in self._rows}
        self._replacements = {}

    def _wall_time(self) -> float:
        """Returns the seconds since the run began."""
        return time.perf_counter() - self._began

    def _advance(self, **changes: float) -> None:
        """Changes values of the progress."""
        self.progress = self.progress.model_copy(update=changes)

    def _add(self, table: str, control_steps: int, row: Mapping[str, Any]) -> None:
        """Adds a row, which the next commit writes; a table keeps the values of its columns."""
        common = {
            "run": self._record.id,
            "control_steps": control_steps,
            "wall_time": self._wall_time(),
            "processor_time": self.progress.processor_time,
        }
        self._rows[table].append({**common, **row})


def rows_before(record: Record, position: Position) -> dict[str, pa.Table]:
    """Returns the committed rows of a run up to a checkpoint, by table; raises as `Record.read`.

    Rows are compared by number, since an evaluation may be at the checkpoint's control step.
    """
    evaluated = pc.field("evaluation") < position.evaluations
    kept = {
        "evaluations": evaluated,
        "metrics": pc.field("control_steps") <= position.control_steps,
        "paths": evaluated,
        "episodes": pc.field("episode") < position.episodes,
    }
    return {name: record.read(name).filter(rows) for name, rows in kept.items()}


class ProcessorClock:
    """Divides the processor time (user and system) of this process among runs."""

    def __init__(self) -> None:
        """Begins to measure."""
        self._last = time.process_time()

    def share(self, logs: Sequence[RunLog]) -> None:
        """Divides the processor time since the last call, over all threads, equally among runs."""
        now = time.process_time()
        for log in logs:
            log.add_processor_time((now - self._last) / len(logs))
        self._last = now


class CommitTimer:
    """Says when a commit is due; commits take at most `_MAX_COMMIT_SHARE` of the time."""

    def __init__(self, every: float) -> None:
        """Has a first commit due at once, so that a run is soon in the results.

        `every` are the least seconds between two commits; with 0, one is always due.
        """
        self._every = every
        self._next = time.perf_counter()

    def is_due(self) -> bool:
        """Returns whether it is time to commit."""
        return time.perf_counter() >= self._next

    @contextlib.contextmanager
    def committing(self) -> Iterator[None]:
        """Measures the commits of a block, and decides when the next one is due."""
        began = time.perf_counter()
        yield
        now = time.perf_counter()
        self._next = now
        if self._every:
            self._next += max(self._every, (now - began) / _MAX_COMMIT_SHARE)
