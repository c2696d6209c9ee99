"""Tests of `jbench check`: the examples of the documentation pass, and each defect is found."""

from importlib.metadata import EntryPoint

import numpy as np
import pytest
from torch import nn

import jbench
from jbench.checks import code
from jbench.checks.code import CheckRequest, check_code, kind_of_code
from jbench.errors import RequestError
from tests.documentation import ROOT, code_of

EXAMPLES = {
    "random_search": ("your-own-agent.md", "class "),
    "tqc": ("your-own-rule.md", "class TQC"),
    "third_party_encoder": ("your-own-encoder.md", "class FirstFeatures"),
}
"""The page of a module, and a part of its block."""


@pytest.fixture
def modules(tmp_path, monkeypatch):
    """The modules of the documentation and of the tests, in the working directory."""
    for module, (page, part) in EXAMPLES.items():
        (tmp_path / f"{module}.py").write_text(code_of(page, "python", part))
    for file in ROOT.glob("tests/third_party_*/*.py"):
        (tmp_path / file.name).write_text(file.read_text())
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.fixture
def states(document):
    """Returns a function: the state and the text of each check of a name."""

    def check(name, *more, code=0):
        told = document("check", name, *more, code=code)
        assert told["ok"] == (code == 0)
        return {line["name"]: (line["state"], line["text"]) for line in told["checks"]}

    return check


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("random_search:RandomSearch", "agent"),
        ("tqc:TQC", "rule"),
        ("third_party_encoder:FirstFeatures", "encoder"),
        ("own_tasks:Integrator", "task"),
        ("other_agents:bang_bang", "policy"),
        ("builtins:max", "policy"),
        ("pca", "encoder"),
    ],
)
def test_kind_of_code_is_found_out(modules, name, what):
    assert kind_of_code(name) == what


def test_task_is_checked_on_no_other(refused):
    error = refused("check", "dmc:cheetah-run", "--task", "face_direction")
    assert "dmc:cheetah-run is a task, which is checked on itself: leave --task out." in error


def test_agent_of_the_documentation_passes(modules, states):
    checked = states("random_search:RandomSearch")
    assert {name for name, (state, _) in checked.items() if state != "ok"} == {"learning"}
    assert "no losses" in checked["learning"][1]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["tqc:TQC", "third_party_encoder:FirstFeatures", "own_tasks:Integrator"]
)
def test_examples_of_the_documentation_pass(modules, states, name):
    assert {state for state, _ in states(name).values()} == {"ok"}


def test_policy_is_run_through_episodes(modules, states):
    assert states("other_agents:bang_bang")["episodes"][0] == "ok"


class Good(jbench.Agent):
    """A linear agent whose noise is drawn from its own generator; it learns nothing."""

    def __init__(self, settings, environment, seed, device):
        self.random = np.random.default_rng(seed)
        self.weights = self.random.normal(size=(environment.observation_size, 1))

    def explore(self, observations):
        return self.act(observations) + 0.1 * self.random.normal(size=(len(observations), 1))

    def act(self, observations):
        return np.tanh(observations @ self.weights)

    def learn(self, transition):
        return {"critic_loss": 0.5}

    def state(self):
        return {"random": self.random.bit_generator.state, "weights": self.weights}

    def restore(self, state):
        self.random.bit_generator.state = state["random"]
        self.weights = state["weights"]


class ForgetsNoise(Good):
    def restore(self, state):
        self.weights = state["weights"]


class IgnoresSeed(Good):
    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.random = np.random.default_rng()


class DrawsWhenItActs(Good):
    def act(self, observations):
        return np.tanh(observations @ self.weights + self.random.normal())


class ComparesRobots(Good):
    """Its policy subtracts the mean of the robots side by side, as batch normalization does."""

    def act(self, observations):
        return super().act(observations - observations.mean(0))


class ChangesWhenItActs(Good):
    """An evaluation changes its exploration."""

    def act(self, observations):
        if len(observations) > 1:
            self.random.normal()
        return super().act(observations)


class OtherPolicy(Good):
    def policy(self):
        return nn.Sequential(nn.Linear(len(self.weights), 1), nn.Tanh())


DEFECTS = {
    "ForgetsNoise": ("state", "state must return everything that changes"),
    "IgnoresSeed": ("seeds", "training again with the same seed gives other numbers"),
    "DrawsWhenItActs": ("actions", "act returns other actions for the same observations"),
    "ComparesRobots": ("actions", "another action for an observation beside others than alone"),
    "ChangesWhenItActs": ("evaluation", "evaluating between two steps changes the training"),
    "OtherPolicy": ("policy", "the saved policy acts differently from act"),
}
"""The check that fails, and what it says, by the class of the agent."""

FAST_DEFECTS = ("ForgetsNoise", "DrawsWhenItActs")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in FAST_DEFECTS else pytest.mark.slow)
        for name in DEFECTS
    ],
)
def test_defect_of_an_agent_is_found(states, monkeypatch, name):
    failing, sentence = DEFECTS[name]
    checked = states(f"{__name__}:{name}", code=1)
    assert checked[failing][0] == "fails"
    assert sentence in checked[failing][1]


def test_loss_without_a_column_ends_the_checks(modules, states):
    checked = states("other_agents:UnknownLoss", code=1)
    assert list(checked)[-1] == "learning"
    assert "returned the loss q_loss" in checked["learning"][1]


def test_reward_out_of_range_ends_the_checks(modules, states):
    checked = states("own_tasks:WrongReward", code=1)
    assert list(checked) == ["made", "episode"]
    assert "its reward is 1." in checked["episode"][1]


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        (["nowhere:Agent"], "there is no module nowhere"),
        (["lab/own.py:Agent"], "has the path of a file; type lab.own:Agent."),
        (["td3"], "td3 is jbench's own; type MODULE:CLASS of an algorithm of yours."),
        (["pcaa"], "There is no code called 'pcaa'; did you mean pca? Type"),
        (
            ["tests.odd_tasks.reach"],
            "There is no code called 'tests.odd_tasks.reach'; to use the module tests.odd_tasks, "
            "type tests.odd_tasks:reach.",
        ),
        (["pca", "--as", "robot"], "Unknown kind of code 'robot'; choose task, agent, rule"),
        (["sb3_contrib:TQC"], "type jbench train --algo sb3_contrib:TQC --seeds 0 --steps 4k"),
    ],
)
def test_wrong_request_is_refused(refused, typed, message):
    assert message in refused("check", *typed)


@pytest.mark.parametrize(
    ("module", "made_by", "kind"),
    [
        ("pendulum", 'gymnasium.make("Pendulum-v1")', "TimeLimit"),
        ("point", "own_tasks.Integrator()", "Integrator"),
    ],
)
def test_environment_object_is_refused_with_what_to_type(
    modules, tmp_path, refused, module, made_by, kind
):
    text = f"import gymnasium\nimport own_tasks\n\nenv = {made_by}\n"
    (tmp_path / f"{module}.py").write_text(text)
    assert (
        f"{module}:env is an environment of type {kind}, and jbench makes several: type "
        "MODULE:NAME of the function that returns it."
    ) in refused("check", f"{module}:env")
    assert f"type {module}:NAME, a function or a class in it." in refused("check", f"{module}.py")


@pytest.mark.parametrize(
    ("what", "option", "message"),
    [
        ("task", {"settings": {"x": 1}}, "x is a task, which has no settings: leave --set out."),
        ("policy", {"settings": {"x": 1}}, "x is a policy, which has no settings: leave --set"),
        ("rule", {"settings": {}, "latents": 3}, "x is no encoder: leave --latent out."),
    ],
)
def test_option_that_a_kind_of_code_lacks_is_refused(what, option, message):
    with pytest.raises(RequestError, match=message):
        check_code(what, CheckRequest("x", "face_direction", **option))


def test_installed_policy_is_found_by_its_name(monkeypatch):
    point = EntryPoint("mine", "my_module:policy", "jbench.policies")
    monkeypatch.setattr(code, "offered_policies", lambda: {"mine": point})
    assert kind_of_code("mine") == "policy"
