"""Fabricated results."""

import numpy as np
import pyarrow as pa
import pytest

from jbench.report.cells import build_cells, usable_runs
from jbench.report.curves import learning_curve
from jbench.report.drawing import LearnedCurve
from jbench.report.published import read_published
from jbench.store import Results, query, schema

SETTINGS = {
    "task": "face_direction",
    "algo": "td3",
    "representation": "full",
    "encoder": None,
    "engine": "cpu",
    "time_limit": "bootstrap",
    "hyperparameters": {"learning_rate": 1e-4, "batch_size": 256},
}


def episodes(run, returns, environments=1):
    """Returns rows of the table `episodes`; environments end theirs together, as PPO's do."""
    index = np.arange(len(returns))
    columns = {
        "run": pa.array([run] * len(returns), pa.string()),
        "episode": index,
        "control_steps": (index // environments + 1) * environments * 1000,
        "episode_return": np.asarray(returns, float),
        "length": np.full(len(returns), 1000),
        "wall_time": index * 1.0,
    }
    return pa.table(
        [
            pa.array(columns[name], field.type)
            if name in columns
            else pa.nulls(len(returns), field.type)
            for name, field in zip(schema.EPISODES.names, schema.EPISODES, strict=True)
        ],
        schema=schema.EPISODES,
    )


class Fabric:
    """Adds runs to a results directory."""

    def __init__(self, path):
        self.results = Results(path)
        self.count = 0

    def run(self, returns, seed=0, *, status="finished", environments=1, **changes):
        """Adds a run with these episode returns and settings; returns its record."""
        steps = changes.pop("steps", len(returns) * 1000)
        settings = {**SETTINGS, **changes, "seed": seed, "steps": steps}
        self.count += 1
        id = f"face_direction/r{self.count:04d}"
        record = self.results.create("run", id, settings)
        record.append({"episodes": episodes(id, returns, environments)})
        if status == "finished":
            record.finish({"wall_time": 1.0})
        elif status == "failed":
            record.fail("it broke")
        return record

    def cells(self):
        """Returns the cells of all runs, and the notes on runs that are in none."""
        tables = query.load(self.results).tables
        return build_cells(usable_runs(tables["runs"])[0], tables["episodes"])

    def learned(self, order="quantile-first", window=100):
        """Returns the curves of all runs."""
        return [
            LearnedCurve(c, learning_curve(c.returns, c.control_steps, c.lengths, order, window))
            for c in self.cells()[0]
        ]


@pytest.fixture
def fabric(tmp_path):
    return Fabric(tmp_path / "results")


@pytest.fixture
def out(tmp_path):
    return tmp_path / "report"


@pytest.fixture(scope="session")
def published():
    return read_published(query.published())
