"""Tests of the verdicts on the paper's claims, with fabricated runs of known outcome."""

import math
import re

import numpy as np
import pytest

from jbench.report.analysis.claims import examine, examine_solving
from jbench.report.analysis.findings import ClaimVerdict, claim_verdict
from jbench.report.choices import use_margin
from jbench.report.data.untrained import random_return
from jbench.statistics.bootstrap import Estimate


def findings(fabric, letter):
    return [f for f in examine(fabric.configurations()[0]) if f.claim == letter]


NARROW = 700 + np.linspace(-10, 10, 10)
WIDE = 700 + np.linspace(-200, 200, 10)


def test_equal_returns_and_smaller_spread_are_supported(fabric):
    fabric.learn(WIDE)
    fabric.learn(NARROW, representation="dae12")
    (similar,) = findings(fabric, "a")
    assert similar.effect.value == pytest.approx(0, abs=1e-9)
    (spread,) = findings(fabric, "b")
    assert spread.effect.value == pytest.approx(0.05)  # 10 / 200
    assert (spread.decided.verdict, spread.seeds, spread.decided.seeds_needed) == (
        "supported",
        10,
        None,
    )
    assert spread.compared == "face_direction TD3 dae12 against full"


def test_different_returns_and_larger_spread_are_contradicted(fabric):
    fabric.learn(NARROW)
    fabric.learn(WIDE + 300, representation="dae12")
    assert [f.decided.verdict for f in findings(fabric, "a")] == ["contradicted"]
    assert [f.decided.verdict for f in findings(fabric, "b")] == ["contradicted"]
    # Faster: the mean over all episodes is half of the final return, so 150 more.
    (faster,) = findings(fabric, "c")
    assert faster.decided.verdict == "supported"
    assert faster.effect.value == pytest.approx(150)


RANDOM = random_return("face_direction")
NEAR = np.full(10, math.floor(RANDOM + 50))
FAR = np.full(10, math.ceil(RANDOM + 50))


@pytest.mark.parametrize(
    ("easier", "gain", "gain_on_harder", "verdict", "remark"),
    [
        (NARROW, 20, 100, "supported", ""),
        pytest.param(
            *(NARROW, -200, -20, "undecided", "nothing is gained on move_in_direction (-10)"),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            *(NEAR, 0, 100, "undecided", f"within 50 of random actions ({RANDOM:.0f})"),
            marks=pytest.mark.slow,
        ),
        pytest.param(FAR, 0, 100, "supported", "", marks=pytest.mark.slow),
    ],
)
def test_larger_gain_on_harder_task(fabric, easier, gain, gain_on_harder, verdict, remark):
    fabric.learn(easier)
    fabric.learn(easier + gain, representation="dae12")
    fabric.learn(NARROW, task="move_in_direction")
    fabric.learn(NARROW + gain_on_harder, task="move_in_direction", representation="dae12")
    (found,) = findings(fabric, "d")
    assert found.effect.value == pytest.approx(0.5 * (gain_on_harder - gain))
    assert found.effect.low > 0
    assert (found.decided.verdict, found.decided.seeds_needed) == (verdict, None)
    assert remark in found.remark
    assert ("gained" in found.remark or "random" in found.remark) == bool(remark)


def test_gains_on_two_tasks_are_compared_up_to_one_control_step(fabric):
    # All learn after 40 episodes, and those on the easier task go on for twice as long.
    for gain, name in ((0, "full"), (100, "dae12")):
        fabric.learn(NARROW + gain, task="move_in_direction", representation=name)
        for seed, final in enumerate(NARROW + gain):
            fabric.run(np.repeat([0.0, final], [40, 120]), seed, representation=name)

    (found,) = findings(fabric, "d")
    assert found.effect.value == pytest.approx(0.5 * 100 - 0.5 * 100)
    assert (found.decided.verdict, found.steps) == ("undecided", 80_000)
    assert found.remark == "at 80k of 160k control steps, the last that every seed has"


def test_agents_without_finite_returns_have_no_gain(fabric):
    for task in ("face_direction", "move_in_direction"):
        fabric.learn(NARROW, task=task)
        fabric.learn([np.nan] * 6, task=task, representation="dae12", status="failed")
    (found,) = findings(fabric, "d")
    assert found.remark == "no verdict, some agents have no finite return"


def test_no_return_is_similar_where_nothing_says_how_near_it_must_be(fabric):
    for gain, name in ((0, "full"), (100, "dae12")):
        fabric.learn(NARROW + gain, task="gym:Reacher-v5", representation=name)

    (found,) = findings(fabric, "a")
    assert found.effect.value == pytest.approx(100)
    assert found.decided == ClaimVerdict("undecided")
    assert found.remark.endswith("type --margin")

    configurations, _ = fabric.configurations()
    use_margin(configurations, 150.0)
    (found, *_) = examine(configurations)
    assert (found.decided.verdict, found.remark) == ("supported", "")


@pytest.mark.parametrize(("swing", "verdict"), [(0.0, "supported"), (250.0, "undecided")])
def test_ratio_that_episodes_explain_is_undecided(fabric, swing, verdict):
    # The means of full have a deviation of 67. Twenty episodes that swing by 250 cause 57 of it,
    # which leaves 35 for the agents, and their interval begins at 0.
    for seed, mean in enumerate(700 + np.linspace(-100, 100, 10)):
        fabric.run(mean + np.resize([swing, -swing], 80), seed)
    fabric.learn(NARROW, algo="td3", representation="dae12")
    (spread,) = findings(fabric, "b")
    assert spread.effect.value == pytest.approx(0.1)
    assert spread.effect.high < 1
    assert spread.decided.verdict == verdict
    assert ("of the agents alone: difference -28 [" in spread.remark) == (verdict == "undecided")


def test_failed_agents_alone_do_not_decide_on_variability(fabric):
    # Four of ten fail. Chance puts the four largest deviations of 20 into one group of ten in
    # 2 * C(16, 6) / C(20, 10) = 8.7% of cases; not in all of them is the difference as large.
    fabric.learn(np.append(800 + np.linspace(-40, 40, 6), [200] * 4))
    fabric.learn(800 + np.linspace(-140, 140, 10), representation="dae12")
    (spread,) = findings(fabric, "b")
    assert spread.effect.high < 1
    assert spread.decided.verdict == "undecided"
    found = re.fullmatch(r"not confirmed by a permutation test: p = (0\.\d+)", spread.remark)
    assert 0.05 < float(found[1]) <= 0.087


def test_off_policy_algorithms_are_compared_with_ppo(fabric):
    fabric.learn(WIDE + 200, algo="td3")
    fabric.learn(NARROW, algo="ppo")
    (higher,) = findings(fabric, "e")
    assert (higher.effect.value, higher.decided.verdict) == (pytest.approx(200), "supported")
    (wider,) = findings(fabric, "f")
    assert (wider.effect.value, wider.decided.verdict) == (pytest.approx(20), "supported")


def test_solved_tasks_are_supported_and_unsolved_contradicted(fabric):
    fabric.learn(NARROW + 250, algo="sac")  # 940 to 960
    fabric.learn(NARROW, algo="td3")
    verdicts = {f.compared.split()[1]: f.decided.verdict for f in findings(fabric, "g")}
    assert verdicts == {"SAC": "supported", "TD3": "contradicted"}
    returns = np.linspace(880, 990, 100)
    assert examine_solving("h", "move_to_pose", returns).decided.verdict == "supported"
    assert examine_solving("h", "move_to_pose", returns - 200).decided.verdict == "contradicted"
    almost = examine_solving("h", "move_to_pose", np.full(6, 899.6))
    assert almost.decided.verdict == "contradicted"


def test_configurations_of_other_robots_or_algorithms_are_not_compared(fabric):
    fabric.learn(NARROW)
    fabric.learn(NARROW, representation="dae12", augment=3)
    fabric.learn(NARROW, algo="ppo", representation="dae12")
    fabric.learn(NARROW, augment=0, robots=2)
    assert not findings(fabric, "a")
    assert not findings(fabric, "e")
    unchanged = ["face_direction PPO dae12", "face_direction TD3 full"]
    assert [found.compared for found in findings(fabric, "g")] == unchanged


def test_seeds_needed_for_ratio_use_its_logarithm():
    # ln 0.8 = -0.223 of a standard error of 0.2 / 0.8 = 0.25: (2.8016 * 0.25 / 0.223)^2 = 9.85.
    effect = Estimate(0.8, 0.5, 1.2, 0.2)
    decided = claim_verdict(effect, 10, 1.0, logarithmic=True)
    assert decided == ClaimVerdict("undecided", 99, "80% power")
