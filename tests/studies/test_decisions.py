"""Sweep and report decide a comparison alike: from the same runs, by the same returns."""

import csv
import re
from types import SimpleNamespace

import numpy as np
import pytest

from jbench.cli import main
from jbench.report.analysis.decisions import decision_frame, recorded_comparisons
from jbench.studies.deciding import decide
from jbench.studies.entries import read_entries
from jbench.studies.matrix import read_matrix
from jbench.studies.study import listed_comparisons
from jbench.sweeps.cell import matrix_cells
from jbench.sweeps.outcomes import next_cells, outcomes
from tests.report.conftest import FabricatedResults, evaluations
from tests.report.conftest import episodes as training_episodes

STUDY = """
tasks = ["face_direction"]
algos = ["td3"]
representations = ["full", "planar"]
steps = 40_000
seeds = "0-9"

[evaluation]
every = 10_000

[[comparison]]
task = "face_direction"
algo = "td3"
first = "planar"
second = "full"
claim = "{claim}"
max_seeds = 10
"""

TRAINED = np.linspace(0, 390, 40)  # training returns; the mean of the last quarter is 345
RISING = {10_000: 100.0, 20_000: 200.0, 30_000: 300.0, 40_000: 400.0}


@pytest.fixture
def decided(tmp_path):
    """Returns a function: what sweep and report decide on the comparison of a study.

    `fill` adds the runs of a cell: it takes the record, its settings, and whether it is `planar`.
    The first five seeds are enough for a decision.
    """

    def both(claim, fill, seeds=5):
        fabric = FabricatedResults(tmp_path / "results")
        file = tmp_path / "study.toml"
        file.write_text(STUDY.format(claim=claim))
        parts = read_matrix(str(file))
        comparisons = listed_comparisons(parts, read_entries(str(file)))
        cells = matrix_cells(parts, fabric.results)
        for cell in cells:
            for run in cell.runs[:seeds]:
                fill(fabric.results, run, cell.representation == "planar")
        (outcome,) = outcomes(comparisons, cells, fabric.results)
        configurations = [c for kind in ("training", "evaluation") for c in _all(fabric, kind)]
        rows = decision_frame(recorded_comparisons(configurations, {"study": comparisons}))
        return outcome, rows.to_dict("records")

    return both


def _all(fabric, kind):
    return fabric.configurations(kind)[0]


def finish(results, run, evaluated, trained=TRAINED, is_finished=True):
    record = results.create("run", run.id, run.model_dump(mode="json"))
    tables = {"episodes": training_episodes(run.id, trained)}
    if evaluated:
        tables["evaluations"] = evaluations(run.id, evaluated)
    record.append(tables)
    if is_finished:
        record.finish({"wall_time": 1.0})


def test_report_decides_the_comparisons_of_a_file(decided, undrawn, tmp_path, capsys):
    """Of returns 500 to 504 against 400, the difference of the means is 102."""

    def fill(results, run, is_planar):
        end = 500.0 + run.seed if is_planar else 400.0
        finish(results, run, {**RISING, 40_000: end})

    outcome, _ = decided("a", fill)
    study = tmp_path / "study.toml"
    typed = ["--results", str(tmp_path / "results"), "--format", "svg"]
    capsys.readouterr()
    assert main(["report", "--study", str(study), *typed]) == 0
    assert re.search(r"study .* planar .* full .* higher .* 5 .* \+102 \[", capsys.readouterr().out)
    tables = tmp_path / "results" / "report" / "tables"
    (row,) = csv.DictReader((tables / "sequential_test.csv").open())
    assert (row["study"], row["verdict"], row["seeds"]) == ("study", "higher", "5")
    assert float(row["difference"]) == outcome.decision.difference == 102


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        (('claim = "a"', 'claim = "d"'), "comparison 1: claim of [[comparison]] can't be 'd'"),
        (('first = "planar"', 'first = "planer"'), "comparison 1: the matrix has no planer and"),
    ],
)
def test_wrong_comparison_is_refused_before_anything_is_trained(changed, says, tmp_path, refused):
    (tmp_path / "results").mkdir()
    file = tmp_path / "study.toml"
    file.write_text(STUDY.format(claim="a").replace(*changed))
    for typed in (["sweep", file], ["sweep", file, "--dry-run"], ["report", "--study", file]):
        assert says in refused(*typed, results=tmp_path / "results")


@pytest.mark.parametrize(
    ("claim", "difference", "word"),
    [
        ("a", 102, "higher"),  # 500 to 504 against 400
        ("c", 27, "faster"),  # a fourth of 100, and 0 to 4 at each of four evaluations
    ],
)
def test_final_returns_or_means_over_the_run_are_decided(claim, difference, word, decided):
    def fill(results, run, is_planar):
        end = 500.0 + run.seed if is_planar else 400.0
        more = run.seed if is_planar else 0
        by_step = {step: value + more for step, value in RISING.items()}
        finish(results, run, {**by_step, 40_000: end})

    outcome, (row,) = decided(claim, fill)
    assert outcome.decision.difference == pytest.approx(difference)
    assert (outcome.decision.verdict, outcome.decision.seeds) == ("larger", 5)
    numbers = ("seeds", "difference", "low", "high", "spent")
    assert [row[name] for name in numbers] == [getattr(outcome.decision, name) for name in numbers]
    assert (row["verdict"], row["claim"], row["returns"]) == (word, claim, "evaluation")


def test_mean_over_the_run_is_that_of_a_seed_alone(decided):
    def fill(results, run, is_planar):
        last = 90.0 if is_planar else 0.0
        evaluated = {10_000: 0.0, 20_000: float(run.seed), 25_000: last}
        if run.seed == 5:  # an unfinished run that has just begun
            finish(results, run, {10_000: 0.0}, TRAINED[:10], is_finished=False)
        else:
            finish(results, run, evaluated)

    outcome, (row,) = decided("c", fill, seeds=6)
    assert outcome.decision.difference == row["difference"] == pytest.approx(30)
    assert outcome.decision.seeds == row["seeds"] == 5


def test_means_over_the_run_of_other_evaluations_decide_nothing(decided):
    """Their curves are equal, but the mean of the points from 20,000 on is higher."""

    def fill(results, run, is_planar):
        returns = {step: value + run.seed for step, value in RISING.items()}
        if is_planar:
            run = run.model_copy(update={"evaluate_every": 20_000})
            returns = {step: returns[step] for step in (20_000, 40_000)}
        finish(results, run, returns)

    _, rows = decided("c", fill)
    assert rows == []
    # The final returns are of the same control step.
    _, (row,) = decided("a", lambda *_: None)
    assert row["difference"] == 0


def test_runs_without_evaluations_are_decided_by_their_training_returns(decided):
    def fill(results, run, is_planar):
        finish(results, run, {}, TRAINED + run.seed + (300 if is_planar else 0))

    outcome, (row,) = decided("a", fill)
    assert outcome.decision.difference == row["difference"] == pytest.approx(300)
    assert (row["verdict"], row["returns"]) == ("higher", "training")


@pytest.mark.parametrize(("evaluated", "kind"), [(0, "training"), (5, "evaluation")])
def test_evaluations_are_not_compared_with_training(evaluated, kind, decided):
    """Evaluation returns of all are 400, and training returns, with exploration, 345."""

    def fill(results, run, is_planar):
        # Of full, the first seeds were evaluated. Seeds vary so much that five decide nothing.
        varied = 400.0 * (run.seed % 2)
        returns = {step: value + varied for step, value in RISING.items()}
        has_evaluations = is_planar or run.seed < evaluated
        finish(results, run, returns if has_evaluations else {}, TRAINED + varied)

    _, (row,) = decided("a", fill, seeds=10)
    assert (row["returns"], row["difference"], row["verdict"]) == (kind, 0, "undecided")
    # A seed that was not evaluated ends the comparison of evaluations.
    assert row["seeds"] == (evaluated or 10)


@pytest.mark.parametrize("claim", [pytest.param("a", marks=pytest.mark.slow), "c"])
def test_returns_that_are_not_finite_are_left_out_and_a_run_without_others_stops(claim, decided):
    def fill(results, run, is_planar):
        # Seeds vary so much that five of them decide nothing.
        missing = is_planar and run.seed == 7
        returns = {step: value + 400 * (run.seed % 2) for step, value in RISING.items()}
        finish(results, run, dict.fromkeys(RISING, np.nan) if missing else returns)

    outcome, (row,) = decided(claim, fill, seeds=10)
    assert outcome.decision.seeds == row["seeds"] == 5
    assert "planar12/s07" in outcome.unknown
    assert next_cells([outcome], ()) == []


def test_first_seeds_end_at_the_first_gap():
    comparison = SimpleNamespace(margin=50.0, share=0.05, max_seeds=10)
    known = {seed: 100.0 * seed for seed in range(10)}  # which vary too much for a decision
    gap = {seed: value for seed, value in known.items() if seed != 6}
    unknown = {**known, 4: None}
    seeds = [decide([comparison], [(known, other)])[0].seeds for other in (known, gap, unknown, {})]
    assert seeds == [10, 5, 0, 0]


@pytest.mark.parametrize(
    ("margin", "verdicts"), [(2.0, ["equal", "larger"]), (0.0, ["undecided", "larger"])]
)
def test_sides_are_similar_only_within_a_margin(margin, verdicts):
    comparison = SimpleNamespace(margin=margin, share=0.05, max_seeds=10)
    near = {seed: -4.0 - seed / 10 for seed in range(10)}
    far = {seed: value - 36.0 for seed, value in near.items()}
    found = [decide([comparison], [(near, other)])[0].verdict for other in (near, far)]
    assert found == verdicts
