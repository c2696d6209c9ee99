"""Tests of the whole pipeline on real physics: collect, train-dae, train, report and query.

The pipeline runs once, with short episodes; the tests check its results.
"""

import json
from functools import partial
from pathlib import Path

import pytest

from jbench.store import Results
from jbench.store.query import load
from tests import command_line
from tests.command_line import SHORT

jbench = partial(command_line.jbench, short=True)
succeed = partial(command_line.succeed, short=True)

ALGOS = ("td3", "ppo")
"""An off-policy and an on-policy algorithm; `test_compatibility.py` trains all."""

COLLECT = ("collect", "--steps", str(4 * SHORT), "--seed", "3")
TRAIN_DAE = ("train-dae", "--latent", "5", "--epochs", "2", "--batch", "64")


def train(algo, encoder):
    """Arguments of a training of two seeds in one process, two episodes each."""
    return command_line.train(algo, encoder, "--steps", str(2 * SHORT), "--jobs", "1")


def files(results):
    """Content of every file except locks."""
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


def test_pipeline_finishes_every_run(pipeline):
    tables, problems = load(Results(pipeline))
    runs = tables["runs"].to_pandas()
    assert problems == []
    assert len(runs) == 2 * 2 * 2
    assert set(runs["status"]) == {"finished"}
    assert set(runs["representation"]) == {"full", "dae5"}
    assert set(runs["episodes"]) == {2}
    assert (
        runs.groupby(["algo", "representation"])["seed"]
        .apply(list)
        .map(sorted)
        .eq([[0, 1]] * 4)
        .all()
    )


def test_each_record_keeps_its_command_line(pipeline):
    store = Results(pipeline)
    records = [record for kind in ("dataset", "encoder", "run") for record in store.scan(kind)[0]]
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
    reported = {(row["algo"], row["representation"], row["seeds"]) for row in rows}
    assert reported == {(algo.upper(), rep, 2) for algo in ALGOS for rep in ("full", "dae5")}
    names = {Path(path).name for path in printed["files"]}
    assert {"representations.png", "representations.svg", "curves.parquet", "curves.csv"} <= names
    assert all(Path(path).stat().st_size > 0 for path in printed["files"])


def test_repeated_commands_change_nothing_and_report_it(pipeline):
    before = files(pipeline)
    collected = succeed(*COLLECT, results=pipeline)
    trained_dae = succeed(*TRAIN_DAE, results=pipeline)
    trained = succeed(*train("td3", "5"), results=pipeline)
    assert "already finished; nothing to do" in collected.stdout
    assert "already finished; nothing to do" in trained_dae.stdout
    assert "2 of 2 runs are already finished; nothing to do" in trained.stdout
    assert files(pipeline) == before


def test_train_agent_is_alias_of_train(pipeline):
    done = succeed("train-agent", *train("td3", "none")[1:], results=pipeline)
    assert "nothing to do" in done.stdout


def test_json_is_only_standard_output(pipeline):
    collected = succeed(*COLLECT, "--json", results=pipeline)
    assert json.loads(collected.stdout)["settings"]["steps"] == 4 * SHORT
    trained = json.loads(succeed(*train("td3", "none"), "--json", results=pipeline).stdout)
    assert trained["failures"] == {}
    assert [run.rsplit("/", 1)[1][:3] for run in trained["runs"]] == ["s00", "s01"]
    encoders = json.loads(succeed(*TRAIN_DAE, "--json", results=pipeline).stdout)["encoders"]
    assert encoders[0]["summary"]["test_mse"] > 0
