"""Fixtures of the report tests: fabricated results and a browser."""

import json

import numpy as np
import pyarrow as pa
import pytest

from jbench.report.data.build import build, usable_runs
from jbench.report.data.configuration import with_returns
from jbench.report.data.published import read_published
from jbench.report.data.returns import TRAINING
from jbench.store import Results, query, schema
from tests.report import browser
from tests.training.small_runs import shorten_episodes

SETTINGS = {
    "task": "face_direction",
    "algo": "td3",
    "representation": "full",
    "encoder": None,
    "engine": "cpu",
    "time_limit": "bootstrap",
    "hyperparameters": {"learning_rate": 1e-4, "batch_size": 256},
}


def rows(columns, fields):
    """Returns rows of a table with these columns and null in all others."""
    count = len(columns["run"])
    return pa.table(
        [
            pa.array(columns[field.name], field.type)
            if field.name in columns
            else pa.nulls(count, field.type)
            for field in fields
        ],
        schema=fields,
    )


def episodes(run, returns, environments=1, seconds=None):
    """Returns rows of the table `episodes`; parallel environments end theirs together, as in PPO.

    Args:
        run: id of the run.
        returns: episode returns.
        environments: number of parallel environments.
        seconds: processor time per episode; None: not recorded.
    """
    index = np.arange(len(returns))
    columns = {
        "run": [run] * len(returns),
        "episode": index,
        "control_steps": (index // environments + 1) * environments * 1000,
        "episode_return": np.asarray(returns, float),
        "length": np.full(len(returns), 1000),
        "wall_time": index * 1.0,
    }
    if seconds is not None:
        columns["processor_time"] = (index + 1) * float(seconds)
    return rows(columns, schema.EPISODES)


def evaluations(run, means, seconds=None):
    """Returns rows of the table `evaluations`: two episodes each, 5 above and below their mean.

    Args:
        run: id of the run.
        means: mean return of each evaluation, by the control steps of the run.
        seconds: processor time per 1000 control steps; None: not recorded.
    """
    steps = np.repeat([*means], 2)
    columns = {
        "run": [run] * len(steps),
        "evaluation": np.arange(len(steps)) // 2,
        "control_steps": steps,
        "episode": np.arange(len(steps)) % 2,
        "episode_return": np.repeat([*means.values()], 2) + np.tile([-5.0, 5.0], len(means)),
        "length": np.full(len(steps), 1000),
    }
    if seconds is not None:
        columns["processor_time"] = steps / 1000 * seconds
    return rows(columns, schema.EVALUATIONS)


class FabricatedResults:
    """Adds runs to a results directory."""

    def __init__(self, path):
        self.results = Results(path)
        self.count = 0

    def run(self, returns, seed=0, *, status="finished", environments=1, **changes):
        """Adds a run with these episode returns and settings; returns its record.

        Args:
            returns: returns of its training episodes.
            seed: seed of the run.
            status: status of the run.
            environments: number of parallel environments.
            changes: settings, and `evaluated` (mean returns of its evaluations by control steps),
                `seconds` (processor time per episode), `metrics` (values at two steps by name) and
                `diverged` (control step of divergence).
        """
        steps = changes.pop("steps", len(returns) * 1000)
        evaluated, seconds = changes.pop("evaluated", {}), changes.pop("seconds", None)
        diverged, metrics = changes.pop("diverged", None), changes.pop("metrics", {})
        settings = {**SETTINGS, **changes, "seed": seed, "steps": steps}
        self.count += 1
        id = f"face_direction/r{self.count:04d}"
        record = self.results.create("run", id, settings)
        tables = {"episodes": episodes(id, returns, environments, seconds)}
        if evaluated:
            tables["evaluations"] = evaluations(id, evaluated, seconds)
        if metrics:
            names = [name for name in metrics for _ in (1, 2)]
            columns = {"run": [id] * len(names), "control_steps": [1000, 2000] * len(metrics)}
            columns |= {"name": names, "value": [v for pair in metrics.values() for v in pair]}
            tables["metrics"] = rows(columns, schema.METRICS)
        record.append(tables)
        if diverged is not None:
            record.fail("its critic_loss is not finite")
            self._record_divergence(record, diverged)
        elif status == "finished":
            record.finish({"wall_time": 1.0})
        elif status == "failed":
            record.fail("it broke")
        return record

    def _record_divergence(self, record, control_steps):
        """Writes the control step of a divergence into the manifest of a run."""
        path = record.path / "manifest.json"
        manifest = json.loads(path.read_text())
        diverged = {"update": 7, "control_steps": control_steps, "what": "critic_loss"}
        summary = {**manifest["summary"], "diverged": diverged}
        path.write_text(json.dumps({**manifest, "summary": summary}))

    def configurations(self, kind=TRAINING):
        """Returns the configurations of all runs, and notes on runs that belong to none."""
        tables = query.load(self.results).tables
        runs = usable_runs(tables["runs"])[0]
        cells, notes = build(runs, tables["episodes"], tables["evaluations"])
        return with_returns(cells, kind), notes

    def curves(self, order="quantile-first", window=100, kind=TRAINING):
        """Returns the curves of all runs."""
        return [cell.curve(order, window) for cell in self.configurations(kind)[0]]


@pytest.fixture
def fabric(tmp_path):
    return FabricatedResults(tmp_path / "results")


@pytest.fixture
def out(tmp_path):
    return tmp_path / "report"


@pytest.fixture
def short_episodes(monkeypatch):
    shorten_episodes(monkeypatch.setattr)


@pytest.fixture(scope="session")
def published():
    return read_published(query.published())


@pytest.fixture(scope="session")
def chromium():
    """A browser; tests that need it are skipped where none is installed."""
    yield from browser.launch()


@pytest.fixture
def opened(chromium):
    """Opens pages and closes them after the test; asserts that each has logged no error."""
    pages = []

    def open_page(path, **options):
        pages.append(browser.BrowserPage(chromium, path, **options))
        return pages[-1]

    yield open_page
    for page in pages:
        page.assert_quiet()
        page.context.close()
