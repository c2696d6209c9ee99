"""Fixtures of the report tests: fabricated results and a browser."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from jbench.cli import main
from jbench.report.data.build import build, usable_runs
from jbench.report.data.configuration import with_returns
from jbench.report.data.curves import read_published
from jbench.returns import TRAINING
from jbench.store import Results, record_files, schema
from jbench.store.tables import published_rows, read_tables
from tests.report import browser
from tests.store.store_rows import alter_manifest

SETTINGS = {
    "task": "face_direction",
    "algo": "td3",
    "representation": "full",
    "encoder": None,
    "engine": "cpu",
    "time_limit": "bootstrap",
    "hyperparameters": {"learning_rate": 1e-4, "batch_size": 256},
}


def table(columns, described):
    """Returns rows of a table; what they lack is null, and a number or text is that of each row.

    A frame of pandas on the way would take most of the time in which a run is made.
    """
    rows = len(columns["control_steps"])
    arrays = []
    for field in described:
        if field.name not in columns:
            arrays.append(pa.nulls(rows, field.type))
            continue
        values = np.broadcast_to(columns[field.name], rows)
        arrays.append(pa.array(values.copy(), field.type, from_pandas=True))
    return pa.table(arrays, schema=described)


def episodes(run, returns, ends=None):
    """Returns rows of the table `episodes`, by default each of 1000 control steps."""
    index = np.arange(len(returns))
    ends = 1000 * (index + 1) if ends is None else np.asarray(ends)
    lengths = np.diff(ends, prepend=0)
    columns = {"run": run, "episode": index, "control_steps": ends, "length": lengths}
    columns["episode_return"] = np.asarray(returns, float)
    columns["wall_time"] = index * 1.0
    return table(columns, schema.EPISODES)


def evaluations(run, means):
    """Returns rows of the table `evaluations`: two episodes each, 5 above and below their mean."""
    steps, index = np.repeat([*means], 2), np.arange(2 * len(means))
    columns = {"run": run, "evaluation": index // 2, "episode": index % 2, "control_steps": steps}
    columns["episode_return"] = np.repeat([*means.values()], 2) + np.where(index % 2, 5.0, -5.0)
    return table({**columns, "length": 1000}, schema.EVALUATIONS)


class FabricatedResults:
    def __init__(self, path):
        self.results = Results(path)
        self.count = 0

    def run(self, returns, seed=0, *, status="finished", **changes):
        """Adds a run with these episode returns and settings; returns its record.

        `changes` may have `evaluated` (mean returns of its evaluations by control steps, perhaps
        none so far), `metrics` (values at two steps by name), `diverged` (control step of
        divergence) and `ends` (control steps of the run at the end of each episode).
        """
        steps = changes.pop("steps", len(returns) * 1000)
        evaluated, metrics = changes.pop("evaluated", None), changes.pop("metrics", {})
        diverged, ends = changes.pop("diverged", None), changes.pop("ends", None)
        settings = {**SETTINGS, **changes, "seed": seed, "steps": steps}
        if evaluated is not None:
            settings.setdefault("evaluate_episodes", 2)
        self.count += 1
        id = f"face_direction/r{self.count:04d}"
        record = self.results.create("run", id, settings)
        tables = {"episodes": episodes(id, returns, ends)}
        if evaluated:
            tables["evaluations"] = evaluations(id, evaluated)
        if metrics:
            values = pd.DataFrame(metrics, index=[1000, 2000]).rename_axis("control_steps")
            values = values.melt(var_name="name", ignore_index=False).reset_index().assign(run=id)
            tables["metrics"] = record_files.to_table(values, schema.METRICS)
        record.append(tables)
        if diverged is not None:
            record.fail("its critic_loss is not finite")
            divergence = {"update": 7, "control_steps": diverged, "what": "critic_loss"}
            summary = {**record.manifest.summary, "diverged": divergence}
            alter_manifest(record, summary=summary)
        elif status == "finished":
            record.finish({"wall_time": 1.0})
        elif status == "failed":
            record.fail("it broke")
        return record

    def learn(self, finals, episodes=80, **settings):
        """Adds a run per seed with return 0, then from half of its episodes on its final return."""
        for seed, final in enumerate(finals):
            self.run(np.repeat([0.0, final], episodes // 2), seed, **settings)

    def evaluation(self, policy, returns, **settings):
        """Adds an evaluation of a policy on face_direction, with these episode returns."""
        self.count += 1
        id = f"face_direction/policy/e{self.count:04d}"
        settings["task"] = "face_direction"
        settings["policy"] = policy
        settings["episodes"] = len(returns)
        record = self.results.create("evaluation", id, settings)
        columns = {"evaluation": id, "episode": range(len(returns)), "episode_return": returns}
        rows = pd.DataFrame({**columns, "length": 1000})
        record.append(
            {"policy_episodes": record_files.to_table(rows, schema.TABLES["policy_episodes"])}
        )
        record.finish({"median": float(np.median(returns))})

    def flat(self, finals, episodes=40, **settings):
        """Adds a run per seed, whose episodes all have its final return."""
        for seed, final in enumerate(finals):
            self.run(np.full(episodes, float(final)), seed, **settings)

    def configurations(self, kind=TRAINING):
        """Returns the configurations of all runs, and notes on runs that belong to none."""
        tables = read_tables(self.results).tables
        runs = usable_runs(tables["runs"])[0]
        configurations, notes = build(runs, tables["episodes"], tables["evaluations"])
        return with_returns(configurations, kind), notes

    def curves(self, order="quantile-first", window=100, kind=TRAINING):
        return [config.curve(order, window) for config in self.configurations(kind)[0]]


def import_curves(results, algo, curves, *more):
    """Imports curves on face_direction: by seed, the returns after 1000, 2000, … control steps."""
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


@pytest.fixture(scope="session")
def published():
    return read_published(published_rows())


@pytest.fixture(scope="session")
def chromium():
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
