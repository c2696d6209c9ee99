"""Tests of what a sweep says of the encoders that it trains first."""

import pytest

from jbench.cli import main
from jbench.store import Results
from jbench.studies.matrix import read_matrix
from jbench.sweeps.cell import matrix_cells
from jbench.sweeps.preparation import missing_encoders, warnings_of_epochs

HEAD = (
    'tasks = ["face_direction"]\nalgos = ["td3"]\nsteps = 2000\nseeds = [0, 1]\n'
    'representations = ["full", "dae3", "pca3"]\n'
)
SMALL = "[dataset]\nsteps = 20_000\n"
OWN_ENCODERS = '[encoder]\nseed = "each"\n'


@pytest.fixture
def matrix(tmp_path):
    """Returns a function that writes a matrix file and returns its path."""

    def write(text):
        path = tmp_path / "study.toml"
        path.write_text(HEAD + text)
        return path

    return write


@pytest.mark.parametrize(
    ("text", "number"),
    [
        (SMALL, 1),
        (SMALL + OWN_ENCODERS, 1),  # a sentence for both encoders
        (SMALL + "[encoder.options.dae]\nepochs = 20\n", 0),
        ("", 0),  # the paper's five million control steps
    ],
)
def test_encoder_of_a_small_dataset_has_few_epochs_unless_the_file_gives_them(
    text, number, matrix, tmp_path
):
    results = Results(tmp_path / "results")
    cells = matrix_cells(read_matrix(str(matrix(text))), results)
    missing = missing_encoders(cells, results)
    sentences = [text for request in missing for text in warnings_of_epochs(*request)]
    # 16 of 20 episodes are not held out: 2 batches of 8192 rows, of which 4000 need 2000 epochs.
    assert sentences == number * [
        "dae3 of face_direction is trained for 200 epochs, few for 20,000 control steps, for which "
        "jbench train-encoder chooses 2,000: type epochs = 2000 under [encoder.options.dae] of the "
        "matrix file."
    ]


def test_dry_run_warns_of_few_epochs(matrix, tmp_path, capsys):
    request = ["sweep", str(matrix(SMALL)), "--dry-run", "--results", str(tmp_path / "results")]
    assert main(request) == 0
    (warning,) = [line for line in capsys.readouterr().err.split("\n") if "epochs" in line]
    assert warning.startswith("Warning: dae3 of face_direction is trained for 200 epochs, few for")
