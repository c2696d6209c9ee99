"""Tests of sweep matrices in TOML: shipped files, their runs, and messages for invalid files."""

import json
import tomllib

import pytest

from jbench.cli import main
from jbench.errors import RequestError
from jbench.names import SWEEPS
from jbench.settings.recorded import SEED, alike, variant
from jbench.settings.run import TYPED, RunSettings
from jbench.store import Results
from jbench.store.shipped import shipped
from jbench.studies.arms import arms
from jbench.studies.matrix import Matrix, read_matrix
from jbench.sweeps.cell import all_runs, matrix_cells
from tests.documentation import ROOT, code_of


def cells_of(name, path, **changes):
    return matrix_cells(read_matrix(name, **changes), Results(path))


@pytest.fixture
def cells_in(tmp_path):
    """Returns a function that writes a file and returns its cells."""

    def read(text, **changes):
        (tmp_path / "written.toml").write_text(text)
        return cells_of(str(tmp_path / "written.toml"), tmp_path, **changes)

    return read


@pytest.fixture
def refused_for(cells_in):
    """Returns a function that writes an invalid file and returns the one line of the error."""

    def read(text):
        with pytest.raises(RequestError) as raised:
            cells_in(text)
        assert "\n" not in str(raised.value)
        return str(raised.value)

    return read


@pytest.mark.parametrize(
    ("name", "cells", "runs"),
    [
        ("smoke", 8, 16),
        ("fig7", 2, 2),
        ("fig8", 2, 20),
        ("fig9", 20, 200),
        ("question", 53, 376),
        ("authors", 27, 223),
        ("robots", 40, 200),
    ],
)
def test_shipped_matrices_have_expected_cells_and_runs(name, cells, runs, tmp_path):
    listed = cells_of(name, tmp_path)
    assert (len(listed), len(all_runs(listed))) == (cells, runs)
    assert {run.engine for run in all_runs(listed)} == {"batched"}


def test_figures_have_cells_of_paper(tmp_path):
    cells = cells_of("fig9", tmp_path)
    tasks = (
        "move_from_origin",
        "face_direction",
        "move_in_direction",
        "move_to_position",
        "move_to_pose",
    )
    every = [(task, algo) for task in tasks for algo in ("ddpg", "ppo", "sac", "td3")]
    assert [(cell.task, cell.algo) for cell in cells] == every
    for cell in cells:
        assert [run.seed for run in cell.runs] == list(range(10))
        assert {(run.steps, run.representation) for run in cell.runs} == {(5_000_000, "full")}
        assert cell.runs[0].hyperparameters["hidden_layers"] == [350, 250]


@pytest.mark.parametrize(
    ("name", "part", "seeds"), [("fig7", "figure7", [0]), ("fig8", "figure8", [*range(10)])]
)
def test_figures_7_and_8_have_the_arms_of_the_study_of_their_agents(name, part, seeds, tmp_path):
    """They differ in steps and evaluations, and the study has 8 latents, too."""
    length = {"steps": 5_000_000, "evaluation": {"every": 50_000, "episodes": 10}}
    parts = read_matrix("authors", **length)
    parts = {where: matrix for where, matrix in parts.items() if matrix.name == part}
    studied = [arm for arm in arms(parts) if "dae8" not in arm.representation]
    trained = list(arms(read_matrix(name)))
    assert [arm.training_key for arm in trained] == [arm.training_key for arm in studied]
    assert [arm.evaluation for arm in trained] == [arm.evaluation for arm in studied]
    assert [arm.own_encoders for arm in trained] == [False, False]

    cells = cells_of(name, tmp_path)
    assert [[run.seed for run in cell.runs] for cell in cells] == [seeds, seeds]
    assert {run.steps for run in all_runs(cells)} == {5_000_000}
    encoders = [cell.encoders for cell in matrix_cells(parts, Results(tmp_path))]
    assert [cell.encoders for cell in cells] == encoders[:2]


def test_question_matrix_contains_shipped_runs(tmp_path):
    full, encoded = cells_of("question", tmp_path)[:2]
    expected = [
        f"face_direction/ddpg/{name}" for name in ("full/s00-7e4e6902", "dae12/s00-cb04f42b")
    ]
    assert [full.runs[0].id, encoded.runs[0].id] == expected
    reference = Results(shipped())
    for cell in (full, encoded):
        assert [run.seed for run in cell.runs] == list(range(10))
        for run in cell.runs[:3]:
            assert reference.find("run", run.id).settings == run.model_dump(mode="json")


def test_each_agent_has_encoder_of_its_seed(tmp_path):
    cells = cells_of("question", tmp_path)
    (cell,) = (cell for cell in cells if cell.representation == "dae-yaw13")
    assert [encoder.seed for encoder in cell.encoders] == [run.seed for run in cell.runs]
    assert [encoder.id for encoder in cell.encoders] == [run.encoder for run in cell.runs]
    (draws,) = {encoder.draws for encoder in cell.encoders}
    assert {run.encoder_draws for run in cell.runs} == {draws}
    assert len({variant(run.values) for run in cell.runs}) == 1
    assert len({alike(run, SEED) for run in cell.runs}) == 1


PARTS = """
algos = ["td3"]
seeds = "0-3"
steps = 2000
[evaluation]
every = 1000
[hyperparameters.td3]
batch_size = 16
[[part]]
tasks = ["face_direction"]
[[part]]
tasks = ["move_to_pose"]
algos = ["ppo"]
seeds = "2"
[part.evaluation]
episodes = 1
[part.hyperparameters.ppo]
n_envs = 2
"""


def test_parts_may_have_different_engines(cells_in):
    cells = cells_in(PARTS + "[[part]]\ntasks = ['move_to_pose']\nengine = 'sb3'\n")
    engines = ["batched", "batched", "sb3"]
    assert [cell.runs[0].engine for cell in cells] == engines


def test_keys_outside_parts_are_defaults_of_parts(cells_in):
    first, second = cells_in(PARTS)
    assert (first.task, first.algo, len(first.runs)) == ("face_direction", "td3", 4)
    assert (second.task, second.algo, len(second.runs)) == ("move_to_pose", "ppo", 1)
    assert first.runs[0].hyperparameters["batch_size"] == 16
    assert (first.runs[0].evaluate_every, first.runs[0].evaluate_episodes) == (1000, 10)
    # A table of a part replaces single keys, not the whole table.
    assert (second.runs[0].evaluate_every, second.runs[0].evaluate_episodes) == (1000, 1)
    assert second.runs[0].hyperparameters["n_envs"] == 2
    alone = PARTS.partition("[[part]]")[0].replace("algos", 'tasks = ["face_direction"]\nalgos')
    assert cells_in(alone)[0].runs == first.runs
    # Typed seeds and steps replace those of all parts.
    runs = all_runs(cells_in(PARTS, seeds=[7], steps=3000))
    assert [(run.algo, run.seed, run.steps) for run in runs] == [("td3", 7, 3000), ("ppo", 7, 3000)]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (PARTS + "[[part]]\nalgos = ['td4']\n", "part 3: the key tasks of the matrix is missing"),
        (PARTS + "[[part]]\ntasks = ['poze']\n", "part 3: Unknown task 'poze'"),
        ("algos = ['td3']\n[part]\ntasks = ['move_to_pose']\n", "write [[part]] above each"),
        ("[[prat]]\ntasks = ['move_to_pose']\n", "Unknown key 'prat'; did you mean part?"),
        (PARTS + "engine = 'sb3'\n", "ppo has no setting engine"),
        (
            PARTS + "[part.hyperparameters]\ntau = 0.5\n",
            "tau is directly in the table hyperparameters: write it in that of its algorithm, such "
            "as hyperparameters.td3.tau.",
        ),
        (
            PARTS + "[part.encoder.options]\nnoise = 0.5\n",
            "write it in that of its kind, such as encoder.options.dae.noise.",
        ),
    ],
)
def test_invalid_part_is_reported_in_one_line(text, says, refused_for):
    assert says in refused_for(text)


def test_every_run_setting_is_key_of_a_file_and_option_of_train(cells_in, tmp_path, capsys):
    keys = {"steps": 4000, "engine": "batched", "time_limit": "terminal", "precision": "bfloat16"}
    keys["augment"] = 3
    keys["robots"] = 2
    keys["environments"] = 2
    evaluation = {"every": 7, "episodes": 3}
    options = keys | {f"evaluate_{key}": value for key, value in evaluation.items()}
    titles = {RunSettings.model_fields[name].title or name: name for name in TYPED}
    assert set(options) == set(titles)
    lines = [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    lines += ["[evaluation]", *(f"{key} = {value}" for key, value in evaluation.items())]
    lines += ["[hyperparameters.td3]", "tau = 0.5"]
    first = 'tasks = ["face_direction"]\nalgos = ["td3"]\nseeds = [0]'
    (run,) = all_runs(cells_in("\n".join([first, *lines])))
    assert {key: getattr(run, name) for key, name in titles.items()} == options
    typed = [f"--{key.replace('_', '-')}={value}" for key, value in options.items()]
    typed += ["--set", "tau=0.5", "--algo", "td3", "--seed", "0", "--dry-run", "--json"]
    assert main(["train", *typed, "--results", str(tmp_path)]) == 0
    assert run.id in capsys.readouterr().out


def test_equal_names_are_one_cell_with_the_size_that_follows_from_the_task(cells_in):
    cells = cells_in(
        'tasks = ["face_direction", "move_to_pose", "face_direction"]\nalgos = ["td3"]\n'
        'representations = ["full", "planar", "scaled", "planar"]\nseeds = [0, 0, 1]\n'
    )
    names = ["full", "planar12", "scaled16", "full", "planar14", "scaled19"]
    assert [cell.runs[0].representation for cell in cells] == names
    assert [[run.seed for run in cell.runs] for cell in cells] == [[0, 1]] * 6


def test_encoder_uses_dataset_and_options_of_file(cells_in):
    head = 'tasks = ["face_direction"]\nalgos = ["td3"]\nrepresentations = ["dae:5", "dae5"]\n'

    def encoder(more, name="dae5"):
        (cell,) = cells_in(head + more)
        assert cell.runs[0].representation == name
        (encoder,) = cell.encoders
        return encoder

    plain = encoder("")
    assert encoder("") == plain
    other = encoder("[encoder.options.dae]\nepochs = 3\n", "dae5-epochs-3")
    assert (other.options["epochs"], other.dataset) == (3, plain.dataset)
    assert encoder("[dataset]\nsteps = 2e4\n").dataset != plain.dataset
    assert len({plain.id, other.id, encoder("[encoder]\nseed = 1\n").id}) == 3


def test_documented_file_lists_all_keys_with_defaults(cells_in):
    text = documented = code_of("sweeps.md", "toml")
    for key in ("augment", "name"):  # TOML has no none
        text = text.replace(f"# {key} =", f"{key} =")
    content = tomllib.loads(text)
    assert set(content) == set(Matrix.model_fields)
    short = 'tasks = ["face_direction"]\nalgos = ["ddpg", "td3"]\nenvironments = 1\n'
    assert cells_in(documented) == cells_in(short)
    page = (ROOT / "docs" / "sweeps.md").read_text()
    assert [f"`{name}`" in page for name in SWEEPS] == [True] * len(SWEEPS)


DIGITS = "9" * 5000  # more than Python reads as a number


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("[ofe]\nx = 1", "Unknown setting of ofe 'x'; choose"),
        ('tasks = ["face_direktion"]', "'face_direktion'; did you mean face_direction?"),
        ('engine = "bached"', "engine of the matrix can't be 'bached': it should be 'batched'"),
        ('representations = ["dea12"]', "Unknown representation 'dea12'; did you mean dae12?"),
        ('representations = ["planar8"]', "planar of face_direction has 12 latents"),
        (f'representations = ["ofe{DIGITS}"]', "it should be less than or equal to 1000"),
        ('representations = ["dae17"]', "dae encoder of face_direction has 1 to 16 latents"),
        ('representations = ["move_to_pose/dae12/s00-12345678"]', "is of move_to_pose, which is"),
        ('representations = ["face_direction/dae12/s00-12345678"]', "No encoder face_direction/"),
        ('seeds = "3-1"', "written.toml: seeds 3-1: type seeds like 0-9"),
        ("seeds = 5", 'seeds of the matrix can\'t be 5: type "0-4" for five seeds, or a list'),
        ("seeds = [-1]", "seeds.0 of the matrix can't be -1"),
        ("steps = 1e300", "it should be less than or equal to 1000000000000000"),
        ("evaluation = 3", "write [evaluation] and its keys below it"),
        ("[evaluation]\nevry = 3", "[evaluation] has no key evry; did you mean every?"),
        ("[hyperparameters.td3]\ntau = 2", "tau of td3 can't be 2"),
        ("[hyperparameters.ddpg]\ntau = 0.1", "is for ddpg, which is not among the algos"),
        ("[encoder.options.dae]\nepoch = 2", "dae has no option epoch; did you mean epochs?"),
        ("[encoder]\nseed = 'all'", 'it should be a whole number, 0 or more, or "each"'),
        ("[dataset]\nsteps = 1500", "must be a multiple, such as 2000"),
        (f"tasks = {'[' * 10_000}", "is not TOML"),
    ],
)
def test_invalid_value_is_reported_in_one_line(line, says, refused_for, tmp_path):
    content = {"tasks": '["face_direction"]', "algos": '["td3"]', "representations": '["dae3"]'}
    content.pop(line.split(" =")[0], None)
    error = refused_for("\n".join([*(f"{key} = {value}" for key, value in content.items()), line]))
    assert error.startswith(str(tmp_path / "written.toml"))
    assert says in error


def test_unknown_or_unreadable_matrix_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    for name, says in (
        ("fig6", r"Unknown matrix 'fig6'; did you mean fig\d\? .*FILE\.toml"),
        ("gone.toml", r"gone\.toml can't be read \(No such file"),
        ("bytes.toml", r"bytes\.toml can't be read \(it is not text"),
        ("bytes", r"Unknown matrix 'bytes'; .* or bytes\.toml\."),
    ):
        with pytest.raises(RequestError, match=says):
            read_matrix(name)
