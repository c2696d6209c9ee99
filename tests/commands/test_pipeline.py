"""Tests of the whole pipeline on real physics: collect, train-dae, train, report and query.

The pipeline runs once, with short episodes; the tests check its results.
"""

import json
from functools import partial
from pathlib import Path

import pytest

from jbench.store import Results
from tests import command_line
from tests.command_line import SHORT

succeed = partial(command_line.succeed, short=True)

ALGOS = ("td3", "ppo")
"""An off-policy and an on-policy algorithm; `test_compatibility.py` trains all."""

COLLECT = ("collect", "--steps", str(4 * SHORT), "--seed", "3")
TRAIN_DAE = ("train-dae", "--latent", "5", "--epochs", "2", "--batch", "64")


def train(algo, encoder):
    """Arguments of a training of two seeds in one process, two episodes each."""
    return command_line.train(algo, encoder, "--steps", str(2 * SHORT), "--jobs", "1")


def files(results):
    return {p: p.read_bytes() for p in results.rglob("*") if p.is_file() and p.name != "lock"}


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory):
    """Results of the pipeline: two algorithms, two seeds, full and encoded observations."""
    results = tmp_path_factory.mktemp("pipeline") / "results"
    succeed(*COLLECT, results=results)
    succeed(*TRAIN_DAE, results=results)
    for algo in ALGOS:
        for encoder in ("none", "5"):
            succeed(*train(algo, encoder), results=results)
    return results


def test_each_record_is_finished_and_keeps_its_command_line(pipeline):
    store = Results(pipeline)
    records = [record for kind in ("dataset", "encoder", "run") for record in store.scan(kind)[0]]
    assert [record.status for record in records] == ["finished"] * (1 + 1 + 2 * 2 * 2)
    typed = {tuple(record.manifest.provenance["command"]) for record in records}
    where = ("--results", str(pipeline))
    trained = [train(algo, encoder) for algo in ALGOS for encoder in ("none", "5")]
    assert {(*command[1:],) for command in typed} == {
        (*command, *where) for command in (COLLECT, TRAIN_DAE, *trained)
    }


def test_report_shows_every_cell(pipeline, tmp_path):
    done = succeed("report", "--json", "--out", str(tmp_path / "report"), results=pipeline)
    printed = json.loads(done.stdout)
    rows = printed["configurations"]
    trained = "dae5-batch-64-epochs-2"
    reported = {(row["algo"], row["representation"], row["seeds"]) for row in rows}
    assert reported == {(algo.upper(), rep, 2) for algo in ALGOS for rep in ("full", trained)}
    names = {Path(path).name for path in printed["files"]}
    assert {"representations.png", "representations.svg", "curves.parquet", "curves.csv"} <= names
    assert all(Path(path).stat().st_size > 0 for path in printed["files"])


def test_repeated_commands_change_nothing_and_report_it(pipeline):
    before = files(pipeline)
    for command in (COLLECT, TRAIN_DAE, train("td3", "5"), ("train-agent", *train("td3", "5")[1:])):
        assert "already finished; nothing to do" in succeed(*command, results=pipeline).stdout
    # With --json, that is all of the standard output.
    collected = succeed(*COLLECT, "--json", results=pipeline)
    assert json.loads(collected.stdout)["settings"]["steps"] == 4 * SHORT
    trained = json.loads(succeed(*train("td3", "5"), "--json", results=pipeline).stdout)
    assert trained["failures"] == {}
    assert [run.rsplit("/", 1)[1][:3] for run in trained["runs"]] == ["s00", "s01"]
    (encoder,) = json.loads(succeed(*TRAIN_DAE, "--json", results=pipeline).stdout)["encoders"]
    assert encoder["summary"]["test_mse"] > 0
    assert files(pipeline) == before
