"""Users' code that changes: another experiment in every verb, by whichever of its files."""

import json
import re
from functools import cache
from itertools import product

import pytest

from jbench.store import Results, locks
from tests.command_line import Process, kill_when, start, wait_until
from tests.user_code import EDITS, KINDS, SHORT_RUN, TASK, Project, words

DATE = r"\(\d{4}-\d\d-\d\d \d\d:\d\d UTC\)"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Returns a function that returns a project of a kind with two runs, which is made once."""
    return cache(lambda kind: Project.new(tmp_path_factory.mktemp("made") / kind, kind))


def check_train(project, edited):
    before, manifests = set(project.runs()), project.manifests()
    if project.kind not in ("loop", "encoder"):  # the one has no such command, the other is new
        planned = words(project.succeed(*project.training("--dry-run")).stdout)
        assert f"{edited} has changed since 2 runs were recorded" in planned
    printed = words(project.make())
    after = set(project.runs())
    assert before < after
    assert len(after) == 4
    assert f"{edited} has changed since" in printed
    assert "runs are already finished" not in printed
    assert manifests.items() <= project.manifests().items()  # what was there stays as it was
    assert "already finished" in words(project.make()) or project.kind == "loop"
    assert set(project.runs()) == after


def check_resume(project, edited):
    """A run whose state was kept is not continued, unless the changed code is accepted."""
    (project.folder / f"{project.owner}.py").touch()
    longer = project.training("--seeds", "0", "--steps", "400")
    before = set(project.runs())
    run = next(id for id in before if "/s00-" in id)
    printed = words(project.succeed(*longer).stdout)
    assert re.search(f"{edited} has changed since the run {run} was recorded {DATE}", printed)
    assert "so its seed trains from the beginning under another id" in printed
    (new,) = project.runs().keys() - before
    assert "continued" not in project.runs()[new].manifest.provenance
    printed = words(project.succeed(*longer, "--accept-changed-code").stdout)
    assert "already finished" in printed  # a run of the present code exists
    assert set(project.runs()) == before | {new}


def check_accepted(project, edited):
    """A run that goes on with changed code holds both checksums, and has a curve of its own."""
    before = project.runs()
    longer = project.training("--seeds", "0", "--steps", "400", "--accept-changed-code")
    project.succeed(*longer)
    (new,) = project.runs().keys() - before.keys()
    run, origin = project.runs()[new], next(r for id, r in before.items() if "/s00-" in id)
    settings = dict(run.settings)
    accepted = settings.pop("accepted")
    assert settings == {**origin.settings, "steps": 400}
    (continued,) = run.manifest.provenance["continued"]
    assert (continued["run"], continued["control_steps"]) == (origin.id, 200)
    key = "task_sources" if project.kind == "task" else "sources"
    then, now = run.manifest.provenance[key], continued["code"][key]
    assert [name for name in now if now[name] != then[name]] == [edited]
    assert "already finished" in words(project.succeed(*longer).stdout)
    rows = project.document("report", "--format", "svg")["configurations"]
    assert {row["configuration"] for row in rows if accepted[:6] in row["configuration"]}
    assert f"run {new}" not in project.succeed("verify").stdout
    returns = {run["run"]: run["variant"] for run in project.document("runs")["runs"]}
    assert f"changed code {accepted[:6]}" in returns[new]


def check_evaluate(project, edited):
    run = min(project.runs())
    returns = project.document("runs", "--returns")["runs"]
    done = project.type("evaluate", run, "--episodes", "2")
    if project.kind in ("rule", "agent"):  # a saved policy runs without their code
        assert done.returncode == 0, done.stderr
        return
    assert done.returncode == 2
    assert re.search(f"{edited} has changed since the run {run} was recorded {DATE}", done.stderr)
    assert done.stderr.count("\n") == 1
    accepted = project.succeed("evaluate", run, "--episodes", "2", "--accept-changed-code")
    assert "with changed code" in accepted.stdout
    assert project.document("runs", "--returns")["runs"] == returns
    if project.kind == "task":
        check_export(project, edited, run)


def check_export_is_refused(project, edited, run):
    done = project.type("export", run, "--out", "policy.onnx")
    assert done.returncode == 2
    assert re.search(f"{edited} has changed since the run {run} was recorded {DATE}", done.stderr)
    assert not (project.folder / "policy.onnx").exists()


def check_export(project, edited, run):
    check_export_is_refused(project, edited, run)
    accepted = ("--accept-changed-code", "--json")
    done = project.succeed("export", run, "--out", "policy.onnx", *accepted)
    assert "robot:Robot, with changed code" in done.stderr
    assert len(json.loads(done.stdout)["accepted"]) == 8


def check_reproduce(project, edited):
    run = min(project.runs())
    episodes = ("--episodes", "0") if project.kind == "loop" else ("--episodes", "1")
    done = project.type("reproduce", run, *episodes)
    assert done.returncode == 2
    assert re.search(f"{edited} has changed since the run {run} was recorded {DATE}", done.stderr)
    done = project.type("reproduce", run, *episodes, "--accept-changed-code")
    printed = words(done.stdout + done.stderr)
    assert f"The code has changed: {edited} has changed" in printed
    assert "altered" not in printed


def check_report(project, edited):
    project.make()
    rows = evaluations_of(project)
    assert [row["seeds"] for row in rows] == [2, 2]
    names = [row["configuration"] for row in rows]
    assert len(set(names)) == 2
    assert all(re.search(r"code [0-9a-f]{6} of \d{4}-\d\d-\d\d", name) for name in names)
    if project.kind != "encoder":  # each curve has its encoder
        assert all(f"{edited} has changed between these runs" in row["note"] for row in rows)


def check_verify(project, edited):
    done = project.succeed("verify")
    if project.kind == "encoder":
        (encoder,) = Results(project.results).scan("encoder")[0]
        assert f"encoder {encoder.id}, of" in done.stdout
    assert all(f"run {run}, of" in done.stdout for run in project.runs())
    assert f"{edited} has changed since then." in words(done.stdout)
    assert re.search(r"About your code: that of \d records? has changed, see", words(done.stdout))
    assert "all of them intact" in words(done.stdout)
    repeated = words(project.type("verify", "--reevaluate").stdout)
    if project.kind != "agent":
        assert "not comparable: The code has changed" in repeated


def check_merge(project, edited):
    other = Project(project.folder.with_name("other"), project.kind)
    other.folder.mkdir()
    for path in project.folder.glob("*.*"):
        (other.folder / path.name).write_bytes(path.read_bytes())
    other.make()
    project.succeed("merge", other.results)
    assert len(project.runs()) == 4
    project.succeed("merge", other.results)
    (other.folder / f"{project.owner}.py").unlink()
    printed = words(other.succeed("verify").stdout)
    assert "its code is not at hand" in printed
    assert re.search(r"About your code: that of \d records? is not at hand, see", printed)


def check_sweep(project, edited):
    algo = {"rule": "rule:Rule", "agent": "agent:Agent"}.get(project.kind, "td3")
    small = '"hidden_layers" = [8]\n' if algo == "td3" else ""
    learning = "batch_size = 8\nlearning_starts = 20\ntrain_freq = 20\ngradient_steps = 1\n"
    table = f'[hyperparameters."{algo}"]\n{small}{learning}' if algo != "agent:Agent" else ""
    (project.folder / "own.toml").write_text(
        f'tasks = ["robot:Robot"]\nalgos = ["{algo}"]\nrepresentations = ["full"]\n'
        f"seeds = [0, 1]\nsteps = 200\n{table}[evaluation]\nepisodes = 1\nevery = 100\n"
    )
    printed = words(project.succeed("sweep", "own.toml").stdout)
    assert f"{edited} has changed since" in printed
    assert len(project.runs()) == 4
    assert "2 of 2 runs are already finished" in words(project.succeed("sweep", "own.toml").stdout)


VERBS = {
    "train": check_train,
    "resume": check_resume,
    "accept": check_accepted,
    "evaluate": check_evaluate,
    "reproduce": check_reproduce,
    "report": check_report,
    "verify": check_verify,
    "merge": check_merge,
    "sweep": check_sweep,
}

DIAGONAL = (
    ("task", "import", "train"),
    ("encoder", "data", "evaluate"),
    ("loop", "import", "verify"),
)


def is_possible(kind, edit, verb):
    """Returns whether a verb takes runs of a kind of code.

    Recorded loops start over, and other encoders make other runs. Only encoders with an entry point
    are in a matrix.
    """
    return kind not in ("loop", "encoder") or verb not in ("resume", "accept", "sweep")


@pytest.mark.parametrize(("kind", "edit", "verb"), DIAGONAL)
def test_changed_code_is_another_experiment(made, kind, edit, verb, tmp_path):
    project = made(kind).copy(tmp_path / "project")
    VERBS[verb](project, project.edit(edit))


def test_policy_of_changed_code_is_not_exported(made, tmp_path):
    project = made("task").copy(tmp_path / "project")
    check_export_is_refused(project, project.edit("module"), min(project.runs()))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "edit", "verb"),
    [combination for combination in product(KINDS, EDITS, VERBS) if is_possible(*combination)],
)
def test_changed_code_is_another_experiment_in_every_verb(made, kind, edit, verb, tmp_path):
    project = made(kind).copy(tmp_path / "project")
    VERBS[verb](project, project.edit(edit))


@pytest.mark.parametrize(
    "kind", ["task", *(pytest.param(kind, marks=pytest.mark.slow) for kind in KINDS[1:])]
)
def test_comments_and_formatting_are_no_change(made, kind, tmp_path):
    project = made(kind).copy(tmp_path / "project")
    before = set(project.runs())
    project.comment()
    assert "has changed" not in project.make()
    assert set(project.runs()) == before
    assert "About your code" not in project.succeed("verify").stdout


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["task", "rule", "agent"])
def test_interrupted_run_of_other_code_is_resumed_only_if_that_is_accepted(made, kind, tmp_path):
    project = made(kind).copy(tmp_path / "project")
    training = project.training("--seeds", "7", "--steps", "3000")
    process = start(*training, "--checkpoint-every", "0", cwd=project.folder)

    def of_seed(project):
        return {id: run for id, run in project.runs().items() if "/s07-" in id}

    kill_when(lambda: any(run.roles() for run in of_seed(project).values()), process)
    (begun,) = of_seed(project).values()
    wait_until(lambda: not locks.is_held(begun.path))
    begun.refresh()
    assert begun.status == "unfinished"
    edited = project.edit("module")
    other = project.copy(tmp_path / "other")

    manifest = (begun.path / "manifest.json").read_bytes()
    printed = words(project.succeed(*training).stdout)
    assert re.search(f"{edited} has changed since the run {begun.id} was recorded {DATE}", printed)
    assert (
        "so its seed trains from the beginning under another id; --accept-changed-code" in printed
    )
    (new,) = of_seed(project).keys() - {begun.id}
    assert "continued" not in project.runs()[new].manifest.provenance
    assert (begun.path / "manifest.json").read_bytes() == manifest

    other.succeed(*training, "--accept-changed-code")
    (id,) = of_seed(other).keys() - {begun.id}
    resumed = other.runs()[id]
    assert (resumed.status, resumed.rows("episodes")) == ("finished", 30)
    settings = dict(resumed.settings)
    assert settings.pop("accepted")
    assert settings == begun.settings
    (continued,) = resumed.manifest.provenance["continued"]
    assert continued["run"] == begun.id
    assert 0 < continued["control_steps"] < 3000


@pytest.mark.slow
def test_dataset_of_other_code_is_another_one(made, tmp_path):
    project = made("task").copy(tmp_path / "project")
    collect = ("collect", *TASK, "--steps", "300")
    project.succeed(*collect)
    (before,) = Results(project.results).scan("dataset")[0]
    edited = project.edit("import")
    changed = f"{edited} has changed since the dataset {before.id} was recorded {DATE}"
    done = project.type("train-encoder", *TASK, "--kind", "pca", "--latent", "2")
    assert done.returncode == 2
    assert re.search(changed, words(done.stderr))

    assert re.search(changed, words(project.succeed(*collect).stdout))
    assert "already" in words(project.succeed(*collect).stdout)
    records = Results(project.results).scan("dataset")[0]
    assert len(records) == 2
    assert before.id in {record.id for record in records}
    project.succeed("train-encoder", *TASK, "--kind", "pca", "--latent", "2")


@pytest.mark.slow
def test_script_around_a_recording_separates_nothing(made, tmp_path):
    """It often holds the seed."""
    project = made("loop").copy(tmp_path / "project")
    before = project.runs()
    script = project.folder / "loop.py"
    script.write_text(script.read_text().replace("[0.1]", "[0.2]"))
    Process("tests.user_code:run_loop", "3", cwd=project.folder).finished()
    assert len(project.runs()) == len(before) + 1
    checksums = {run.manifest.provenance["script_sha256"] for run in project.runs().values()}
    assert len(checksums) == 2
    (row,) = evaluations_of(project)
    assert row["seeds"] == 3
    assert "code" not in row["configuration"]
    assert "About your code" not in project.succeed("verify").stdout


@pytest.mark.slow
def test_training_says_that_its_encoder_is_of_data_of_other_code(made, tmp_path):
    project = made("task").copy(tmp_path / "project")
    project.succeed("collect", *TASK, "--steps", "300")
    project.succeed("train-encoder", *TASK, "--kind", "pca", "--latent", "2")
    agent = ("--algo", "td3", "--encoder", "pca2", "--seeds", "0")
    training = ("train", *TASK, *agent, *SHORT_RUN)
    assert "has changed" not in words(project.succeed(*training).stdout)
    project.edit("module")
    printed = words(project.succeed(*training).stdout)
    assert re.search(f"robot.py has changed since the dataset .* was recorded {DATE}", printed)
    assert "The encoder robot.Robot/pca2/" in printed


@pytest.mark.slow
def test_runs_of_older_versions_keep_their_ids_and_are_joined_by_more_seeds(made, tmp_path):
    project = made("task").copy(tmp_path / "project")
    project.age()
    old = set(project.runs())
    assert not any("sources" in run.settings["specs"] for run in project.runs().values())
    assert "2 of 2 runs are already finished; nothing to do" in words(project.make())
    printed = words(project.succeed(*project.training("--seeds", "0-2")).stdout)
    assert "has changed" not in printed
    (new,) = project.runs().keys() - old
    assert "sources" not in project.runs()[new].settings["specs"]
    assert project.runs()[new].manifest.provenance["task_sources"]
    assert "About your code" not in project.succeed("verify").stdout
    (row,) = evaluations_of(project)
    assert row["seeds"] == 3

    project.edit("module")
    printed = words(project.make())
    assert "robot.py has changed since 3 runs were recorded" in printed
    assert len(project.runs()) == 5
    assert sorted(row["seeds"] for row in evaluations_of(project)) == [2, 3]


@pytest.mark.slow
def test_runs_that_an_older_version_pooled_are_two_curves(made, tmp_path):
    project = made("task").copy(tmp_path / "project")
    project.age()
    run = max(project.runs().values(), key=lambda record: record.id)
    path = run.path / "manifest.json"
    text = path.read_text()
    (checksum,) = {json.loads(text)["provenance"]["task_source_sha256"]}
    path.write_text(text.replace(checksum, "0" * 64))
    rows = evaluations_of(project)
    assert [row["seeds"] for row in rows] == [1, 1]
    assert all("code of " in row["configuration"] for row in rows)
    # A seed that is new can't be said to join either.
    project.succeed(*project.training("--seeds", "5"))
    assert len(evaluations_of(project)) == 3


def evaluations_of(project):
    """Returns the rows of the report's configurations with evaluation returns."""
    rows = project.document("report", "--format", "svg")["configurations"]
    return [row for row in rows if row["returns"] == "evaluation"]


@pytest.mark.slow
def test_keys_of_a_newer_version_refuse_nothing(made, tmp_path):
    project = made("task").copy(tmp_path / "project")
    for record in project.runs().values():
        path = record.path / "manifest.json"
        manifest = json.loads(path.read_text())
        manifest["provenance"] |= {"task_colors": {"a": 1}, "task_sources": "of another kind"}
        path.write_text(json.dumps(manifest))
    assert "already finished" in words(project.make())
    project.succeed("evaluate", min(project.runs()), "--episodes", "1")
    project.succeed("verify")
