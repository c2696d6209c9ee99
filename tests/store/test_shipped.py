"""Tests of the results directories that the Python API takes."""

from pathlib import Path

import numpy as np
import pytest

from jbench.datasets import find_dataset
from jbench.encoders import find_encoder, load_encoder
from jbench.errors import RequestError
from jbench.policies.saved import load_agent
from jbench.store import Results
from jbench.store.shipped import results_to_read, results_to_write, shipped

RUN = "face_direction/ddpg/full/s03-b1e788f1"


@pytest.mark.parametrize("inside", ["runs", "runs/face_direction", "encoders/"])
def test_directory_inside_results_is_refused_with_what_to_type(inside, tmp_path, monkeypatch):
    for record in ("runs/face_direction/s00-1f9a2c4e", "encoders/dae12/s00-1f9a2c4e"):
        (tmp_path / "mine" / record).mkdir(parents=True)
        (tmp_path / "mine" / record / "manifest.json").touch()

    for working, typed, whole in (
        (tmp_path, f"mine/{inside}", "mine"),
        (tmp_path / "mine", inside, "."),
        (tmp_path, f"{tmp_path}/mine/{inside}", f"{tmp_path}/mine"),
    ):
        monkeypatch.chdir(working)
        for read in (results_to_read, results_to_write):
            with pytest.raises(RequestError, match=f"results directory {whole}; type {whole} inst"):
                read(Path(typed))


def test_results_may_be_called_runs(tmp_path):
    record = tmp_path / "runs" / "runs" / "face_direction"
    record.mkdir(parents=True)
    (record / "manifest.json").touch()
    assert results_to_read(tmp_path / "runs").path == tmp_path / "runs"
    (tmp_path / "runs" / "empty").mkdir()
    assert results_to_write(tmp_path / "runs" / "empty").path.name == "empty"


def test_results_are_given_as_object_path_or_text(tmp_path):
    results = Results(tmp_path)
    assert results_to_read(results) is results
    assert results_to_read(tmp_path).path == results_to_read(str(tmp_path)).path == tmp_path
    assert results_to_read("reference").path == shipped()


def test_functions_of_the_api_take_a_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load_agent("reference", RUN).task == "face_direction"
    encoder = find_encoder("reference", "dae:12", "face_direction")
    assert load_encoder(shipped(), encoder).description["kind"] == "dae"
    with pytest.raises(RequestError, match="No finished dataset in reference"):
        find_dataset("reference")


def test_observations_of_wrong_size_are_refused():
    agent = load_agent("reference", RUN)
    assert agent.act(np.zeros((2, 16), np.float32)).shape == (2, 1)
    with pytest.raises(RequestError, match=r"face_direction: .* \(\.\.\., 16\), not \(2, 15\)\."):
        agent.act(np.zeros((2, 15), np.float32))


def test_missing_directory_and_file_are_refused(tmp_path):
    with pytest.raises(RequestError, match="none does not exist; name another directory"):
        load_agent(tmp_path / "none", RUN)
    (tmp_path / "file").touch()
    with pytest.raises(RequestError, match="file is a file"):
        find_dataset(str(tmp_path / "file"))
