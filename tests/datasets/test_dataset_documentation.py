"""The lines of docs/datasets.md, run as they stand there."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from jbench.datasets import Dataset, DatasetSettings, collect
from jbench.store import Results
from jbench.tasks import features

DOCUMENT = Path(__file__).parents[2] / "docs" / "datasets.md"
FENCE = re.compile(r"^```(python|sh)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A directory with the dataset of seed 0 in its results/."""
    path = tmp_path_factory.mktemp("reader")
    collect(DatasetSettings(steps=2000), Results(path / "results"), 2)
    return path


@pytest.fixture(scope="module")
def dataset(place):
    return Dataset(Results(place / "results").scan("dataset")[0][0])


def lines(containing):
    """The one piece of code in the document that contains a text."""
    (found,) = (code for code in FENCE.findall(DOCUMENT.read_text()) if containing in code[1])
    return found


def run(containing, place):
    language, code = lines(containing)
    if language == "sh":
        program, *arguments = shlex.split(code)
        assert program == "jbench"
        command = [sys.executable, "-m", "jbench.cli", *arguments]
    else:
        command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, cwd=place, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def numbers(text):
    return np.array([float(number) for number in re.findall(r"-?\d+\.\d+(?:e-?\d+)?", text)])


@pytest.mark.parametrize("library", ["import pandas", "import polars", "import duckdb"])
def test_files_are_read_without_jbench(library, place, dataset):
    (block,) = dataset.blocks("move_from_origin")
    heights = features.denormalize("move_from_origin", block.observations)[..., 2]
    printed = numbers(run(library, place))
    for wanted in heights.mean(axis=1):
        assert np.isclose(printed, wanted, rtol=1e-3).any()


def test_blocks_are_read_as_a_task_sees_them(place, dataset):
    (block,) = dataset.blocks("move_to_pose")
    printed = run("print(block.observations.shape", place)
    assert "(2, 1001, 19) (2, 1000)" in printed
    np.testing.assert_allclose(numbers(printed.split("[")[1]), block.rewards.sum(axis=1), rtol=1e-5)


def test_torch_reads_transitions(place):
    # 2000 transitions in batches of 256: the last has 208.
    sizes = "([208, 16]) ([208]) ([208]) ([208, 16])"
    assert run("import torch", place).split() == sizes.replace("(", "torch.Size(").split()


def test_minari_loads_what_was_exported(place, dataset):
    run("jbench export", place)
    id = f"jitterbug/face_direction/{dataset.id.replace('/', '-')}-v0"
    assert run("import minari", place).split("\n")[0] == f"{id} 2 (1001, 16) (1000, 1)"


def test_every_piece_of_code_is_run_here():
    texts = ("import pandas", "import polars", "import duckdb", "print(block.observations.shape")
    run_here = [lines(text) for text in (*texts, "import torch", "jbench export", "import minari")]
    assert sorted(run_here) == sorted(FENCE.findall(DOCUMENT.read_text()))
