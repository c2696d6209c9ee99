"""Tests of the training data of encoders: split, scaling, pairs and streaming."""

import numpy as np
import pytest
import torch

from jbench.encoders.scaling import Moments
from jbench.encoders.states import States, split_episodes
from jbench.errors import RequestError
from jbench.store import Results
from tests.encoders.encoder_data import make_dataset, observations_of, random_actions, read_states

SMALL = 3 * 2 * 1001 * 16 * 4  # bytes of memory, enough for two episodes


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def gathered(shards):
    """All episodes (episodes, 1001, size) and actions (episodes, 1000) of shards."""
    states, actions, *_ = zip(*shards, strict=True)
    return torch.cat(states).numpy(), torch.cat(actions).numpy()


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    results = Results(tmp_path_factory.mktemp("states") / "results")
    return make_dataset(results, episodes=10, each=3)


@pytest.fixture(scope="module")
def scaled(dataset):
    """All states of the dataset, scaled by hand."""
    observations = observations_of(dataset).astype(np.float64)
    low, high = (f(observations, axis=(0, 1)) for f in (np.min, np.max))
    return 2 * (observations - low) / (high - low) - 1


@pytest.mark.parametrize("episodes", [2, 5, 10, 13, 5000])
def test_split_has_80_percent_of_episodes_for_training(episodes):
    learned, held_out = split_episodes(episodes, 0)
    assert sorted([*learned, *held_out]) == list(range(episodes))
    assert len(held_out) == max(1, round(episodes / 5))
    assert split_episodes(episodes, 0).held_out.tolist() == held_out.tolist()
    assert len({tuple(split_episodes(episodes, seed).held_out) for seed in range(9)}) > 1


def test_states_are_scaled_by_extremes_of_dataset(dataset, scaled):
    states = read_states(dataset, seed=0)
    observations = observations_of(dataset)
    np.testing.assert_array_equal(states.scaling.minimum, observations.min(axis=(0, 1)))
    np.testing.assert_array_equal(states.scaling.maximum, observations.max(axis=(0, 1)))
    learned, held_out = split_episodes(10, 0)
    found, actions = gathered(states.learn(generator()))
    np.testing.assert_allclose(found, scaled[learned], atol=1e-5)
    np.testing.assert_array_equal(actions, random_actions(10)[learned][..., None])
    np.testing.assert_allclose(gathered(states.test())[0], scaled[held_out], atol=1e-5)
    np.testing.assert_allclose(states.scaled(observations), scaled, atol=1e-5)


def test_moments_equal_those_of_scaled_states(dataset, scaled):
    states = read_states(dataset, seed=0)
    for found, chosen in zip((states.learned, states.held_out), split_episodes(10, 0), strict=True):
        expected = Moments.of(scaled[chosen])
        assert found.rows == expected.rows == 1001 * len(chosen)
        np.testing.assert_allclose(found.mean, expected.mean, atol=1e-6)
        np.testing.assert_allclose(found.covariance, expected.covariance, atol=1e-6)


def test_large_dataset_is_streamed_by_file_in_random_order(dataset):
    whole, streamed = read_states(dataset, seed=0), read_states(dataset, seed=0, memory=SMALL)
    assert (whole.in_memory, streamed.in_memory) == (True, False)
    of_whole, orders = gathered(whole.learn(generator()))[0], []
    for seed in range(5):
        shards = list(streamed.learn(generator(seed)))
        assert len(shards) > 2
        orders.append(gathered(shards)[0])
        by_first_state = [all[np.lexsort(all[:, 0].T)] for all in (orders[-1], of_whole)]
        np.testing.assert_array_equal(*by_first_state)
    assert len({order.tobytes() for order in orders}) > 1
    np.testing.assert_array_equal(gathered(streamed.test())[0], gathered(whole.test())[0])
    np.testing.assert_array_equal(streamed.sample.states, whole.sample.states)
    np.testing.assert_array_equal(streamed.sample.actions, whole.sample.actions)
    for name in ("learned", "held_out"):
        for one, other in zip(getattr(streamed, name), getattr(whole, name), strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("ahead", [0, 1, 40])
def test_pairs_have_given_distance_within_episode(dataset, ahead):
    (shard,) = read_states(dataset, seed=0).learn(generator())
    pairs = 8 * (1001 - ahead)
    assert shard.pairs(ahead) == pairs
    for kind in (torch.int32, torch.int64):
        batch = shard.take(torch.arange(pairs, dtype=kind), ahead, with_actions=ahead > 0)
        now, later = shard.states[:, : 1001 - ahead], shard.states[:, ahead:]
        assert torch.equal(batch.now, now.reshape(pairs, 16))
        assert torch.equal(batch.later, later.reshape(pairs, 16))
        if ahead:
            for i in (0, ahead - 1):
                steps = slice(i, i + 1001 - ahead)
                assert torch.equal(batch.actions[:, i], shard.actions[:, steps].flatten())
                assert torch.equal(batch.rewards[:, i], shard.rewards[:, steps].flatten())
            assert batch.actions.shape == batch.rewards.shape == (pairs, ahead)
        else:
            assert batch.actions is None


def test_dataset_of_single_episode_is_refused(results):
    with pytest.raises(RequestError, match=r"single episode.*: jbench collect --steps 10000\."):
        States(make_dataset(results, episodes=1), "face_direction", 0)
