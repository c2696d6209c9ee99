"""Tests of verdicts on representations against full and scaled, on runs of known outcome."""

import numpy as np
import pandas as pd
import pytest
import scipy.stats

from jbench.errors import RequestError
from jbench.report.analysis.claims import examine
from jbench.report.analysis.decisions import decision_frame, recorded_comparisons
from jbench.report.analysis.judging import Comparison, judge
from jbench.report.analysis.verdicts import verdict_frame
from jbench.report.choices import use_margin
from jbench.report.comparison_tables import verdicts_table
from jbench.report.encoders import prediction_frame, return_frame
from jbench.report.frames import Frames
from jbench.report.headline import headline
from jbench.report.request import Request
from jbench.settings.algorithms import algorithm_settings
from jbench.statistics import permutation
from jbench.statistics.bootstrap import Estimate
from jbench.statistics.verdicts import Evidence
from jbench.studies.quantities import FINAL_RETURN

CLOSE = np.linspace(-10, 10, 8)
FINALS = {
    "full": 600 + CLOSE,
    "scaled16": 620 + CLOSE,
    "planar12": 800 + CLOSE,
    "dae12": 400 + 10 * CLOSE,
    "pca4": 610 + CLOSE,
}


def learn(fabric, finals=FINALS, **more):
    for representation, numbers in finals.items():
        fabric.learn(numbers, representation=representation, **more)


def verdicts(fabric):
    """Returns the verdicts by representation, baseline and claim."""
    configurations = fabric.configurations()[0]
    rows = verdict_frame(
        configurations, decision_frame(recorded_comparisons(configurations))
    ).to_dict("records")
    return {(row["representation"], row["against"], row["claim"]): row for row in rows}


@pytest.mark.slow
def test_each_representation_is_compared_with_both_baselines(fabric):
    learn(fabric)
    found = verdicts(fabric)
    reduced = {(name, base) for name in ("planar", "dae12", "pca4") for base in ("full", "scaled")}
    # scaled against full shows the effect of scaling alone.
    assert {key[:2] for key in found} == {*reduced, ("scaled", "full")}
    words = {key: row["verdict"] for key, row in found.items()}
    assert [words["planar", "full", claim] for claim in "abc"] == ["higher", "undecided", "faster"]
    assert [words["dae12", "full", claim] for claim in "abc"] == [
        "lower",
        "more variable",
        "slower",
    ]
    assert words["pca4", "scaled", "a"] == "similar"
    assert found["planar", "scaled", "a"]["value"] == pytest.approx(180)  # 800 - 620
    # The mean over the whole run is half of the final return.
    assert found["planar", "scaled", "c"]["value"] == pytest.approx(90)
    # The episodes of a run are equal: the standard deviations are those between agents.
    deviation = np.std(CLOSE, ddof=1)
    assert found["dae12", "full", "b"]["value"] == pytest.approx(9 * deviation)
    assert {row["mark"] for key, row in found.items() if key[0] == "planar"} == {"✓", "?"}


def test_verdict_on_return_says_by_how_much(fabric):
    learn(fabric, {name: FINALS[name] for name in ("full", "planar12", "scaled16")})
    found = verdicts(fabric)
    # Two of three comparisons pass their shares on to the similar one: all intervals are of 0.05.
    assert found["planar", "full", "a"]["text"] == "higher by 191 to 209; by more than 50: yes"
    assert found["scaled", "full", "a"]["text"].startswith("similar: higher by 1")
    faster = "faster: mean return over the run higher"
    assert found["planar", "full", "c"]["text"].startswith(faster)


def test_difference_that_excludes_zero_but_not_margin_is_higher(fabric):
    wide = np.linspace(-60, 60, 8)
    learn(fabric, {"full": 600 + wide, "planar12": 680 + wide})
    row = verdicts(fabric)["planar", "full", "a"]
    assert (row["verdict"], row["mark"]) == ("higher", "✓")
    assert 0 < row["low"] < 50 < row["high"]
    assert row["text"].endswith("; by more than 50: undecided")


def test_nothing_is_similar_on_a_task_whose_largest_return_is_unknown(fabric):
    # Returns of gym:Reacher-v5 are from -60 to -3: the first agents are ten times worse.
    few = np.linspace(-0.5, 0.5, 8)
    task = {"task": "gym:Reacher-v5"}
    learn(fabric, {"full": few - 4, "scaled11": few - 4.1, "dae12": few - 40}, **task)
    found = verdicts(fabric)
    assert found["dae12", "full", "a"]["verdict"] == "lower"
    assert found["scaled", "full", "a"]["verdict"] == "undecided"
    # A difference from 0 does not say that returns are not similar.
    configurations, _ = fabric.configurations()
    (finding,) = [found for found in examine(configurations) if found.claim == "a"]
    assert finding.decided.verdict == "undecided"
    use_margin(configurations, 2.0)
    (finding,) = [found for found in examine(configurations) if found.claim == "a"]
    assert finding.decided.verdict == "contradicted"


def test_typed_margin_makes_returns_similar_where_their_range_is_unknown(fabric):
    # The scaled agents differ by 0.1, the others by 36; seeds differ by up to 1.
    few = np.linspace(-0.5, 0.5, 8)
    task = {"task": "gym:Reacher-v5"}
    learn(fabric, {"full": few - 4, "scaled11": few - 4.1, "dae12": few - 40}, **task)
    frames = Frames(fabric.results, Request(margin=2.0))
    rows = frames.verdicts[frames.verdicts["claim"] == "a"].set_index("representation")
    assert rows["verdict"].to_dict() == {"scaled": "similar", "dae12": "lower"}
    assert "Similar: within 2." in verdicts_table(frames).caption


def test_margin_is_refused_where_the_range_of_returns_is_known(fabric):
    learn(fabric, {"full": FINALS["full"]})
    with pytest.raises(RequestError, match=r"--margin 9: .* similar within 50; leave --margin out"):
        Frames(fabric.results, Request(margin=9.0))


def test_claim_without_a_verdict_of_similarity_corrects_for_all_others(fabric):
    # Nothing is decided, so all three intervals of (b), of two comparisons, are those of 0.05 / 2.
    learn(fabric, {name: 600 + np.linspace(-9, 9, 8) for name in ("full", "pca4", "dae4")})
    rows = verdicts(fabric)
    row = rows["pca4", "full", "b"]
    assert (row["verdict"], row["corrected_by"]) == ("undecided", "Holm, 2 comparisons")
    assert row["corrected_low"] < row["low"] < 0 < row["high"] < row["corrected_high"]


def test_every_verdict_is_corrected_for_the_others(fabric):
    # The difference excludes 0 by itself, but not as one of many.
    near = FINALS["full"] + np.linspace(0, 9, 8) - 1
    learn(fabric, {"full": FINALS["full"], "pca4": near + 4}, algo="sac")
    alone = verdicts(fabric)["pca4", "full", "c"]
    assert (alone["verdict"], alone["corrected_by"]) == ("undecided", "")
    learn(fabric)
    found = verdicts(fabric)
    assert {row["corrected_by"] for row in found.values()} == {"Holm, 8 comparisons"}
    for row in found.values():
        assert row["corrected_low"] <= row["low"] <= row["high"] <= row["corrected_high"]


def test_similar_comparison_passes_nothing_on():
    # Differences with a standard error of 10 are normal: similar within 30 at any rate, and one
    # with a p-value of 0.03, which is undecided as one of two comparisons.
    def compared(value):
        def estimate(confidence):
            half = 10 * scipy.stats.norm.ppf((1 + confidence) / 2)
            return Estimate(value, value - half, value + half)

        def p_value(shift):
            return 2 * scipy.stats.norm.sf(abs(value + shift) / 10)

        return Comparison(FINAL_RETURN, {}, Evidence(estimate, p_value, seeds=6, margin=30))

    value = 10 * scipy.stats.norm.isf(0.03 / 2)
    family = [compared(0.0), compared(60 + value), compared(value)]
    words = [judgment.word for judgment in judge(family[:1] + family[2:])]
    assert words == ["similar", "undecided"]
    # A third comparison with a direction passes its share on: 0.05 / 2 again.
    judgments = judge(family)
    assert [judgment.word for judgment in judgments] == ["similar", "higher", "undecided"]
    assert judgments[2].low == pytest.approx(value - 10 * scipy.stats.norm.isf(0.0125))


@pytest.mark.slow
def test_permutation_test_confirms_a_verdict(fabric):
    # Six seeds each, all higher: an exact test has a p-value of 2 / 924 = 0.0022.
    names = [f"pca{latents}" for latents in range(2, 14)]
    higher = [600.0 + seed for seed in range(6)]
    equal = [100.0 + seed for seed in range(6)]
    learn(fabric, {"full": equal, **dict.fromkeys(names[:1], higher)})
    assert verdicts(fabric)["pca2", "full", "a"]["verdict"] == "higher"

    # As one of 25 comparisons it needs 0.05 / 25 = 0.002, whatever its interval.
    learn(fabric, dict.fromkeys(names[1:], equal) | {"scaled": equal})
    row = verdicts(fabric)["pca2", "full", "a"]
    assert row["corrected_low"] > 0
    assert row["verdict"] == "undecided"
    assert row["text"].endswith("; p = 0.0022, too large for a verdict")


@pytest.mark.slow
def test_failed_seeds_that_lower_the_mean_do_not_confirm_a_higher_interquartile_mean(
    fabric, monkeypatch
):
    monkeypatch.setattr(permutation, "RELABELINGS_OF_TEN_SEEDS", 2000)
    # All eight failures are on one side by chance in 2 (60 over 8) / (120 over 8) = 0.6% of cases.
    failing = [860.0] * 52 + [0.0] * 8
    learn(fabric, {"full": [800.0] * 60, "planar12": failing})
    row = verdicts(fabric)["planar", "full", "a"]
    assert (row["value"], row["low"], row["verdict"]) == (60, 60, "undecided")


def test_listed_comparison_has_the_verdict_of_the_sequential_test(fabric):
    published = algorithm_settings("td3").model_dump(mode="json")
    steps = {"steps": 100_000, "engine": "batched", "hyperparameters": published}
    for seeds, verdict in ((5, "undecided"), (10, "higher")):
        for name, level in (("full", 300.0), ("planar12", 700.0)):
            for seed in range(seeds - 5, seeds):
                final = level + 10 * seed
                more = {"representation": name, "evaluated": {100_000: final}}
                fabric.run([final] * 100, seed, **steps, **more)
        found = Frames(fabric.results)
        (decision,) = found.decisions.to_dict("records")
        shown = found.verdicts.query("claim == 'a' and returns == 'evaluation'")
        row = shown.iloc[0]
        assert decision["seeds"] == seeds
        # All ten labels of a block have to be right: 1 / 252 is more than the share of 0.001.
        assert decision["verdict"] == row["verdict"] == verdict
        assert row["corrected_by"] == "sequential test"
    assert found.pairs["decided"].all()


def test_few_seeds_are_undecided(fabric):
    learn(fabric, {name: FINALS[name][:5] for name in ("full", "planar12")})
    assert {row["verdict"] for row in verdicts(fabric).values()} == {"undecided"}


def test_variation_of_episodes_alone_decides_nothing(fabric):
    # Means of few episodes differ as much as the episodes themselves let expect.
    random = np.random.default_rng(0)
    for representation, deviation in {"full": 100.0, "planar12": 5.0}.items():
        for seed in range(8):
            returns = 500 + deviation * random.normal(size=80)
            fabric.run(returns, seed, representation=representation)
    assert verdicts(fabric)["planar", "full", "b"]["verdict"] == "undecided"


def test_configurations_with_other_differences_are_not_compared(fabric):
    learn(fabric, {"full": FINALS["full"]})
    for seed, final in enumerate(FINALS["planar12"]):
        fabric.run([0.0, final], seed, representation="planar12", engine="batched")
    assert verdicts(fabric) == {}
    assert return_frame(fabric.configurations()[0]).empty


def test_final_returns_are_those_at_common_step(fabric):
    learn(fabric, {name: FINALS[name] for name in ("full", "planar12")})
    learn(fabric, {"random12": 500 + CLOSE}, episodes=20)
    rows = return_frame(fabric.configurations()[0]).to_dict("records")
    found = {row["representation"]: row for row in rows}
    assert {*found} == {"full", "planar"}  # random12 has not reached it
    assert {row["steps"] for row in found.values()} == {80_000}
    # The interquartile mean of final returns that are symmetric about 800.
    assert found["planar"]["iqm"] == pytest.approx(800)
    assert 790 < found["planar"]["low"] < 800 < found["planar"]["high"] < 810


@pytest.mark.slow
def test_returns_stand_beside_r2_of_predictions(fabric):
    learn(fabric)
    r2 = {"planar": 0.9, "dae12": 0.4, "pca4": -0.2, "vae8": 0.5}
    table = pd.DataFrame({"representation": [*r2], "yaw_rate": [*r2.values()]})
    table = table.assign(task="face_direction", forward_speed=0.7, tilt_rate=0.6, reward=0.5)
    configurations = fabric.configurations()[0]
    found = prediction_frame(configurations, table)
    assert [*found["quantity"].unique()] == ["yaw rate", "forward speed", "tilt rate", "reward"]
    yaw = found[found["quantity"] == "yaw rate"].set_index("representation")
    assert yaw["r2"].to_dict() == {"planar": 0.9, "dae12": 0.4, "pca4": -0.2}
    assert yaw["iqm"].to_dict() == pytest.approx({"planar": 800, "dae12": 400, "pca4": 610})
    # With two encoders named dae12, only two representations remain, too few for a figure.
    twice = pd.concat([table, table[table["representation"] == "dae12"]])
    assert prediction_frame(configurations, twice).empty


def test_headline_names_what_was_decided(fabric):
    learn(fabric, {name: FINALS[name] for name in ("full", "planar12", "dae12")})
    assert Frames(fabric.results).headline == (
        "Compared with the full observation, TD3 agents on face_direction reach higher final "
        "returns with planar; lower ones with dae12."
    )


def test_headline_of_few_seeds_says_that_it_is_too_early(fabric):
    learn(fabric, {name: FINALS[name][:2] for name in ("full", "dae12")}, episodes=4)
    assert Frames(fabric.results).headline == (
        "Too early to say: 2 seeds of 4k control steps can't decide anything."
    )


def test_headline_of_few_seeds_has_what_a_study_has_decided(fabric):
    learn(fabric, {name: FINALS[name][:5] for name in ("full", "dae12")}, episodes=4)
    found = Frames(fabric.results)
    verdicts = found.lead(found.verdicts)
    decided = verdicts.assign(verdict=verdicts["verdict"].where(verdicts["claim"] != "a", "lower"))
    configurations = found.lead(found.configurations)
    assert headline(decided, configurations, pd.DataFrame()) == (
        "Compared with the full observation, TD3 agents on face_direction reach lower final "
        "returns with dae12."
    )


def test_headline_of_few_seeds_has_the_steps_of_these_seeds(fabric):
    fabric.flat(range(5), episodes=4)
    fabric.flat([1], algo="sac", episodes=40)
    assert Frames(fabric.results).headline == (
        "Too early to say: 5 seeds of 4k control steps can't decide anything."
    )


def test_headline_names_no_verdict_of_one_variant_alone(fabric):
    learn(fabric, {name: FINALS[name] for name in ("full", "planar12")})
    names = {"full": FINALS["full"], "planar12": FINALS["full"]}
    other = {"learning_rate": 1e-3, "batch_size": 256}
    learn(fabric, names, hyperparameters=other)
    assert Frames(fabric.results).headline == (
        "Whether TD3 agents on face_direction learn as well on a reduced observation is undecided."
    )


def test_headline_names_task_where_answer_depends_on_it(fabric):
    learn(fabric, {name: FINALS[name] for name in ("full", "planar12")})
    names = {"full": FINALS["full"], "planar12": FINALS["full"]}
    learn(fabric, names, task="move_in_direction")
    assert Frames(fabric.results).headline == (
        "Compared with the full observation, TD3 agents reach higher final returns with planar on "
        "face_direction; reach similar final returns with planar on move_in_direction."
    )
