"""Tests that seeds of several tasks and encoders in one stack equal single seeds.

Sums in a stack have another order, so numbers are equal except for rounding.
"""

import numpy as np
import pytest
import torch

from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.batched.padding import with_padding, without_padding
from jbench.names import ALGORITHMS
from tests.agents.small_rules import TD3 as RULE
from tests.agents.small_rules import TD3_SETTINGS
from tests.agents.small_rules import engine_of as rule_engine_of
from tests.agents.test_batched_divergence import CRITICS, DIVERGED, poison
from tests.agents.test_batched_engine import (
    FEW,
    SCRIPTS,
    STEPS,
    TanhEncoder,
    engine_of,
    round_trip,
    slow,
    trajectory,
)

TASKS = ["face_direction", "face_direction", "move_from_origin", "face_direction"]
ENCODER = TanhEncoder()
ENCODERS = [None, ENCODER, None, ENCODER]
SIZES = [16, 5, 15, 5]
SEEDS = [0, 4, 0, 7]


def stacked_engine(algo, **options):
    """An engine with four seeds of two tasks and two encoders in one stack."""
    more = {"task": TASKS, "encoder": ENCODERS, "dtype": torch.float64, "stacked": True}
    return engine_of(algo, SEEDS, **{**more, **options})


def single_engine(algo, index, **options):
    """An engine with one of these seeds."""
    more = {"task": TASKS[index], "encoder": ENCODERS[index], "dtype": torch.float64}
    return engine_of(algo, [SEEDS[index]], **{**more, **options})


def assert_close(found, expected):
    """Compares two states of a seed."""
    assert found.scalars == expected.scalars
    assert found.tensors.keys() == expected.tensors.keys()
    for name, tensor in expected.tensors.items():
        torch.testing.assert_close(
            found.tensors[name], tensor, rtol=1e-9, atol=1e-9, msg=lambda m, n=name: f"{n}: {m}"
        )


@pytest.mark.parametrize(
    ("algo", "options"),
    [
        *((algo, {}) for algo in ALGORITHMS),
        ("ddpg", SCRIPTS["ddpg"]),
        slow("ppo", SCRIPTS["ppo"]),
        slow("sac", {"environments": 2}),
        slow("td3", {"stacked": False}),
    ],
)
def test_seed_in_stack_of_cells_equals_single_seed(algo, options):
    with stacked_engine(algo, **options) as engine:
        states = [[engine.state(index) for index in range(4)]]
        seen, returns, losses = [], [], []
        for ended in engine.learn(STEPS):
            seen.append(engine.environments.observations)
            returns.append(ended)
            losses.append([engine.losses(index) for index in range(4)])
        states.append([engine.state(index) for index in range(4)])
        assert engine.updates > 10 or algo == "ppo"
        found = [policy.inputs for policy in map(engine.policy, range(4))]
        assert found == SIZES
    for index, size in enumerate(SIZES):
        with single_engine(algo, index, **{**options, "stacked": False}) as single:
            first = single.state(0)
            for name, tensor in states[0][index].tensors.items():
                assert torch.equal(tensor, first.tensors[name]), name
            own_seen, own_returns, own_losses, *_ = trajectory(single, 0)
            own = torch.stack([each[index] for each in seen])
            torch.testing.assert_close(own[..., :size], own_seen, rtol=0, atol=1e-6)
            assert not own[..., size:].any()
            for mine, all_of_step in zip(own_returns, returns, strict=True):
                assert (mine is None) == (all_of_step is None)
                if mine is not None:
                    np.testing.assert_allclose(all_of_step[index], mine, rtol=1e-7)
            assert losses[-1][index] == pytest.approx(own_losses[-1], rel=1e-7)
            assert_close(states[1][index], single.state(0))


def checkpoint(engine, index):
    """The checkpoint of a seed: its state, its replay rows and the number of the next row."""
    state = round_trip(engine.state(index))
    if not isinstance(engine, OffPolicyEngine):
        return state, None, 0
    return state, engine.replay_rows(index), engine.replay.row


def resume(engine, checkpoints):
    """Restores an engine from the checkpoint of each seed."""
    for index, (_, rows, row) in enumerate(checkpoints):
        if rows is not None:
            engine.restore_rows(index, rows, row)
    engine.restore([state for state, *_ in checkpoints])
    return engine


def stopped(engine, steps=42):
    """Trains until some control steps; returns the checkpoints."""
    for _ in engine.learn(2 * STEPS):
        if engine.control_steps >= steps:
            break
    return [checkpoint(engine, index) for index in range(len(engine.environments.sizes))]


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_checkpoint_in_stack_of_cells_equals_single_seed(algo):
    with stacked_engine(algo) as engine:
        among = stopped(engine)
        ends = stopped(engine, STEPS)
    for index in (1, 2):
        with single_engine(algo, index) as single:
            resume(single, [among[index]])
            assert_equal(checkpoint(single, 0), among[index])
            assert_close(stopped(single, STEPS)[0][0], ends[index][0])
    singles = []
    for index in range(4):
        with single_engine(algo, index) as single:
            singles += stopped(single)
    with stacked_engine(algo) as engine:
        resume(engine, singles)
        for index in range(4):
            assert_equal(checkpoint(engine, index), singles[index])
        for found, (expected, *_) in zip(stopped(engine, STEPS), ends, strict=True):
            assert_close(found[0], expected)


def assert_equal(found, expected):
    """Compares two checkpoints of a seed, bit for bit."""
    (state, rows, row), (its_state, its_rows, its_row) = found, expected
    assert (state.scalars, row) == (its_state.scalars, its_row)
    assert rows is its_rows is None or torch.equal(rows, its_rows)
    assert state.tensors.keys() == its_state.tensors.keys()
    for name, tensor in its_state.tensors.items():
        assert torch.equal(state.tensors[name], tensor), name


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_seeds_in_stack_of_cells_act_as_their_policies(algo):
    random = np.random.default_rng(0)
    with stacked_engine(algo) as engine:
        policies = [engine.policy(index) for index in range(4)]
        for first, count, size in ((0, 1, 16), (1, 1, 16), (2, 1, 15), (3, 1, 16)):
            seen = random.normal(size=(count, 6, size)).astype(np.float32)
            inputs = [
                own if ENCODERS[first] is None else ENCODER.encode(torch.from_numpy(own)).numpy()
                for own in seen
            ]
            expected = [policies[first + i].act(own) for i, own in enumerate(inputs)]
            np.testing.assert_allclose(engine.act(seen, first), expected, atol=1e-6)
        with single_engine(algo, 1) as single:
            single.load_policy(0, policies[1], 0)
            engine.load_policy(3, single.policy(0), 0)
        assert engine.policy(3).files() == policies[1].files()


@pytest.mark.parametrize("algo", ["ddpg", slow("td3"), slow("sac"), "ppo"])
def test_diverged_seed_does_not_affect_other_cells(algo):
    states = []
    for poisoned in (False, True):
        with stacked_engine(algo) as engine:
            for _ in engine.learn(STEPS):
                if poisoned and engine.control_steps >= 42 and not engine.diverged:
                    poison(engine, CRITICS[algo])
            assert list(engine.diverged) == [DIVERGED] * poisoned
            states.append([engine.state(index) for index in (0, 2, 3)])
    for one, other in zip(*states, strict=True):
        assert_equal((one, None, 0), (other, None, 0))


def test_agents_that_cannot_be_padded_are_refused():
    sentence = r"same number of inputs here, not \[16, 5, 15, 5\]"
    with pytest.raises(ValueError, match=sentence):
        stacked_engine("td3", ofe=FEW)
    with pytest.raises(ValueError, match=r"not \[16, 5\]"):
        rule_engine_of(RULE, TD3_SETTINGS, [0, 1], encoder=[None, ENCODER])


def test_padding_is_inserted_and_removed():
    values, padding = torch.arange(1.0, 5).view(1, 4), [slice(1, 3), slice(5, 6)]
    padded = with_padding(values, padding)
    assert padded.tolist() == [[1, 0, 0, 2, 3, 0, 4]]
    assert torch.equal(without_padding(padded, padding), values)
    assert with_padding(values, []) is values
