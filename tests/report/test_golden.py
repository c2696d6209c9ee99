"""Numbers of the frames against those of the report before them (tests/report/golden).

Dropped on purpose: the interquartile range and the width from the 10th to the 90th percentile, the
ratios of spreads to the full observation's (the standard deviation between agents is in their
place, on which verdicts (b) and (f) rest as well), the control steps to half of the best published
median, interquartile means of numbers of control steps, and comparisons of variants and of
algorithms (their probabilities of improvement are in the frame of pairs).
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jbench.report.data.configuration import display_name, shown_representation
from jbench.report.frames import Frames
from tests.report.conftest import FabricatedResults
from tests.report.golden import cases

GOLDEN = Path(__file__).parent / "golden"
SOURCES = {"ours": "own", "imported, not verified": "imported"}
KEY = ["source", "task", "algo", "representation", "returns"]
STATISTICS = {
    ("final_return", "median"): "median",
    ("final_return", "interquartile_mean"): "iqm",
    ("area", "interquartile_mean"): "over_run",
    ("final_return", "standard_deviation"): "deviation",
    ("steps_to_solved", "median"): "solved_steps",
}


@pytest.fixture(scope="module", params=[*cases.CASES])
def both(request, tmp_path_factory):
    """The frames of a case, and a function that returns a golden frame of it."""
    fabric = FabricatedResults(tmp_path_factory.mktemp(request.param) / "results")

    def golden(name):
        frame = pd.read_csv(GOLDEN / f"{request.param}-{name}.csv")
        for column, convert in {
            "source": lambda name: SOURCES.get(name, name),
            "algo": display_name,
            "representation": shown_representation,
        }.items():
            if column in frame:
                frame[column] = frame[column].map(convert)
        return frame

    return Frames(*cases.CASES[request.param](fabric)), golden


def close(one, other):
    np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6, equal_nan=True)


def test_statistics_of_seeds_are_as_before(both):
    now, golden = both
    before = golden("seed_statistics")
    keys = [*KEY, "variant"]
    rows = now.configurations.set_index(keys).sort_index()
    for (measure, statistic), name in STATISTICS.items():
        old = before[(before["measure"] == measure) & (before["statistic"] == statistic)]
        new = rows.loc[pd.MultiIndex.from_frame(old[keys])]
        assert len(new) == len(old) > 0
        for theirs, ours in {"value": "", "low": "_low", "high": "_high"}.items():
            close(new[f"{name}{ours}"], old[theirs])
        assert new["seeds"].tolist() == old["seeds"].tolist()
    alone = before[before["statistic"] == "standard_deviation_by_episodes"]
    new = rows.loc[pd.MultiIndex.from_frame(alone[keys])]
    close(new["deviation_by_episodes"], alone["value"])


def test_table_of_configurations_is_as_before(both):
    now, golden = both
    before = golden("table")
    for returns in ("evaluation", "training"):
        old = before[before[f"{returns}_return_median"].notna()]
        rows = now.configurations[now.configurations["returns"] == returns]
        keys = [*KEY[:-1], "variant"]
        new = rows.set_index(keys).loc[pd.MultiIndex.from_frame(old[keys])]
        close(new["median"], old[f"{returns}_return_median"])
        for name in ("steps_min", "diverged"):
            assert new[name].tolist() == old[name].tolist()
        assert new["steps"].tolist() == old["steps_max"].tolist()
        if returns == "training":
            close(new["published"], old["published_median"])


def test_points_of_curves_are_as_before(both):
    now, golden = both
    before = golden("aggregate").rename(columns={"q50": "median", "control_steps": "steps"})
    names = now.configurations[[*KEY, "variant", "configuration"]]
    points = now.curves.merge(names[["configuration", "returns", "variant"]])
    found = before.merge(points, on=[*KEY, "variant", "steps", "seeds", "window"])
    assert len(found) == len(before)
    close(found["median_x"], found["median_y"])
    banded = found[found["seeds"] > 2]
    for name in ("q10", "q25", "q75", "q90"):
        close(banded[f"{name}_x"], banded[f"{name}_y"])


def test_pairs_have_probabilities_as_before(both):
    now, golden = both
    before = golden("seed_comparisons")
    variants = now.configurations.drop_duplicates("configuration").set_index("configuration")
    pairs = now.pairs.assign(
        **{f"variant_{x}": now.pairs[x].map(variants["variant"]) for x in "ab"}
    )
    found = before.merge(pairs, on=["task", "returns", "variant_a", "variant_b"])
    assert len(found)
    close(found["probability_of_improvement"], found["p"])


def test_verdicts_rest_on_differences_as_before(both):
    now, golden = both
    before = golden("seed_comparisons")
    before = before[before["representation_b"] == "full"]
    variants = now.configurations.drop_duplicates("configuration").set_index("configuration")
    verdicts = now.verdicts[(now.verdicts["claim"] == "a") & (now.verdicts["against"] == "full")]
    verdicts = verdicts.assign(variant_a=verdicts["configuration"].map(variants["variant"]))
    found = before.merge(verdicts, on=["returns", "variant_a"])
    found = found[found["representation_a"] != "full"]
    assert len(found)
    close(found["iqm_difference"], found["value"])
    decided = found[found["verdict"] != "similar"]  # which shows the 90% interval
    close(decided["iqm_difference_low"], decided["low"])
    close(decided["iqm_difference_high"], decided["high"])


def test_claims_are_as_before(both):
    now, golden = both
    before = golden("claims")
    # Those of representations with other scales, and of heading, are newer.
    newer = now.claims.astype(str).apply(
        lambda texts: texts.str.contains("-observation|-whitened|heading|no-yaw")
    )
    claims = now.claims[~newer.any(axis=1)]
    assert len(claims) == len(before)
    keys = ["claim", "source", "returns"]
    for name, old in before.groupby(keys):
        new = claims[(claims[keys] == list(name)).all(axis=1)]
        order = ["effect", "low"]
        old, new = (frame.sort_values(order) for frame in (old, new))
        close(new[["effect", "low", "high"]], old[["effect", "low", "high"]])
        if name[0] not in "bdf":  # which now need a difference of agents, or a gain
            assert new["verdict"].tolist() == old["verdict"].tolist()


def test_encoders_are_as_before(both):
    now, golden = both
    if len(now.encoders):
        before = golden("encoders").drop(columns="settings")
        # Those with other scales, and heading, are newer.
        scaled = now.encoders["representation"].str.contains(
            "-observation|-whitened|heading|no-yaw"
        )
        same = now.encoders[~scaled].reset_index(drop=True)
        pd.testing.assert_frame_equal(same[before.columns], before, check_dtype=False)


def test_returns_beside_predictions_are_as_before(both):
    now, golden = both
    before = golden("reduction")
    found = before.merge(now.predictions, on=["task", "algo", "representation", "returns"])
    for name in ("iqm", "low", "high"):
        close(found[f"{name}_x"], found[f"{name}_y"])
