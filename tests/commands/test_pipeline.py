"""Tests of the whole pipeline on real physics: collect, train-dae, train, report and query.

The pipeline runs once, with short episodes; the tests check its results.
"""

import json
import shutil
from functools import partial
from itertools import chain
from pathlib import Path

import pytest

from jbench.store import Results
from tests import command_line
from tests.command_line import SHORT

succeed = partial(command_line.succeed, short=True)

TRAINED = (("td3", "none"), ("ppo", "5"))
"""Algorithm and encoder: an off-policy and an on-policy one; `test_compatibility.py` trains all."""

COLLECT = ("collect", "--steps", str(4 * SHORT), "--seed", "3")
TRAIN_DAE = ("train-dae", "--latent", "5", "--epochs", "2", "--batch", "64")


def train(algo, encoder):
    """Arguments of a training of two seeds in one process, two episodes each."""
    return command_line.train(algo, encoder, "--steps", str(2 * SHORT), "--jobs", "1")


def files(results):
    return {p: p.read_bytes() for p in results.rglob("*") if p.is_file() and p.name != "lock"}


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory):
    """Results of the pipeline: two seeds each of full and of encoded observations."""
    results = tmp_path_factory.mktemp("pipeline") / "results"
    succeed(*COLLECT, results=results)
    succeed(*TRAIN_DAE, results=results)
    for each in TRAINED:
        succeed(*train(*each), results=results)
    return results


def test_each_record_is_finished_and_keeps_its_command_line(pipeline):
    store = Results(pipeline)
    records = [record for kind in ("dataset", "encoder", "run") for record in store.scan(kind)[0]]
    assert [record.status for record in records] == ["finished"] * (1 + 1 + 2 * 2)
    typed = {tuple(record.manifest.provenance["command"]) for record in records}
    where = ("--results", str(pipeline))
    trained = [train(*each) for each in TRAINED]
    assert {(*command[1:],) for command in typed} == {
        (*command, *where) for command in (COLLECT, TRAIN_DAE, *trained)
    }


def check_report(results, out, trained, figure, *formats):
    """Asserts that a report shows both seeds of each algorithm and encoder, and has a figure."""
    more = chain.from_iterable(("--format", format) for format in formats)
    done = succeed("report", "--json", "--out", str(out), *more, results=results)
    printed = json.loads(done.stdout)
    rows = printed["configurations"]
    names = {"none": "full", "5": "dae5-batch-64-epochs-2"}
    reported = {(row["algo"], row["representation"], row["seeds"]) for row in rows}
    assert reported == {(algo.upper(), names[encoder], 2) for algo, encoder in trained}
    written = {Path(path).name for path in printed["files"]}
    figures = {f"{figure}.{format}" for format in formats}
    assert {*figures, "curves.parquet", "curves.csv"} <= written
    assert all(Path(path).stat().st_size > 0 for path in printed["files"])


def test_report_shows_every_configuration(pipeline, tmp_path):
    check_report(pipeline, tmp_path / "report", TRAINED, "algorithms", "svg")


@pytest.mark.slow
def test_report_shows_what_was_trained_later(pipeline, tmp_path):
    results = tmp_path / "results"
    shutil.copytree(pipeline, results)
    later = (("td3", "5"), ("ppo", "none"))
    for each in later:
        succeed(*train(*each), results=results)
    trained = (*TRAINED, *later)
    check_report(results, tmp_path / "report", trained, "representations", "png", "svg")


def test_repeated_commands_change_nothing_and_report_it(pipeline):
    before = files(pipeline)
    training = train("ppo", "5")
    for command in (COLLECT, TRAIN_DAE, training, ("train-agent", *training[1:])):
        assert "already finished; nothing to do" in succeed(*command, results=pipeline).stdout
    # With --json, that is all of the standard output.
    collected = succeed(*COLLECT, "--json", results=pipeline)
    assert json.loads(collected.stdout)["settings"]["steps"] == 4 * SHORT
    trained = json.loads(succeed(*training, "--json", results=pipeline).stdout)
    assert trained["failures"] == {}
    assert [run.rsplit("/", 1)[1][:3] for run in trained["runs"]] == ["s00", "s01"]
    (encoder,) = json.loads(succeed(*TRAIN_DAE, "--json", results=pipeline).stdout)["encoders"]
    assert encoder["summary"]["test_mse"] > 0
    assert files(pipeline) == before
