"""Fixtures of the report tests: fabricated results and a browser."""

import json

import numpy as np
import pandas as pd
import pytest

from jbench.cli import main
from jbench.report.data.build import build, usable_runs
from jbench.report.data.configuration import with_returns
from jbench.report.data.published import read_published
from jbench.report.data.returns import TRAINING
from jbench.store import Results, parquet, query, schema
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


def episodes(run, returns, environments=1, seconds=None):
    """Returns rows of the table `episodes`; parallel environments end theirs together, as in PPO.

    Args:
        run: id of the run.
        returns: episode returns.
        environments: number of parallel environments.
        seconds: processor time per episode; None: not recorded.
    """
    index = np.arange(len(returns))
    steps = (index // environments + 1) * environments * 1000
    columns = {"run": run, "episode": index, "control_steps": steps, "length": 1000}
    columns |= {"episode_return": np.asarray(returns, float), "wall_time": index * 1.0}
    if seconds is not None:
        columns["processor_time"] = (index + 1) * float(seconds)
    return parquet.to_table(pd.DataFrame(columns), schema.EPISODES)


def evaluations(run, means, seconds=None):
    """Returns rows of the table `evaluations`: two episodes each, 5 above and below their mean.

    Args:
        run: id of the run.
        means: mean return of each evaluation, by the control steps of the run.
        seconds: processor time per 1000 control steps; None: not recorded.
    """
    steps, index = np.repeat([*means], 2), np.arange(2 * len(means))
    columns = {"run": run, "evaluation": index // 2, "episode": index % 2, "control_steps": steps}
    columns["episode_return"] = np.repeat([*means.values()], 2) + np.where(index % 2, 5.0, -5.0)
    if seconds is not None:
        columns["processor_time"] = steps / 1000 * seconds
    return parquet.to_table(pd.DataFrame({**columns, "length": 1000}), schema.EVALUATIONS)


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
            values = pd.DataFrame(metrics, index=[1000, 2000]).rename_axis("control_steps")
            values = values.melt(var_name="name", ignore_index=False).reset_index().assign(run=id)
            tables["metrics"] = parquet.to_table(values, schema.METRICS)
        record.append(tables)
        if diverged is not None:
            record.fail("its critic_loss is not finite")
            self._record_divergence(record, diverged)
        elif status == "finished":
            record.finish({"wall_time": 1.0})
        elif status == "failed":
            record.fail("it broke")
        return record

    def learn(self, finals, episodes=80, **settings):
        """Adds a run per seed with return 0, then from half of its episodes on its final return."""
        for seed, final in enumerate(finals):
            self.run(np.repeat([0.0, final], episodes // 2), seed, **settings)

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


def import_curves(results, algo, curves, *more):
    """Imports curves of an algorithm on face_direction, the returns of each seed every 1000 steps.

    Args:
        results: path of the results.
        algo: label of the curves.
        curves: returns by seed.
        more: options of `jbench import`.
    """
    file = results.parent / f"{algo}.csv"
    rows = [
        (seed, 1000 * (i + 1), value)
        for seed, returns in curves.items()
        for i, value in enumerate(returns)
    ]
    names = ["seed", "control_steps", "episode_return"]
    pd.DataFrame(rows, columns=names).to_csv(file, index=False)
    typed = ["--task", "face_direction", "--algo", algo, "--seed-column", "seed", *more]
    assert main(["import", "--from", "csv", *typed, "--results", str(results), str(file)]) == 0


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
