"""Tests of the training loop of agents of other packages, and of packing their state."""

import json
import random

import numpy as np
import pytest
import safetensors.torch
import torch
from torch import nn

import jbench
from jbench.agents.ending_environments import environments_class
from jbench.agents.packing import pack, unpack
from jbench.agents.plugin_engine import PluginEngine
from jbench.errors import WorkError
from jbench.policies.copied_modules import UnsupportedPolicyError

EPISODE = 10


class RandomAgent(jbench.Agent):
    """Draws from all global generators, and keeps its transitions."""

    class Settings(jbench.AgentSettings):
        scale: float = 1.0

    def __init__(self, settings, environment, seed, device):
        self.environment, self.transitions = environment, []
        sizes = environment.observation_size, environment.action_size
        self.actor = nn.Sequential(nn.Linear(*sizes), nn.Tanh())
        self.optimizer = torch.optim.Adam(self.actor.parameters(), lr=0.01)

    def explore(self, observations):
        actions = self.act(observations)
        noise = torch.randn(actions.shape).numpy() + np.random.normal() + random.random()
        return actions + noise

    def act(self, observations):
        with torch.no_grad():
            return self.actor(torch.from_numpy(observations)).numpy()

    def learn(self, transition):
        self.transitions.append(transition)
        self.optimizer.zero_grad()
        loss = self.actor(torch.from_numpy(transition.observations)).square().mean()
        loss.backward()
        self.optimizer.step()
        return {"actor_loss": loss.detach()}

    def policy(self):
        return self.actor

    def state(self):
        return {"actor": self.actor.state_dict(), "optimizer": self.optimizer.state_dict()}

    def restore(self, state):
        self.actor.load_state_dict(state["actor"])
        self.optimizer.load_state_dict(state["optimizer"])


def build_engine(kind=RandomAgent, task="face_direction", encoder=None, **options):
    environments = environments_class(task)(task, [3], 2, [encoder], episode_steps=EPISODE)
    return PluginEngine("drawing", kind, kind.Settings(), environments, **options)


def returns(engine, steps):
    """Trains for some control steps; returns those of the episodes that ended."""
    return [ends.returns.tolist() for ends in engine.learn(steps) if ends is not None]


# The second task has a state between two episodes only.
@pytest.mark.parametrize(
    ("task", "stop", "motors"), [("face_direction", 34, 1), ("dmc:cheetah-run", 40, 6)]
)
def test_restored_engine_continues_bit_for_bit(task, stop, motors):
    with build_engine(task=task) as whole:
        expected = returns(whole, 80)
        weights = whole.policy(0).files()
        losses = whole.losses(0)
        assert whole._agent.transitions[-1].actions.shape == (2, motors)
        size = whole.environments.size
        assert whole.act(np.ones((1, 5, size), np.float32)).shape == (1, 5, motors)
    with build_engine(task=task) as first:
        before = returns(first, stop)
        state = first.state(0)
        list(first.learn(70))  # changes the global generators before the state is restored
    with build_engine(task=task) as second:
        second.restore([state])
        assert second.control_steps == stop
        after = returns(second, 80)
        assert before + after == expected
        assert second.losses(0) == losses
        assert second.policy(0).files() == weights


class AddingUp(RandomAgent):
    """Keeps the returns of the current episodes, as a method of returns so far would."""

    def __init__(self, settings, environment, seed, device):
        super().__init__(settings, environment, seed, device)
        self.returns = np.zeros(environment.environments)

    def learn(self, transition):
        self.returns += transition.rewards
        self.returns[transition.terminated | transition.truncated] = 0
        return {}

    def truncate(self, truncated):
        self.returns[truncated] = 0

    def state(self):
        return {**super().state(), "returns": self.returns}

    def restore(self, state):
        super().restore(state)
        self.returns = state["returns"]


def test_agent_knows_of_episodes_that_were_truncated_as_they_did_not_repeat():
    with build_engine(AddingUp, "tests.gym_tasks:drifts") as engine:
        list(engine.learn(10))
        state = engine.state(0)
        assert (engine._agent.returns != 0).any()
    with build_engine(AddingUp, "tests.gym_tasks:drifts") as resumed:
        resumed.restore([state])
        assert resumed.truncated_at_restore.ended.any()
        for _ in resumed.learn(30):
            so_far = resumed.environments._returns[0]
            np.testing.assert_allclose(resumed._agent.returns, so_far, rtol=1e-5)


class DrawingOnGPU(RandomAgent):
    """Draws from the generator of the GPU, which a fixture replaces by one of the CPU."""

    generator = torch.Generator()

    def explore(self, observations):
        return self.act(observations)

    def act(self, observations):
        return super().act(observations) + torch.randn(1, 1, generator=self.generator).numpy()


@pytest.fixture
def gpu(monkeypatch):
    generator = DrawingOnGPU.generator.manual_seed(0)
    monkeypatch.setattr(torch.cuda, "get_rng_state", lambda device: generator.get_state())
    monkeypatch.setattr(
        torch.cuda, "set_rng_state", lambda state, device: generator.set_state(state)
    )
    return torch.device("cuda")


def test_agent_that_draws_on_gpu_continues_bit_for_bit(gpu):
    with build_engine(DrawingOnGPU, device=gpu) as engine:
        state = engine.state(0)
        whole = returns(engine, 40)
    with build_engine(DrawingOnGPU, device=gpu) as other:
        other.restore([state])
        resumed = []
        for ends in other.learn(40):
            other.act(np.ones((1, 5, 16), np.float32))  # as in an evaluation
            resumed += [] if ends is None else [ends.returns.tolist()]
    assert resumed == whole


def test_checkpoint_of_cpu_can_be_restored_on_gpu(gpu):
    with build_engine() as engine, build_engine(device=gpu) as other:
        list(engine.learn(34))
        other.restore([engine.state(0)])
        assert other.control_steps == 34


@pytest.mark.parametrize("time_limit", ["bootstrap", "terminal"])
def test_transitions_follow_episodes_and_time_limit(time_limit):
    with build_engine(time_limit=time_limit) as engine:
        list(engine.learn(2 * EPISODE * 2))
        seen = engine._agent.transitions
    assert len(seen) == 2 * EPISODE
    for step, transition in enumerate(seen, 1):
        ends = step % EPISODE == 0
        assert transition.terminated.tolist() == [ends and time_limit == "terminal"] * 2
        assert transition.truncated.tolist() == [ends and time_limit == "bootstrap"] * 2
        assert transition.observations.shape == (2, 16)
        assert transition.actions.shape == (2, 1)
        assert transition.rewards.dtype == np.float32
        if step < len(seen):
            follows = np.array_equal(transition.next_observations, seen[step].observations)
            # After the last step of an episode, a new one begins.
            assert follows is not ends


class ChangingArrays(RandomAgent):
    """Changes the arrays that it is given."""

    def learn(self, transition):
        losses = super().learn(transition)
        transition.next_observations[:] = 0
        return losses


def test_agent_that_changes_its_arrays_continues_bit_for_bit():
    with build_engine(ChangingArrays) as engine, build_engine(ChangingArrays) as resumed:
        list(engine.learn(34))
        state = engine.state(0)
        list(engine.learn(40))
        resumed.restore([state])
        list(resumed.learn(40))
        assert engine.policy(0).files() == resumed.policy(0).files()


class DrawingWhenAsked(RandomAgent):
    """Draws from all global generators in `act` and `policy` as well."""

    def act(self, observations):
        self.draw()
        return super().act(observations)

    def policy(self):
        self.draw()
        return super().policy()

    def draw(self):
        torch.randn(1), np.random.normal(), random.random()


def test_evaluations_and_checkpoints_do_not_change_training():
    outcomes = []
    for asks in (False, True):
        with build_engine(DrawingWhenAsked) as engine:
            for _ in engine.learn(40):
                if asks:
                    engine.act(np.ones((1, 5, 16), np.float32))
                    engine.check_weights()
                    engine.policy(0)
            outcomes.append(engine.policy(0).files())
    assert outcomes[0] == outcomes[1]


def test_actions_of_wrong_shape_and_losses_that_are_no_dictionary_are_refused():
    class Faulty(RandomAgent):
        def act(self, observations):
            return super().act(observations)[:, 0]

        def explore(self, observations):
            return super().act(observations)[:, :1]

        def learn(self, transition):
            pass

    with build_engine(Faulty) as engine:
        with pytest.raises(WorkError, match=r"the shape \(5,\) .* must return actions \(5, 1"):
            engine.act(np.ones((1, 5, 16), np.float32))
        with pytest.raises(WorkError, match="returned a NoneType; it"):
            next(engine.learn(10))
    with (
        build_engine(Faulty, "dmc:cheetah-run") as engine,
        pytest.raises(WorkError, match=r"the shape \(2, 1\) .* return actions \(2, 6\)"),
    ):
        next(engine.learn(10))


@pytest.mark.parametrize("answer", [[[0.5], [0.5, 0.5]], [["half"], [0.5]], None, ([0.5], [0.5])])
def test_actions_that_are_no_array_of_numbers_are_refused(answer):
    class Faulty(RandomAgent):
        def act(self, observations):
            return answer

    says = f"act of the agent .* returned a {type(answer).__name__} that is no array of numbers"
    with build_engine(Faulty) as engine, pytest.raises(WorkError, match=says):
        engine.act(np.ones((1, 2, 16), np.float32))


@pytest.mark.parametrize("loss", [torch.zeros(2), np.zeros(2), "much", None])
def test_loss_that_is_no_number_is_refused(loss):
    class Faulty(RandomAgent):
        def learn(self, transition):
            return {"critic_loss": loss}

    says = f"returned a {type(loss).__name__} as critic_loss; a loss must be one number"
    with build_engine(Faulty) as engine, pytest.raises(WorkError, match=says):
        next(engine.learn(10))


@pytest.mark.parametrize("loss", [torch.ones(1), np.float32(1), np.ones(()), 1])
def test_loss_may_be_a_number_of_any_library(loss):
    class Learning(RandomAgent):
        def learn(self, transition):
            return {"critic_loss": loss}

    with build_engine(Learning) as engine:
        next(engine.learn(10))
        assert engine.losses(0) == {"critic_loss": 1.0}


def test_nonfinite_loss_is_divergence():
    class Diverging(RandomAgent):
        def learn(self, transition):
            return {**super().learn(transition), "critic_loss": float("inf")}

    with build_engine(Diverging) as engine:
        next(engine.learn(40))
        assert engine.diverged[0].what == "critic_loss"


@pytest.mark.parametrize(
    ("policy", "sentence"),
    [
        (nn.Sequential(nn.Linear(16, 1), nn.Softsign()), "softsign"),
        (3, "its type is int, no torch module; pass"),
    ],
)
def test_policy_that_cannot_be_saved_is_refused_before_training(policy, sentence):
    class Unsaved(RandomAgent):
        def policy(self):
            return policy

    with pytest.raises(UnsupportedPolicyError, match=sentence):
        build_engine(Unsaved)


def test_values_keep_their_types_and_bits():
    value = {
        "generator": np.random.default_rng(5).bit_generator.state,
        "pair": (1, [True, None, "text"]),
        "best": -np.inf,
        "total": np.float32(0.1),
        "flags": np.array([True, False]),
        "empty": np.zeros((0, 4)),
        "transposed": np.arange(6.0).reshape(2, 3).T,
        3: torch.arange(4, dtype=torch.int64),
    }
    tensors = {}
    written = json.dumps(pack(value, tensors), allow_nan=False)
    read = safetensors.torch.load(safetensors.torch.save(tensors))
    found = unpack(json.loads(written), read)
    assert found.keys() == value.keys()
    for name in ("generator", "pair", "best", "total"):
        assert (type(found[name]), found[name]) == (type(value[name]), value[name])
    for name in ("flags", "empty", "transposed"):
        np.testing.assert_array_equal(found[name], value[name], strict=True)
    assert torch.equal(found[3], value[3])


def test_packed_tensor_is_copy():
    array, tensors = np.zeros(2), {}
    node = pack(array, tensors)
    array[0] = 1
    assert unpack(node, tensors).tolist() == [0, 0]


def test_unsupported_object_is_refused_with_its_path():
    with pytest.raises(WorkError, match=r"state\(\)\['buffer'\]\[1\] of the agent is of .* set"):
        pack({"buffer": [0, {1, 2}]}, {})
