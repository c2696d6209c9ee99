"""Tests of `jbench sweep --until-decided`, which adds seeds until comparisons are decided."""

import json
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from jbench.errors import RequestError
from jbench.store import Results, schema
from jbench.studies.comparisons import comparisons
from jbench.studies.entries import read_entries
from jbench.studies.matrix import only, read_matrix
from jbench.sweeps.cell import matrix_cells
from jbench.sweeps.outcomes import next_cells, outcomes, recorded_return
from tests.command_line import succeed
from tests.store.store_rows import episodes

MATRIX = """
tasks = ["face_direction"]
seeds = "0-1"
steps = 1000

[evaluation]
every = 1000
episodes = 1

[dataset]
steps = 2000

[hyperparameters.td3]
hidden_layers = [8]
batch_size = 16
learning_starts = 500
train_freq = 100
gradient_steps = 1

[[part]]
algos = ["td3"]
representations = ["full", "pca3", "random2"]

[[part]]
algos = ["ddpg"]
"""


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results")


@pytest.fixture
def read(tmp_path, results):
    """Returns a function: the sweep of a matrix of 30 seeds."""

    def written(text=MATRIX):
        file = tmp_path / "small.toml"
        file.write_text(text)
        parts = read_matrix(str(file), seeds=range(30))
        return Sweep(results, parts, read_entries(str(file)), matrix_cells(parts, results))

    return written


@dataclass
class Sweep:
    """A matrix, its cells, and what it decides."""

    results: Results
    parts: Any
    entries: Any
    cells: list

    def comparisons(self, typed=(), most=30):
        return comparisons(self.parts, self.entries, typed, most)

    def outcomes(self, typed=(), most=30):
        return outcomes(self.comparisons(typed, most), self.cells, self.results)


@pytest.fixture
def matrix(read):
    return read()


@pytest.fixture
def cells(matrix):
    return matrix.cells


def finish(results, run, returns, evaluations=2):
    """Adds a finished run whose last evaluation has these returns."""
    record = results.create("run", run.id, run.model_dump(mode="json"))
    rows = [
        {"run": run.id, "evaluation": which, "control_steps": 500 * (which + 1), "length": 1000}
        | {"episode": episode, "episode_return": value if which == evaluations - 1 else -1.0}
        for which in range(evaluations)
        for episode, value in enumerate(returns)
    ]
    tables = {"episodes": episodes(run.id, [10.0 * n for n in range(8)])}
    if rows:
        tables["evaluations"] = pa.Table.from_pylist(rows, schema.EVALUATIONS)
    record.append(tables)
    record.finish({"wall_time": 1.0, "steps_done": run.steps})
    return record


def fill(results, cell, numbers):
    for seed, number in enumerate(numbers):
        finish(results, cell.runs[seed], [number - 10, number + 10])


def seeds_by_name(cells):
    return {cell.representation: [run.seed for run in cell.runs] for cell in cells}


def test_run_without_an_evaluation_or_a_number(results, cells):
    # Without evaluations: the mean of the last quarter of the training episodes, 60 and 70.
    run = cells[0].runs[1]
    assert recorded_return(finish(results, run, [], evaluations=0), "a") == 65
    run = cells[0].runs[2]
    record = finish(results, run, [float("nan")])
    assert recorded_return(record, "a") is None
    assert recorded_return(record, "c") == -1  # that of the first evaluation


def test_added_returns_join_the_last_evaluation(results, cells):
    record = finish(results, cells[0].runs[0], [10.0, 30.0])
    added = [np.array([80.0, 80.0])]
    assert recorded_return(record, "a", added) == 50
    assert recorded_return(record, "c", added) == (-1 + 50) / 2


def test_representations_are_compared_with_full_observation(matrix):
    asked = matrix.comparisons()
    assert [comparison.name for comparison in asked] == [
        "face_direction td3 pca3 against full",
        "face_direction td3 random2 against full",
    ]
    assert [comparison.share for comparison in asked] == [0.025, 0.025]
    (other,) = matrix.comparisons(["random2/full"])
    assert other.name == asked[1].name
    with pytest.raises(RequestError, match=r"Unknown comparison 'pca4'; did you mean pca3\?"):
        matrix.comparisons(["pca4"])
    with pytest.raises(RequestError, match="there is nothing to decide"):
        comparisons(only(matrix.parts, ["ddpg"]), {}, (), 30)


LISTED = """
[[comparison]]
task = "face_direction"
algo = "td3"
first = "pca3"
second = "random2"
share = 0.01
max_seeds = 5

[[comparison]]
task = "face_direction"
algo = "td3"
first = "pca3"
second = "full"
claim = "c"
"""


def test_listed_comparisons_replace_those_with_baselines(read, results):
    matrix = read(MATRIX + LISTED)
    cells, asked = matrix.cells, matrix.comparisons()
    assert [comparison.name for comparison in asked] == [
        "face_direction td3 pca3 against random2",
        "face_direction td3 pca3 against full, over the run",
    ]
    assert [comparison.share for comparison in asked] == pytest.approx([0.01, 0.04])
    full, pca, random, _ = cells
    for cell, final in ((full, 300.0), (pca, 100.0), (random, 100.0)):
        for seed in range(5):
            finish(results, cell.runs[seed], [final + seed])
    reached = matrix.outcomes()
    # (c): the first evaluation is -1 for all.
    assert [outcome.decision.difference for outcome in reached] == [0, -100]
    assert [len(outcome.needed) for outcome in reached] == [0, 10]  # the first has its maximum


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("max_seeds = 5", "max_seed = 5", "has no key max_seed; did you mean max_seeds?"),
        ("max_seeds = 5", "margin = 0", "can't be 0: it should be greater than 0"),
        ("max_seeds = 5", "max_seeds = 7", "can't be 7: it should be a multiple of 5"),
        ("share = 0.01", "share = 0.05", "add up to 0.05, and 1 without a share need a rest"),
        ('algo = "td3"\n', "", "the key algo of [[comparison]] is missing: give it a value."),
        ('algo = "td3"', 'algo = "td4"', "has no pca3 and random2 of td4 on face_direction that"),
        ('algo = "td3"', 'algo = "ddpg"', "has no pca3 and random2 of ddpg on face_direction that"),
        ('"random2"', '"random3"', "has no pca3 and random3 of td3 on face_direction that"),
        ('"random2"', '"pca3"', "first and second are both pca3"),
        ('claim = "c"', "steps = 2e3", "with 2000 control steps that differ only"),
        ('second = "full"\nclaim = "c"', 'second = "random2"', "is listed twice"),
        (LISTED, "[comparison]\nshare = 1", "write [[comparison]] above each"),
    ],
)
def test_invalid_comparison_is_refused(old, new, message, read):
    with pytest.raises(RequestError) as refused:
        read(MATRIX + LISTED.replace(old, new, 1)).comparisons()
    assert message in str(refused.value)


def test_only_undecided_comparisons_get_more_seeds(results, matrix):
    cells = matrix.cells
    full, pca, random, _ = cells
    first = next_cells(matrix.outcomes(), ())
    assert seeds_by_name(first) == {name: [0, 1, 2, 3, 4] for name in ("full", "pca3", "random2")}
    fill(results, full, [500, 510, 520, 530, 540])
    fill(results, pca, [100, 110, 120, 130])  # one seed is missing
    fill(results, random, [501, 511, 521, 531, 541])
    reached = matrix.outcomes()
    assert [outcome.decision.seeds for outcome in reached] == [0, 5]
    assert {outcome.decision.verdict for outcome in reached} == {"undecided"}
    more = {"full": [5, 6, 7, 8, 9], "random2": [5, 6, 7, 8, 9]}
    assert seeds_by_name(next_cells(reached, ())) == {**more, "pca3": [4]}
    assert matrix.outcomes(["pca3"])[0].needed == [pca.runs[4]]
    # A run that was tried and failed stops only its comparisons.
    assert seeds_by_name(next_cells(reached, {pca.runs[4].id})) == more

    finish(results, pca.runs[4], [140.0])
    for cell, start in ((full, 550), (random, 551)):
        for seed in range(5, 10):
            finish(results, cell.runs[seed], [start + seed])
    for seed in range(5, 10):
        finish(results, pca.runs[seed], [100.0 + seed])
    pca_outcome, random_outcome = matrix.outcomes()
    assert (pca_outcome.decision.verdict, pca_outcome.needed) == ("smaller", ())
    assert (random_outcome.decision.verdict, random_outcome.needed) == ("equal", ())


def test_part_that_writes_a_default_repeats_the_runs_of_another_and_is_decided(read, results):
    repeated = """
[[part]]
algos = ["td3"]
representations = ["pca3"]
encoder.options.pca.scale = "dataset"
"""
    matrix = read(MATRIX + repeated)
    for cell in matrix.cells[:2]:
        fill(results, cell, [100, 900, 200, 800, 500])
    decisions = [outcome.decision.seeds for outcome in matrix.outcomes(["pca3/full"])]
    assert decisions == [5, 5]


def test_each_seed_has_its_own_encoder_if_the_matrix_says_so(read, results):
    matrix = read(MATRIX.replace("[dataset]", '[encoder]\nseed = "each"\n\n[dataset]'))
    cells = matrix.cells
    runs = cells[1].runs[:10]
    assert len({run.encoder for run in runs}) == 10
    for cell in cells:
        fill(results, cell, [100, 900, 200, 800, 500])
    reached = matrix.outcomes(["pca3/full"], most=10)
    assert [outcome.decision.seeds for outcome in reached] == [5]
    _, more = next_cells(reached, ())
    # A sweep makes the encoders of the new seeds first.
    assert more.runs == runs[5:]
    assert {run.encoder for run in more.runs} <= {encoder.id for encoder in more.encoders}
    # No seed is added beyond the maximum.
    (last,) = matrix.outcomes(["pca3/full"], most=5)
    assert (last.decision.verdict, last.needed) == ("undecided", [])
    assert last.decision.spent == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        (["random2"], "The decision is wrong with a probability of at most 5.00%."),
        ([], "Of all 2 decisions together one or more are wrong with a probability of at most 5%:"),
    ],
)
def test_error_rate_of_one_or_of_several_decisions_is_said(
    matrix, results, cells, asked, sentence, run_command
):
    file = results.path.parent / "small.toml"
    typed = ("sweep", file, "--until-decided", *asked, "--max-seeds", 10, "--dry-run")
    code, printed, _ = run_command(*typed, results=results.path)
    assert (code, sentence in " ".join(printed.split())) == (0, True)


@pytest.mark.slow
def test_sweep_adds_seeds_until_decided_and_repeating_adds_none(results, cells):
    # One real run of a tiny agent, whose returns cannot reach those of full.
    fill(results, cells[0], [2000, 2100, 2200, 2300, 2400])
    fill(results, cells[2], [100, 110, 120, 130])
    arguments = ("--until-decided", "random2", "--max-seeds", "10", "--jobs", "1", "--json")
    matrix = results.path.parent / "small.toml"
    typed = partial(succeed, "sweep", matrix, *arguments, results=results.path, short=True)
    document = json.loads(typed("--dry-run").stdout)
    assert document["needed"] == [cells[2].runs[4].id]
    assert document["comparisons"][0]["low"] is None
    assert not list((results.path / "encoders").rglob("manifest.json"))

    printed = typed()
    (decided,) = json.loads(printed.stdout)["comparisons"]
    # All five seeds are below the five of full: p = 1/252, and 1/80 is spent on this side.
    assert (decided["verdict"], decided["seeds"]) == ("smaller", 5)
    assert decided["spent"] == pytest.approx(0.025)
    assert decided["high"] < 0
    assert "Comparisons decided: 0 of 1" in printed.stderr
    assert "Comparisons decided: 1 of 1" in printed.stderr
    assert "The decision is wrong with a probability of at most 5.00%." in printed.stderr
    runs = list(results.path.rglob("random2/*/manifest.json"))

    assert json.loads(typed().stdout)["comparisons"] == [decided]
    assert list(results.path.rglob("random2/*/manifest.json")) == runs
    assert not list(results.path.rglob("pca3/*/manifest.json"))
