"""Tests of sweep matrices in TOML: shipped files, their runs, and messages for invalid files."""

import json
import tomllib

import pytest

from jbench.cli import main
from jbench.errors import RequestError
from jbench.names import SWEEPS, TASKS
from jbench.settings.algorithms import ALGORITHMS
from jbench.settings.alike import SEED, alike, variant
from jbench.settings.run import TYPED, RunSettings
from jbench.store import Results
from jbench.store.shipped import shipped
from jbench.sweeps.cell import all_runs, matrix_cells
from jbench.sweeps.matrix import Matrix, read_matrix
from tests.documentation import ROOT, code_of


def cells_of(name, path, **changes):
    return matrix_cells(read_matrix(name, **changes), Results(path))


@pytest.mark.parametrize(
    ("name", "cells", "runs"),
    [
        ("smoke", 8, 16),
        ("fig7", 2, 2),
        ("fig8", 2, 20),
        ("fig9", 20, 200),
        ("question", 53, 376),
        ("robots", 36, 180),
    ],
)
def test_shipped_matrices_have_expected_cells_and_runs(name, cells, runs, tmp_path):
    listed = cells_of(name, tmp_path)
    assert (len(listed), len(list(all_runs(listed)))) == (cells, runs)
    assert {run.engine for run in all_runs(listed)} == {"batched"}


def test_figure_9_has_cells_of_paper(tmp_path):
    cells = cells_of("fig9", tmp_path)
    assert [(cell.task, cell.algo) for cell in cells] == [
        (task, algo) for task in TASKS for algo in ALGORITHMS
    ]
    for cell in cells:
        assert [run.seed for run in cell.runs] == list(range(10))
        assert {(run.steps, run.representation) for run in cell.runs} == {(5_000_000, "full")}
        assert cell.runs[0].hyperparameters["hidden_layers"] == [350, 250]


def test_figures_7_and_8_compare_ddpg_with_12_latents(tmp_path):
    for name, task in (("fig7", "face_direction"), ("fig8", "move_in_direction")):
        full, encoded = cells_of(name, tmp_path)
        assert {run.task for cell in (full, encoded) for run in cell.runs} == {task}
        assert {cell.algo for cell in (full, encoded)} == {"ddpg"}
        assert full.encoders == ()
        (encoder,) = encoded.encoders
        assert (encoder.kind, encoder.latents) == ("dae", 12)
        assert {run.encoder for run in encoded.runs} == {encoder.id}


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
    (cell,) = (
        cell for cell in cells_of("question", tmp_path) if cell.representation == "dae-yaw13"
    )
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


def test_keys_outside_parts_are_defaults_of_parts(tmp_path):
    file = tmp_path / "parts.toml"
    file.write_text(PARTS)
    first, second = cells_of(str(file), tmp_path)
    assert [(cell.task, cell.algo, len(cell.runs)) for cell in (first, second)] == [
        ("face_direction", "td3", 4),
        ("move_to_pose", "ppo", 1),
    ]
    assert first.runs[0].hyperparameters["batch_size"] == 16
    assert (first.runs[0].evaluate_every, first.runs[0].evaluate_episodes) == (1000, 10)
    # A table of a part replaces single keys, not the whole table.
    assert (second.runs[0].evaluate_every, second.runs[0].evaluate_episodes) == (1000, 1)
    assert second.runs[0].hyperparameters["n_envs"] == 2
    alone = tmp_path / "alone.toml"
    alone.write_text(
        PARTS.partition("[[part]]")[0].replace("algos", 'tasks = ["face_direction"]\nalgos')
    )
    assert cells_of(str(alone), tmp_path)[0].runs == first.runs


def test_seeds_and_steps_are_replaced_in_all_parts(tmp_path):
    file = tmp_path / "parts.toml"
    file.write_text(PARTS)
    runs = all_runs(cells_of(str(file), tmp_path, seeds=[7], steps=3000))
    assert [(run.algo, run.seed, run.steps) for run in runs] == [("td3", 7, 3000), ("ppo", 7, 3000)]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (PARTS + "[[part]]\nalgos = ['td4']\n", "part 3: the key tasks of the matrix is missing"),
        (
            PARTS + "[[part]]\ntasks = ['move_to_poze']\n",
            "part 3: Unknown task 'move_to_poze'; did you",
        ),
        (
            PARTS + "[[part]]\ntasks = ['move_to_pose']\nhyperparameters = {td3 = {tau = 2}}\n",
            "part 3: tau of td3 can't be 2",
        ),
        ("algos = ['td3']\n[part]\ntasks = ['move_to_pose']\n", "write [[part]] above each"),
        ("algos = ['td3']\npart = []\n", "write [[part]] above each"),
        ("[[prat]]\ntasks = ['move_to_pose']\n", "Unknown key 'prat'; did you mean part?"),
        (PARTS + "engine = 'sb3'\n", "ppo has no setting engine"),
        (PARTS + "[[part]]\ntasks = ['move_to_pose']\nengine = 'sb3'\n", "not batched and sb3"),
    ],
)
def test_invalid_part_is_reported_in_one_line(text, says, tmp_path):
    file = tmp_path / "wrong.toml"
    file.write_text(text)
    with pytest.raises(RequestError) as raised:
        cells_of(str(file), tmp_path)
    assert says in str(raised.value)
    assert "\n" not in str(raised.value)


def test_every_run_setting_is_key_of_a_file_and_option_of_train(tmp_path, capsys):
    keys = {"steps": 4000, "engine": "batched", "time_limit": "terminal", "precision": "bfloat16"}
    keys |= {"augment": 3, "robots": 2, "environments": 2}
    evaluation = {"every": 7, "episodes": 3}
    options = keys | {f"evaluate_{key}": value for key, value in evaluation.items()}
    titles = {RunSettings.model_fields[name].title or name: name for name in TYPED}
    assert set(options) == set(titles)
    lines = [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    lines += ["[evaluation]", *(f"{key} = {value}" for key, value in evaluation.items())]
    lines += ["[hyperparameters.td3]", "tau = 0.5"]
    file = tmp_path / "all.toml"
    file.write_text("\n".join(['tasks = ["face_direction"]\nalgos = ["td3"]\nseeds = [0]', *lines]))
    (run,) = all_runs(cells_of(str(file), tmp_path))
    assert {key: getattr(run, name) for key, name in titles.items()} == options
    typed = [f"--{key.replace('_', '-')}={value}" for key, value in options.items()]
    typed += ["--set", "tau=0.5", "--algo", "td3", "--seed", "0", "--dry-run", "--json"]
    assert main(["train", *typed, "--results", str(tmp_path)]) == 0
    assert run.id in capsys.readouterr().out


def test_repeated_seeds_and_names_are_one_run(tmp_path):
    file = tmp_path / "repeated.toml"
    file.write_text(
        'tasks = ["face_direction", "face_direction"]\nalgos = ["td3"]\nseeds = [0, 0, 1]\n'
        'representations = ["full", "planar", "planar12", "planar:12"]\n'
    )
    cells = cells_of(str(file), tmp_path)
    assert [cell.runs[0].representation for cell in cells] == ["full", "planar12"]
    assert [[run.seed for run in cell.runs] for cell in cells] == [[0, 1], [0, 1]]


def test_encoder_uses_dataset_and_options_of_file(tmp_path):
    def encoder(more):
        file = tmp_path / "encoded.toml"
        file.write_text(
            'tasks = ["face_direction"]\nalgos = ["td3"]\nrepresentations = ["dae:5"]\n' + more
        )
        (cell,) = cells_of(str(file), tmp_path)
        assert cell.runs[0].representation == "dae5"
        (encoder,) = cell.encoders
        return encoder

    plain = encoder("")
    assert encoder("") == plain
    other = encoder("[encoder.options.dae]\nepochs = 3\n")
    assert (other.options["epochs"], other.dataset) == (3, plain.dataset)
    assert encoder("[dataset]\nsteps = 2e4\n").dataset != plain.dataset
    assert len({plain.id, other.id, encoder("[encoder]\nseed = 1\n").id}) == 3


def test_size_of_planar_and_scaled_follows_from_task(tmp_path):
    file = tmp_path / "planar.toml"
    file.write_text(
        'tasks = ["face_direction", "move_to_pose"]\nalgos = ["td3"]\n'
        'representations = ["planar", "scaled"]\n'
    )
    sizes = [cell.runs[0].representation for cell in cells_of(str(file), tmp_path)]
    assert sorted(sizes) == ["planar12", "planar14", "scaled16", "scaled19"]


def test_documented_file_lists_all_keys_with_defaults(tmp_path):
    text = code_of("sweeps.md", "toml")
    content = tomllib.loads(text.replace("# augment =", "augment ="))  # TOML has no none
    assert set(content) == set(Matrix.model_fields)
    file = tmp_path / "documented.toml"
    file.write_text(text)
    short = tmp_path / "short.toml"
    short.write_text('tasks = ["face_direction"]\nalgos = ["ddpg", "td3"]\nenvironments = 1\n')
    written, defaults = cells_of(str(file), tmp_path), cells_of(str(short), tmp_path)
    assert written == defaults
    documented = (ROOT / "docs" / "sweeps.md").read_text()
    assert [f"`{name}`" in documented for name in SWEEPS] == [True] * len(SWEEPS)


DIGITS = "9" * 5000  # more than Python reads as a number


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("[ofe]\nx = 1", "Unknown setting of ofe 'x'; choose"),
        ("task = []", "Unknown key 'task'; did you mean tasks? Choose steps, engine,"),
        (
            'tasks = ["face_direktion"]',
            "Unknown task 'face_direktion'; did you mean face_direction?",
        ),
        ('algos = ["td4"]', "Unknown algorithm 'td4'; did you mean td3?"),
        (
            'engine = "bached"',
            "engine of the matrix can't be 'bached': it should be 'batched', 'sb3'",
        ),
        ('representations = ["dea12"]', "Unknown representation 'dea12'; did you mean dae12?"),
        ('representations = ["planar8"]', "planar of face_direction has 12 latents"),
        (f'representations = ["ofe{DIGITS}"]', "it should be less than or equal to 1000"),
        (f"steps = {DIGITS}", "is not TOML"),
        ('representations = ["dae17"]', "dae encoder of face_direction has 1 to 16 latents"),
        ('representations = ["move_to_pose/dae12/s00-12345678"]', "is of move_to_pose, which is"),
        ('representations = ["face_direction/dae12/s00-12345678"]', "No encoder face_direction/"),
        ('seeds = "3-1"', "wrong.toml: seeds 3-1: type seeds like 0-9"),
        ("seeds = [-1]", "seeds.0 of the matrix can't be -1"),
        ("steps = 999", "type 1000 or more"),
        ("steps = 1e300", "it should be less than or equal to 1000000000000000"),
        ("evaluation = 3", "write [evaluation] and its keys below it"),
        ("[evaluation]\nevry = 3", "[evaluation] has no key evry; did you mean every?"),
        ("[hyperparameters.td3]\ntua = 0.1", "td3 has no setting tua; did you mean tau?"),
        ("[hyperparameters.td3]\ntau = 2", "tau of td3 can't be 2"),
        ("[hyperparameters.ddpg]\ntau = 0.1", "is for ddpg, which is not among the algos"),
        ("[encoder.options.dae]\nepoch = 2", "dae has no option epoch; did you mean epochs?"),
        ("[dataset]\nsteps = 1500", "must be a multiple, such as 2000"),
        (f"tasks = {'[' * 10_000}", "is not TOML"),
    ],
)
def test_invalid_value_is_reported_in_one_line(line, says, tmp_path):
    content = {"tasks": '["face_direction"]', "algos": '["td3"]', "representations": '["dae3"]'}
    content.pop(line.split(" =")[0], None)
    file = tmp_path / "wrong.toml"
    file.write_text("\n".join([*(f"{key} = {value}" for key, value in content.items()), line]))
    with pytest.raises(RequestError) as raised:
        cells_of(str(file), tmp_path)
    assert str(raised.value).startswith(str(file))
    assert says in str(raised.value)
    assert "\n" not in str(raised.value)


def test_unknown_or_unreadable_matrix_is_refused(tmp_path):
    with pytest.raises(
        RequestError, match=r"Unknown matrix 'fig6'; did you mean fig\d\? .*FILE\.toml"
    ):
        read_matrix("fig6")
    with pytest.raises(RequestError, match=r"gone\.toml can't be read \(No such file"):
        read_matrix(str(tmp_path / "gone.toml"))
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(RequestError, match=r"bytes\.toml can't be read \(it is not text"):
        read_matrix(str(tmp_path / "bytes.toml"))


def test_file_without_its_ending_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("")
    with pytest.raises(RequestError, match=r"Unknown matrix 'mine'; .*; or type mine\.toml\."):
        read_matrix("mine")
