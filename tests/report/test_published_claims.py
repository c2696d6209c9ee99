"""Tests of the verdicts on the paper's published curves, from their medians and bands."""

import numpy as np
import pytest

from jbench.report.analysis.published_claims import examine_published


def findings_of(published, claim, *words):
    return [
        f
        for f in examine_published(published)
        if f["claim"] == claim and all(word in f"{f['compared']} {f['source']}" for word in words)
    ]


def test_task_is_solved_if_whole_band_exceeds_900(published):
    # 971 [950, 978] and 963 [908, 985] exceed 900; 933 [633, 967] contains it; 555 [167, 788] is
    # below it.
    for name, verdict in {
        "move_from_origin td3": "supported",
        "face_direction td3": "supported",
        "move_from_origin ddpg": "undecided",
        "move_to_position td3": "contradicted",
    }.items():
        (found,) = findings_of(published, "g", name)
        assert (found["verdict"], found["seeds"], found["source"]) == (verdict, 10, "Figure 9"), (
            name
        )
        assert "97.9%" in found["remark"]


def test_medians_are_ordered_if_bands_do_not_overlap(published):
    # SAC 799 [733, 834] against PPO 174 [41, 390]; DDPG 808 [693, 881] against 239 [24, 863].
    (apart,) = findings_of(published, "e", "move_in_direction sac")
    assert apart["verdict"] == "supported"
    assert apart["low"] == pytest.approx(733 - 390, abs=3)
    (overlapping,) = findings_of(published, "e", "face_direction ddpg")
    assert overlapping["verdict"] == "undecided"
    assert "as printed" in overlapping["remark"]


def test_claims_without_published_interval_are_undecided(published):
    for claim in "abcdf":
        findings = findings_of(published, claim)
        assert findings, claim
        assert {f["verdict"] for f in findings} == {"undecided"}
        assert all(np.isnan(f["low"]) and f["remark"] for f in findings)


def test_finding_on_figure_8_mentions_baseline_of_figure_9(published):
    (found,) = findings_of(published, "a", "Figure 8")
    assert "ends at 295" in found["remark"]
    assert "at 632" in found["remark"]
    (single,) = findings_of(published, "a", "Figure 7")
    assert single["seeds"] == 1
    assert "one seed" in single["remark"]


def test_band_of_ten_seeds_has_stated_coverage():
    # 1 - 22/1024 = 97.9% for the second to ninth of ten; the band holds these two.
    drawn = np.random.default_rng(0).normal(size=(20_000, 10))
    low, high = np.percentile(drawn, (10, 90), axis=1)
    second, ninth = np.sort(drawn, axis=1)[:, [1, 8]].T
    assert ((low <= second) & (ninth <= high)).all()
    assert np.mean((second <= 0) & (ninth >= 0)) == pytest.approx(1 - 22 / 1024, abs=0.004)
