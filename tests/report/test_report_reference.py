"""The runs that are shipped with jbench are whole, and learned what was published."""

import numpy as np
import pytest

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
@pytest.mark.parametrize(("engine", "seeds"), [("batched", 5), ("sb3", 3)])
@pytest.mark.parametrize(
    ("algo", "low", "high"), [("td3", 766.07, 971.14), ("sac", 840.23, 951.93)]
)
def test_the_last_twenty_episodes_lie_in_the_published_band(runs, algo, low, high, engine, seeds):
    chosen = [
        record.read("episodes", schema.EPISODES)["episode_return"].to_numpy()[-20:]
        for record in runs
        if (record.settings["algo"], record.settings["engine"]) == (algo, engine)
        and (record.settings["task"], record.settings["steps"]) == ("face_direction", 100_000)
    ]
    assert len(chosen) == seeds
    assert low <= np.median(chosen) <= high
