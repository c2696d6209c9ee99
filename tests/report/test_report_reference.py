"""The runs that are shipped with jbench are whole, and learned what was published."""

import numpy as np
import pytest

from jbench.experiments.settings import RunSettings
from jbench.report.sources import shipped
from jbench.store import Results, schema
from jbench.store.verify import verify


@pytest.fixture(scope="module")
def runs():
    results = Results(shipped())
    records, problems = results.scan("run")
    assert problems == []
    return records


def test_they_are_whole(runs):
    found = verify(Results(shipped()), 1)
    assert found.faults == []
    assert found.records == len(runs) > 0
    assert {record.status for record in runs} == {"finished"}


def test_no_place_of_the_machine_that_made_them_is_named(runs):
    assert all("command" not in record.manifest.provenance for record in runs)


# Figure 9 at 100,000 control steps: the 10th and the 90th percentile of ten seeds.
BANDS = {"td3": (766.07, 971.14), "sac": (840.23, 951.93)}


@pytest.mark.parametrize(
    ("algo", "engine", "precision", "seeds"),
    [
        ("td3", "batched", "float32", 5),
        ("td3", "batched", "bfloat16", 3),
        ("td3", "sb3", "float32", 3),
        ("sac", "batched", "float32", 5),
        ("sac", "sb3", "float32", 3),
    ],
)
def test_the_last_twenty_episodes_lie_in_the_published_band(runs, algo, engine, precision, seeds):
    kept = [RunSettings(**record.settings) for record in runs]
    chosen = [
        record.read("episodes", schema.EPISODES)["episode_return"].to_numpy()[-20:]
        for record, run in zip(runs, kept, strict=True)
        if (run.algo, run.engine, run.precision) == (algo, engine, precision)
        and (run.task, run.steps) == ("face_direction", 100_000)
    ]
    assert len(chosen) == seeds
    low, high = BANDS[algo]
    assert low <= np.median(chosen) <= high
