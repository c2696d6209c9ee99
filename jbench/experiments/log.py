"""What a run writes down: its episodes and evaluations."""

import time
from typing import Any

import pyarrow as pa

from jbench.store import Record, schema

_COMMIT_EVERY = 15.0  # s: what a kill can cost at most, beside the episode under way


class RunLog:
    """The rows of a run, committed to its record now and then."""

    def __init__(self, record: Record) -> None:
        """Starts the run's clock."""
        self._record = record
        self._rows: dict[str, list[dict[str, Any]]] = {"episodes": [], "evaluations": []}
        self._began = self._committed = time.perf_counter()
        self._episodes = self._evaluations = 0

    def wall_time(self) -> float:
        """Returns the seconds since the run began."""
        return time.perf_counter() - self._began

    def episode(
        self, control_steps: int, episode_return: float, length: int, losses: dict[str, float]
    ) -> None:
        """Adds a training episode that has just ended."""
        row = {"episode": self._episodes, **losses}
        self._add("episodes", control_steps, episode_return, length, row)
        self._episodes += 1
        if time.perf_counter() - self._committed > _COMMIT_EVERY:
            self.commit()

    def evaluation(self, control_steps: int, returns_and_lengths: list[tuple[float, int]]) -> None:
        """Adds the episodes of one evaluation."""
        for episode, (episode_return, length) in enumerate(returns_and_lengths):
            row = {"evaluation": self._evaluations, "episode": episode}
            self._add("evaluations", control_steps, episode_return, length, row)
        self._evaluations += 1

    def commit(self) -> None:
        """Commits all rows added so far, all or none."""
        self._record.append(
            {
                name: pa.Table.from_pylist(rows, getattr(schema, name.upper()))
                for name, rows in self._rows.items()
            }
        )
        self._rows = {name: [] for name in self._rows}
        self._committed = time.perf_counter()

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
                **row,
            }
        )
