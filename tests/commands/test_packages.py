"""Tests of agents, update rules and policies of installed third-party packages."""

import hashlib
import json
import re
import shutil
import signal

import pytest

from jbench.agents.algorithms import algorithm_fields
from jbench.cli import main
from jbench.policies.network import WEIGHTS
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.store.rows import has_policy
from jbench.training.batched_run import run_batch
from jbench.training.events import Resumed
from tests.command_line import SHORT, Process, jbench, succeed
from tests.commands.distributions import install, make_importable
from tests.short_episodes import shorten_episodes
from tests.training.small_runs import resumed, rows
from tests.user_code import words

NAME = "random_search:RandomSearch"
"""The agent without its entry point."""

SMALL = {
    "hidden_layers": [8],
    "batch_size": 8,
    "learning_starts": 60,
    "train_freq": 10,
    "gradient_steps": 2,
}
SETTINGS = {"random-search": {"noise": 0.2}, "tqc": {**SMALL, "quantiles": 5}}
"""Those of the runs that are trained and swept, by the algorithms of the packages."""

ABOUT = {
    "random-search": ("plugin", "random-search-agent", "random-search-agent 1.0"),
    "tqc": ("batched", "tqc-rule", "tqc-rule 2.1"),
}
"""Engine, package, and package with its version."""


def matrix(settings):
    """The text of a matrix with settings by algorithm, whose runs have one short episode."""
    lines = ['tasks = ["face_direction"]', f"algos = {[*settings]}", 'seeds = "0-1"']
    lines += [f"steps = {SHORT}", "evaluation.episodes = 1"]
    for algo, chosen in settings.items():
        lines += [f"hyperparameters.{algo!r}.{name} = {value}" for name, value in chosen.items()]
    return "\n".join(lines)


def typed(algo, settings, seeds):
    """Arguments that train the same."""
    where = ("--seeds", seeds, "--steps", SHORT, "--evaluate-episodes", "1")
    chosen = [f"--set={name}={json.dumps(value)}" for name, value in settings.items()]
    return ("train", "--algo", algo, *where, *chosen)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder with both packages."""
    folder = install("third_party_agent", "your-own-agent.md", "random_search.py", tmp_path_factory)
    return install(
        "third_party_rule",
        "your-own-rule.md",
        "tqc.py",
        tmp_path_factory,
        target=folder,
        part="class TQC",
    )


@pytest.fixture
def installed(site, monkeypatch):
    make_importable(site, monkeypatch)


ABOUT_RUN = {"task": "face_direction", "seed": 0, "steps": 400, "evaluate_every": 150}


def agent_run(algo="random-search", package="random-search-agent"):
    settings = {"engine": "plugin", "package": package, "hyperparameters": {"noise": 0.5}}
    return RunSettings(**ABOUT_RUN, algo=algo, evaluate_episodes=1, **settings)


def rule_run(algo="tqc"):
    fields = algorithm_fields(algo, overrides=SMALL)
    return RunSettings(**ABOUT_RUN, evaluate_episodes=1, **fields)


@pytest.fixture(scope="module")
def swept(site, tmp_path_factory):
    """Results of a sweep with two seeds of each, the first of them trained by `jbench train`."""
    place = tmp_path_factory.mktemp("swept")
    (place / "matrix.toml").write_text(matrix(SETTINGS))
    with pytest.MonkeyPatch.context() as patch:
        make_importable(site, patch)
        for algo, chosen in SETTINGS.items():
            succeed(*typed(algo, chosen, "0"), results=place / "results", short=True)
        succeed("sweep", place / "matrix.toml", results=place / "results", short=True)
    return Results(place / "results")


def test_train_and_sweep_make_same_runs(swept):
    runs, problems = swept.scan("run")
    assert not problems
    made = sorted((run.settings["algo"], run.settings["seed"]) for run in runs)
    assert made == [(algo, seed) for algo in SETTINGS for seed in (0, 1)]
    for run in runs:
        assert run.status == "finished"
        assert (run.rows("episodes"), run.rows("evaluations")) == (1, 1)
        assert has_policy(run)
        engine, package, version = ABOUT[run.settings["algo"]]
        assert (run.settings["engine"], run.settings["package"]) == (engine, package)
        assert run.manifest.provenance["package"] == version
        chosen = run.settings["hyperparameters"]
        assert chosen.items() >= SETTINGS[run.settings["algo"]].items()
        if engine == "batched":
            assert (chosen["dropped"], chosen["tau"]) == (2, 0.005)
            (episode,) = run.read("episodes").to_pylist()
            assert episode["critic_loss"] > 0
            assert episode["entropy_coefficient"] is None


def test_trained_policy_of_rule_is_evaluated_and_reevaluated(
    swept, installed, document, run_command, monkeypatch
):
    shorten_episodes(monkeypatch.setattr, SHORT)
    run = next(run for run in swept.scan("run")[0] if run.settings["algo"] == "tqc")
    for policy, wanted in ((run.id, ""), ("bang-bang", "random-search-agent 1.0")):
        command = ("evaluate", policy, "--task", "face_direction", "--episodes", "1")
        made = document(*command, results=swept.path)
        assert (made["settings"].get("code") or "") == wanted
    code, printed, _ = run_command("verify", "--reevaluate", results=swept.path)
    assert (code, "equal" in printed) == (0, True)
    assert run_command("reproduce", run.id, "--episodes", "1", results=swept.path)[0] == 0


def test_runs_of_uninstalled_packages_are_listed_reported_and_verified(swept, capsys, refused):
    here = ("--results", str(swept.path))
    assert main(["runs", *here]) == main(["verify", *here]) == 0
    listed = capsys.readouterr().out
    assert all(f"face_direction/{algo}/full/s00-" in listed for algo in SETTINGS)
    report = ("report", "--json", "--format", "png", "--out", swept.path / "out")
    printed = json.loads(succeed(*report, results=swept.path, short=True).stdout)
    configurations = printed["configurations"]
    assert {(row["algo"], row["seeds"]) for row in configurations} == {(n, 2) for n in SETTINGS}
    # Saved policies are layers, which act without the code that trained them.
    repeated = jbench("verify", "--reevaluate", "--json", results=swept.path, short=True)
    parts = json.loads(repeated.stdout)["reevaluations"]
    assert {part["run"] for part in parts} == {run.id for run in swept.scan("run")[0]}
    for part in parts:
        assert part["verdict"] in ("equal", "not comparable")
        if "tqc" in part["run"] and part["verdict"] != "equal":
            rounded = r"Without tqc, which .* (\S+) here, and (\S+) was"
            ((computed, recorded),) = re.findall(rounded, part["reason"])
            assert float(computed) == pytest.approx(float(recorded), rel=0.1)
    before = sorted(swept.path.rglob("*"))
    for algo in SETTINGS:
        error = refused("train", "--algo", algo, results=swept.path)
        assert f"Unknown algorithm {algo!r}" in error
    error = refused("train", "--algo", "random-search", results=swept.path)
    assert "install the package of another agent, or type MODULE:CLASS." in error
    assert sorted(swept.path.rglob("*")) == before


@pytest.mark.slow
def test_edited_package_is_another_experiment(site, tmp_path, monkeypatch):
    packages = tmp_path / "site-packages"
    shutil.copytree(site, packages)
    make_importable(packages, monkeypatch)
    results = Results(tmp_path / "results")
    training = typed("random-search", SETTINGS["random-search"], "0")
    succeed(*training, results=results.path, short=True)
    (before,) = results.scan("run")[0]
    assert before.manifest.provenance["package"] == "random-search-agent 1.0"

    module = packages / "random_search.py"
    module.write_text(f"{module.read_text()}\n\nVERSION = 2\n")
    printed = words(succeed(*training, results=results.path, short=True).stdout)
    assert f"random_search.py has changed since the run {before.id} was recorded" in printed
    assert len(results.scan("run")[0]) == 2
    assert f"run {before.id}, of" in succeed("verify", results=results.path, short=True).stdout


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("random-search", "--set", "noise=-1"), "noise of random-search can't be -1: .*greater"),
        (("random-search", "--set", "nose=1"), "has no setting nose; did you mean noise"),
        (("random-search", "--settings", "sb3"), "no settings sb3 for random-search.*own defaults"),
        (("without-state", "--keep-state"), "has no state and restore; leave --keep-state out"),
        (("tqc", "--set", "quantiles=0"), "quantiles of tqc can't be 0: .*greater"),
        (("tqc", "--set", "quantile=9"), "tqc has no setting quantile; did you mean quantiles"),
        (("tqc", "--settings", "sb3"), "no settings sb3 for tqc: it has its own defaults"),
        (("tqc", "--engine", "sb3"), "tqc has the engine batched, not sb3"),
        (("tqc", "--encoder", "ofe12"), "of the batched engine, not for tqc"),
        (("tqc", "--precision", "bfloat16"), "tqc does not learn in bfloat16"),
        (("random-search", "--engine", "batched"), "has the engine plugin, not batched"),
        (("random-search", "--encoder", "ofe12"), "of the batched engine, not for random-search"),
        (("td3", "--engine", "plugin"), "td3 has the engine batched or sb3, not plugin"),
        (("random-serch",), "did you mean random-search"),
        (("sb3_contrib:TQC", "--engine", "plugin"), "has the engine sb3, not plugin"),
        (("nowhere:TQC",), "there is no module nowhere"),
        (("math:cos",), r"no subclass of jbench\.Agent, jbench\.Rule or stable-b"),
    ],
)
def test_invalid_request_is_refused(installed, arguments, sentence, tmp_path, refused):
    error = refused("train", "--algo", *arguments, results=tmp_path / "results")
    assert re.search(sentence, error)
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    ("algo", "sentence"),
    [
        ("broken", "The agent broken can't be loaded from other_agents:Missing"),
        ("no-agent", "act and learn; fix it, or uninstall the package that offers it."),
        ("jbench:Agent", "no subclass of jbench.Agent with explore, act and learn; fix it."),
        ("no-settings", "Settings of the agent no-settings is no subclass of jbench.AgentSettings"),
    ],
)
def test_entry_point_that_is_not_an_agent_is_refused(installed, algo, sentence, tmp_path, refused):
    assert sentence in refused("train", "--algo", algo, results=tmp_path / "results", code=1)


@pytest.mark.parametrize(
    ("make", "algo", "sentence", "episodes"),
    [
        (agent_run, "unknown-loss", "learn of the agent unknown-loss returned the loss q_loss", 0),
        (agent_run, "not-finite-weights", "its weights are not finite at control step 50", 1),
        (rule_run, "no-actor", "The rule NoActor can't be trained: its actor is no nn.Seque", 0),
        (rule_run, "not-finite", "its critic_loss is not finite after update 2, at control st", 1),
    ],
)
def test_faulty_class_fails_its_run(
    installed, make, algo, sentence, episodes, tmp_path, monkeypatch
):
    shorten_episodes(monkeypatch.setattr)
    run, results = make(algo), Results(tmp_path)
    try:
        reason = str(run_batch([run], results, checkpoint_every=0)[run.id])
    except (RuntimeError, ValueError) as error:
        reason = str(error)
    record = results.find("run", run.id)
    assert sentence in reason
    assert sentence in record.manifest.summary["error"]
    assert (record.status, record.rows("episodes")) == ("failed", episodes)


def test_error_of_agent_is_a_sentence_before_the_traceback(installed, tmp_path):
    done = jbench(*typed("raises", {}, "0-1"), results=tmp_path, short=True)
    assert done.returncode == 1
    lines = [line for line in done.stderr.splitlines() if not line.startswith(" ")]
    error = "AttributeError: 'Raises' object has no attribute 'missing'"
    # The line is that of a file which is not installed.
    line_of_it = r"(, line \d+ of \w+\.py)?"
    sentence = rf"failed: learn of the agent raises failed \({re.escape(error)}{line_of_it}\)\.$"
    assert [re.search(sentence, line) is not None for line in lines[:2]] == [True, False]
    # The same traceback of the second run is not shown again.
    assert done.stderr.count("Traceback (most recent call last):\n") == 1
    assert lines.index("Traceback (most recent call last):") < lines.index(error)
    assert "Next:" not in done.stdout


@pytest.mark.slow
def test_run_killed_at_random_moments_resumes_bit_for_bit(installed, tmp_path):
    run = agent_run(NAME, package=None)
    request = {"path": str(tmp_path), "runs": [run.model_dump(mode="json")]}
    request["at"] = "random"
    request["kills"] = 4
    done = Process("tests.training.kills:main", request, short=True).finished()
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert (answer["kills"], answer["problems"]) == (4, [])
    # Some kills were in the middle of the run.
    assert {steps for folder in answer["steps"] for (steps,) in folder} & set(range(50, 400, 50))
    whole = Results(tmp_path / "whole").find("run", run.id)
    for folder in range(answer["folders"]):
        record = Results(tmp_path / str(folder)).find("run", run.id)
        assert rows(record) == rows(whole)
        assert record.read_file(WEIGHTS) == whole.read_file(WEIGHTS)


def test_interrupted_run_without_agent_state_restarts_with_notice(installed, tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    run, results = agent_run("without-state"), Results(tmp_path)

    def stop(event):
        if event.control_steps == 200:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_batch([run], results, checkpoint_every=0, report=stop)
    assert results.find("run", run.id).rows("episodes") == 3
    events = []
    run_batch([run], results, report=events.append)
    reason = "The agent without-state has no state and restore, so its runs can't be resumed."
    assert resumed(events, [run]) == [(run.seed, 0, reason)]
    record = results.find("run", run.id)
    assert record.read("episodes")["episode"].to_pylist() == list(range(8))


def test_class_of_working_directory_is_named_without_entry_point(site, tmp_path):
    shutil.copy(site / "random_search.py", tmp_path)
    (tmp_path / "one.toml").write_text(matrix({NAME: {"noise": 0.2}}))
    results = tmp_path / "results"
    done = jbench("sweep", "one.toml", results=results, cwd=tmp_path, short=True)
    assert done.returncode == 0, done.stderr
    command = typed(NAME, {"noise": 0.2}, "0-1")
    again = jbench(*command, results=results, cwd=tmp_path, short=True)
    assert "2 of 2 runs are already finished" in again.stdout
    runs, _ = Results(results).scan("run")
    checksum = hashlib.sha256((tmp_path / "random_search.py").read_bytes()).hexdigest()
    for run in runs:
        assert run.id.startswith("face_direction/random_search.RandomSearch/full/s0")
        assert (run.settings["algo"], run.settings["hyperparameters"]["noise"]) == (NAME, 0.2)
        assert run.manifest.provenance["source_sha256"] == checksum
        assert (run.settings["engine"], run.settings.get("package")) == ("plugin", None)


def test_algorithms_are_listed_with_settings_and_packages(installed, document, run_command):
    # Some entry points of the packages can't be loaded.
    printed = document("algorithms", code=1)
    listed = {entry["name"]: entry for entry in printed["algorithms"]}
    assert {"ddpg", "ppo", "sac", "td3", "random-search"} <= set(listed)
    assert listed["random-search"] == {
        "name": "random-search",
        "engine": "plugin",
        "package": "random-search-agent 1.0",
        "description": (
            "Changes a linear policy at random before each episode, and keeps the best one."
        ),
        "settings": [
            {"name": "noise", "default": 0.5, "description": "standard deviation of a change"}
        ],
    }
    td3 = {setting["name"]: setting["default"] for setting in listed["td3"]["settings"]}
    assert (td3["tau"], td3["hidden_layers"]) == (0.005, [350, 250])
    broken = {entry["name"] for entry in printed["broken"]}
    assert {"broken", "no-agent", "no-settings"} <= broken
    assert not broken & {"random-search", "tqc"}
    code, out, _ = run_command("algorithms", "sb3_contrib:TQC")
    assert (code, "top_quantiles_to_drop_per_net" in out) == (0, True)


@pytest.mark.slow
def test_killed_run_of_rule_resumes_bit_for_bit(installed, tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    run = rule_run("tqc:TQC")  # without its entry point
    assert (run.engine, run.package) == ("batched", None)
    request = (str(tmp_path / "killed"), run.model_dump(mode="json"), "cpu", 200, False)
    done = Process("tests.agents.killed_run:main", *request, short=True).finished()
    assert done.returncode == -signal.SIGKILL
    events, records = [], []
    for name in ("whole", "killed"):
        results = Results(tmp_path / name)
        assert run_batch([run], results, report=events.append) == {}
        records.append(results.find("run", run.id))
    assert [event.control_steps for event in events if isinstance(event, Resumed)] == [200]
    assert rows(records[0]) == rows(records[1])
    # 8 episodes, an evaluation of two, and the last evaluation, of as many as the training.
    assert len(rows(records[0])) == 8 + 2 + 8
    assert records[0].manifest.provenance["package"] == "tqc-rule 2.1"
    assert records[0].read_file(WEIGHTS) == records[1].read_file(WEIGHTS)


def test_algorithm_has_the_defaults_of_each_source(run_command):
    _, out, _ = run_command("algorithms", "td3")
    lines = [line for line in out.splitlines() if line.startswith("With --settings")]
    assert lines == [
        "With --settings script: initialization=glorot, learning_starts=9999.",
        "With --settings sb3: the same.",
        "With --settings suite (the default on other robots than the Jitterbug): train_freq=1, "
        "gradient_steps=1, hidden_layers=[256,256], learning_starts=1000, learning_rate=0.001, "
        "noise_sigma=0.1.",
    ]
