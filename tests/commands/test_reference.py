"""Tests of `--results reference`, the read-only results shipped with jbench."""

import pytest

from jbench.cli import main
from jbench.store import Results
from jbench.store.shipped import shipped
from tests.short_episodes import shorten_episodes


@pytest.fixture(autouse=True)
def empty_directory(tmp_path, monkeypatch):
    """Runs a test in an empty directory; checks that the shipped results are unchanged."""
    monkeypatch.chdir(tmp_path)
    before = shipped_files()
    yield
    assert shipped_files() == before


def shipped_files():
    """Returns the size and the time of the last change of each shipped file, by its path."""
    status = {path: path.stat() for path in shipped().rglob("*") if path.is_file()}
    assert status
    return {path: (each.st_size, each.st_mtime_ns) for path, each in status.items()}


def test_shipped_runs_are_listed_and_queried(document):
    ids = {record.id for record in Results(shipped()).scan("run")[0]}
    assert {run["run"] for run in document("runs", results="reference")["runs"]} == ids
    sql = "SELECT count(*) AS n FROM runs"
    assert document("query", sql, results="reference") == [{"n": len(ids)}]


def test_messages_call_the_shipped_results_reference(refused, capsys):
    for arguments, sentence in (
        (("runs", "--algo", "dpg"), "did you mean ddpg? Choose "),
        (("evaluate", "face_direction/x"), "Error: No policy is shipped as reference/"),
        (("reproduce", "face_direction/x"), "There is no run face_direction/x in reference; "),
    ):
        printed = refused(*arguments, results="reference")
        assert sentence in printed
        assert str(shipped()) not in printed
    # A run of theirs is reproduced without a results directory.
    several = refused("reproduce", "reference/face_direction/sac/full/s00")
    assert ": face_direction/sac/full/s00-" in several
    # A dataset is collected into results, not into the shipped ones.
    for name, more in (("reference", ""), (".", " --results .")):
        assert main(["datasets", "--results", name]) == 0
        command = f"jbench collect --steps 100000{more}"
        assert capsys.readouterr().out == f"No datasets in {name}; {command} makes a small one.\n"


@pytest.mark.slow
def test_report_is_written_to_working_directory(tmp_path, capsys):
    arguments = ("--results", "reference", "--task", "face_direction", "--algo", "sac")
    assert main(["report", *arguments, "--format", "svg"]) == 0
    assert (tmp_path / "reference-report" / "index.html").exists()


def test_evaluation_is_saved_in_default_results(tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    assert main(["evaluate", "--episodes", "1", "--results", "reference"]) == 0
    (record,) = Results(tmp_path / "results").scan("evaluation")[0]
    assert record.status == "finished"


@pytest.mark.parametrize(
    "typed",
    [
        "collect",
        "train",
        "train-dae",
        "train-encoder",
        "sweep smoke",
        "repair",
        "merge other",
        "export",
    ],
)
def test_writing_command_refuses_shipped_results(typed, refused):
    error = refused(*typed.split(), results="reference")
    assert "reference names the results shipped with jbench, which are read-only" in error


def test_path_of_the_shipped_results_is_their_name(refused, document):
    """As results/reference of a checkout, which is a link to them."""
    assert document("runs", results=str(shipped())) == document("runs", results="reference")
    error = refused("collect", results=str(shipped()))
    assert "reference names the results shipped with jbench, which are read-only" in error


def test_existing_directory_named_reference_takes_precedence(tmp_path, document, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    (tmp_path / "reference").mkdir()
    assert document("runs", results="reference")["runs"] == []
    assert main(["evaluate", "--episodes", "1", "--results", "reference"]) == 0
    assert len(Results(tmp_path / "reference").scan("evaluation")[0]) == 1
    assert not (tmp_path / "results").exists()


@pytest.mark.slow
def test_shipped_runs_are_merged_into_other_results(tmp_path, document):
    merged = document("merge", "reference", results="mine")["records"]
    assert {record["outcome"] for record in merged} == {"copied"}
    mine = Results(tmp_path / "mine")
    kinds = ("run", "encoder", "evaluation")
    assert sum(len(mine.scan(kind)[0]) for kind in kinds) == len(merged)
