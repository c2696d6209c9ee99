"""Tests of the actions of what a caller trains, and of policies of other packages and modules."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import SAC
from torch import nn

from jbench.errors import RequestError, WorkError
from jbench.policies.actors import acting
from jbench.policies.code import policy_code
from jbench.policies.find import find_policy, is_imported_policy
from jbench.settings.records import EvaluationSettings
from jbench.store import Results

MODULE = """
import numpy as np
from torch import nn


def half(observations):
    return np.full((len(observations), 1), 0.5)


def strong(observations):
    return np.full((len(observations), 1), 2.0)


def flat(observations):
    return np.zeros(len(observations))


def not_finite(observations):
    return np.full((len(observations), 1), np.nan)


def ragged(observations):
    return [[0.5], [0.5, 0.5], [0.5]][: len(observations)] + [[]]


def text(observations):
    return [["half"]] * len(observations)


def nothing_returned(observations):
    return None


def wrong(observations):
    return observations["angle"]


class Counting:
    def __init__(self, task):
        self.value = len(task) / 100

    def reset(self, robots):
        self.steps = 0

    def act(self, observations):
        self.steps += 1
        return np.full((len(observations), 1), self.value * self.steps)


network = nn.Sequential(nn.Linear(16, 1), nn.Tanh())
number = 3
"""


def test_policy_of_stable_baselines3_acts_without_exploration():
    model = SAC(
        "MlpPolicy", gymnasium.make("jbench:Jitterbug/FaceDirection-v0"), buffer_size=1, seed=0
    )
    observations = np.random.default_rng(0).normal(size=(20, 16)).astype(np.float32)
    wanted, _ = model.predict(observations, deterministic=True)
    for actor in (model, model.policy, model.actor):
        with acting(actor, 1) as act:
            np.testing.assert_array_equal(act(observations), wanted)


def test_module_with_predict_of_its_own_is_called():
    class Constant(nn.Module):
        def forward(self, x):
            return x[:, :1] * 0 + 0.5

        def predict(self, x):
            raise AssertionError(x)

    with acting(Constant(), 1) as act:
        assert act(np.zeros((3, 16), np.float32)).tolist() == [[0.5]] * 3


def test_module_without_forward_is_refused():
    class ActorAndCritic(nn.Module):
        def __init__(self):
            super().__init__()
            self.actor_mean = nn.Linear(16, 1)

    agent = ActorAndCritic()
    refused = pytest.raises(RequestError, match=r"ActorAndCritic without forward can't act: pass")
    with refused, acting(agent, 1):
        pass
    with acting(agent.actor_mean, 1) as act:
        assert act(np.zeros((3, 16), np.float32)).shape == (3, 1)


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module in the working directory; returns its name."""
    name = f"policies_{tmp_path.name.replace('-', '_')}"
    (tmp_path / f"{name}.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return name


def named_policy(name):
    return find_policy(Results(Path()), name, "face_direction")


OBSERVATIONS = np.ones((3, 16), np.float32)


def test_function_class_and_torch_module_act(module):
    assert named_policy(f"{module}:half").act(OBSERVATIONS).tolist() == [[0.5]] * 3
    assert named_policy(f"{module}:strong").act(OBSERVATIONS).tolist() == [[1.0]] * 3
    counting = named_policy(f"{module}:Counting")
    counting.reset(3)
    # The class is called with the task's name, which has 14 letters.
    assert counting.act(OBSERVATIONS) == pytest.approx(np.full((3, 1), 0.14))
    assert counting.act(OBSERVATIONS) == pytest.approx(np.full((3, 1), 0.28))
    assert named_policy(f"{module}:network").act(OBSERVATIONS).shape == (3, 1)


@pytest.mark.parametrize(
    ("name", "error", "sentence"),
    [
        ("flat", RequestError, r"returned the shape \(1,\)"),
        ("not_finite", RequestError, "not finite"),
        ("ragged", RequestError, "returned a list that is no array of numbers for observations"),
        ("text", RequestError, "returned a list that is no array of numbers for observations"),
        ("nothing_returned", RequestError, "returned a NoneType that is no array"),
        ("number", RequestError, "A int can't act"),
        ("nothing", RequestError, "has no nothing"),
        ("wrong", WorkError, r"policy \w+:wrong failed \(IndexError"),
    ],
)
def test_policy_that_cannot_act_is_refused_before_episode(module, name, error, sentence):
    with pytest.raises(error, match=sentence):
        named_policy(f"{module}:{name}")


def test_builtin_names_are_not_imported():
    assert not any(is_imported_policy(name) for name in ("constant:0.5", "random", "heuristic"))
    assert policy_code("constant:0.5") is None
    # As in the records of the first version.
    settings = EvaluationSettings(task="face_direction", policy="heuristic", episodes=1)
    assert "code" not in settings.model_dump()


def test_changed_code_changes_id_of_evaluation(module, tmp_path):
    name = f"{module}:half"
    about = {"task": "face_direction", "policy": name}
    before = EvaluationSettings(**about, code=policy_code(name))
    with (tmp_path / f"{module}.py").open("a") as file:
        file.write("\nmore = 1\n")
    after = EvaluationSettings(**about, code=policy_code(name))
    assert before.id != after.id
    assert after.id.startswith(f"face_direction/{module}.half/s00-")
