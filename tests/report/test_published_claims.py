"""Tests of the verdicts on the paper's published curves, from their medians and bands."""

import numpy as np
import pytest

from jbench.report.analysis.claim_frame import published_findings
from jbench.report.data.curves import PUBLISHED_KEY


def expected(ends, row):
    """Returns the effect and the ends of its interval, worked out from the ends of curves."""
    claim, (task, name, representation, *_) = row["claim"], row["compared"].split()
    algo = name.lower()
    ours = ends.loc[row["source"], task, algo, representation]
    if claim == "g":
        return [*ours[["median", "q10", "q90"]]]
    other = ("ppo", "full") if claim in "ef" else (algo, "full")
    theirs = ends.loc[row["source"], task, *other]
    if claim in "bf":
        low, high = ("q25", "q75") if claim == "b" else ("q10", "q90")
        return [(ours[high] - ours[low]) / (theirs[high] - theirs[low]), np.nan, np.nan]
    name = "over_run" if claim == "c" else "median"
    interval = [ours["q10"] - theirs["q90"], ours["q90"] - theirs["q10"]]
    return [ours[name] - theirs[name], *(interval if claim == "e" else [np.nan, np.nan])]


def test_findings_are_those_of_the_curves(published):
    groups = published.groupby(PUBLISHED_KEY)
    ends = groups.last()
    ends["over_run"] = [
        np.trapezoid(curve["median"], curve["steps"]) / np.ptp(curve["steps"])
        for _, curve in groups
    ]
    findings = [row for row in published_findings(None, ()) if row["claim"] != "d"]
    for row in findings:
        numbers = [row["effect"], row["low"], row["high"]]
        assert numbers == pytest.approx(expected(ends, row), nan_ok=True), row
        # The whole band has to be on one side: of 900 for (g), and of 0 for (e).
        above, below = (end > (900 if row["claim"] == "g" else 0) for end in numbers[1:])
        verdicts = {(True, True): "supported", (False, False): "contradicted"}
        decided = verdicts.get((above, below), "undecided")
        assert row["verdict"] == ("undecided" if np.isnan(row["low"]) else decided), row
        assert row["remark"], row
    assert len(findings) == 55


def test_gain_is_that_of_the_harder_task_less_that_of_the_easier_one():
    rows = published_findings(None, ())
    easier, harder = (row["effect"] for row in rows if row["claim"] == "c")
    (gain,) = (row for row in rows if row["claim"] == "d")
    assert (gain["effect"], gain["verdict"]) == (pytest.approx(harder - easier), "undecided")


def test_findings_of_a_task_or_an_algorithm():
    assert {row["claim"] for row in published_findings(None, ["td3"])} == {"g"}
    assert {row["claim"] for row in published_findings("face_direction", ())} == {*"acefg"}
    assert len(published_findings("move_in_direction", ["ddpg"])) == 4
