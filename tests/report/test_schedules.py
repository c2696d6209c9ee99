"""Comparisons of sides that were evaluated at different control steps say so."""

import json

import numpy as np
import pytest

from jbench.cli import main
from jbench.report.analysis.pair import Pair
from jbench.report.analysis.schedules import nothing_in_common, remark_on_schedules
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.returns import EVALUATION, TRAINING
from jbench.studies.quantities import FINAL_RETURN, SPEED

FLAT = np.full(40, 100.0)  # episodes of 1000 control steps
INTERPOLATED = "evaluated at different control steps, so means are of interpolated returns"


def learn(fabric, representation, steps, seeds=6, **settings):
    """Adds seeds whose evaluations at some control steps have the return 10 for each 1000."""
    for seed in range(seeds):
        evaluated = {at: at / 100 + seed for at in steps}
        fabric.run(FLAT, seed, representation=representation, evaluated=evaluated, **settings)


def made_pair(fabric, kind=EVALUATION):
    full, encoded = fabric.configurations(kind)[0]
    return Pair(encoded, full)


def test_last_evaluations_at_different_steps_are_named(fabric):
    learn(fabric, "full", [10_000, 20_000, 30_000])
    learn(fabric, "dae12", [15_000, 25_000])
    pair = made_pair(fabric)
    # Up to 25,000 control steps, the full observation was last evaluated at 20,000.
    assert pair.control_steps == 25_000
    found = remark_on_schedules(pair, FINAL_RETURN)
    assert found == "evaluated at different control steps, here at 25k and 20k"
    assert remark_on_schedules(pair, SPEED) == INTERPOLATED
    # Training returns are those of each episode.
    assert remark_on_schedules(made_pair(fabric, TRAINING), FINAL_RETURN) == ""


def test_equal_ends_and_nearly_equal_ones_need_no_remark(fabric):
    learn(fabric, "full", [10_000, 20_000, 30_000])
    learn(fabric, "dae12", [15_000, 30_200])  # an evaluation after the episode that ends training
    pair = made_pair(fabric)
    assert remark_on_schedules(pair, SPEED) == INTERPOLATED
    assert remark_on_schedules(pair, FINAL_RETURN) != ""  # up to 30,000: 15,000 and 30,000
    assert remark_on_schedules(Pair(*pair.sides, 30_200), FINAL_RETURN) == ""


def test_longer_runs_with_the_same_schedule_need_no_remark(fabric):
    learn(fabric, "full", [10_000, 20_000, 30_000, 40_000])
    learn(fabric, "dae12", [10_000, 20_000])
    for quantity in (FINAL_RETURN, SPEED):
        assert remark_on_schedules(made_pair(fabric), quantity) == ""


def test_page_terminal_and_json_say_it(fabric, out, capsys):
    learn(fabric, "full", [10_000, 20_000, 30_000])
    learn(fabric, "dae12", [15_000, 25_000])
    typed = ["report", "--results", str(fabric.results.path), "--out", str(out), "--format", "svg"]
    assert main(typed) == 0
    printed = " ".join("".join(capsys.readouterr()).split())
    note = (
        "Sides that were not evaluated alike are compared in 3 verdicts, such as face_direction "
        "TD3 dae12 against full: evaluated at different control steps, here at 25k and 20k."
    )
    assert note in printed
    page = (out / "index.html").read_text()
    assert note in page
    assert "here at 25k and 20k</small>" in page  # in the cell of the verdict
    assert INTERPOLATED in (out / "tables" / "verdicts.md").read_text()

    assert main([*typed, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    shown = [row for row in document["verdicts"] if row["returns"] == EVALUATION]
    remarks = {row["claim"]: row["remark"] for row in shown}
    assert remarks["c"] == INTERPOLATED
    assert remarks["a"].endswith("here at 25k and 20k")
    assert any(note in sentence for sentence in document["notes"])


def test_two_sides_say_it_in_their_verdict(fabric):
    learn(fabric, "full", [10_000, 20_000, 30_000])
    learn(fabric, "full", [15_000, 25_000], algo="sac")
    found = Frames(fabric.results, Request(compare=("algo=td3", "algo=sac"))).comparisons
    (text,) = found[found["returns"] == EVALUATION]["text"]
    assert text.endswith("; evaluated at different control steps, here at 20k and 25k")
    (text,) = found[found["returns"] == TRAINING]["text"]
    assert "evaluated" not in text


@pytest.mark.parametrize("first", [["algo=td3", "algo=sac"], ["algo=sac", "algo=td3"]])
def test_sides_without_a_common_step_are_refused(first, fabric, out, capsys):
    for algo, episodes in (("td3", 40), ("sac", 20)):
        for seed in range(6):
            ends = 1000 * np.arange(1, episodes + 1) + (30_000 if algo == "td3" else 0)
            evaluated = {int(ends[-1]): 100.0}
            fabric.run(FLAT[:episodes], seed, algo=algo, ends=ends, evaluated=evaluated)

    options = ["--results", str(fabric.results.path), "--out", str(out)]
    assert main(["report", "--compare", *first, *options]) == 2
    error = " ".join(capsys.readouterr().err.split())
    assert "can be compared: nothing in common, the first return of algo=td3: " in error
    assert "ends at 20k" in error
    assert not out.exists()


def test_a_verdict_without_a_common_step_says_so(fabric):
    learn(fabric, "full", [30_000, 40_000])
    learn(fabric, "dae12", [10_000, 20_000])
    pair = made_pair(fabric)
    reason = (
        "nothing in common, the first return of face_direction TD3 full is at 30k control steps, "
        "and face_direction TD3 dae12 ends at 20k"
    )
    assert nothing_in_common(pair) == reason
    verdicts = Frames(fabric.results).verdicts
    shown = verdicts[(verdicts["returns"] == EVALUATION) & (verdicts["claim"] == "a")]
    assert shown["text"].tolist() == [f"undecided: unknown; {reason}"]


def test_an_unknown_variability_says_why(fabric):
    for name in ("full", "dae12"):
        fabric.flat([500] * 6, episodes=4, representation=name)

    found = Frames(fabric.results).verdicts.set_index("claim")["text"]
    # A quarter of four episodes is one, whose deviation is unknown.
    assert found["b"] == (
        "undecided: unknown, since face_direction TD3 dae12 has final returns of a single episode, "
        "which do not tell how much the episodes of an agent vary"
    )


def test_a_side_without_a_finite_return_says_so(fabric):
    fabric.flat([500] * 6)
    fabric.flat([np.nan] * 6, representation="dae12")
    (text,) = Frames(fabric.results).verdicts.query("claim == 'a'")["text"]
    assert text == (
        "undecided: unknown; nothing in common, no return of face_direction TD3 dae12 is a finite "
        "number"
    )
