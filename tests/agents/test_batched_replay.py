"""Tests of the replay buffer, which must sample the last transitions uniformly."""

import numpy as np
import pytest
import torch

from jbench.agents.batched.replay import ReplayBuffer

SIZE, ACTIONS, SEEDS = 3, 2, 2
LENGTH = 7  # transitions in an episode


def build_buffer(environments=1, capacity=20, flush_every=5):
    return ReplayBuffer(
        SEEDS,
        environments,
        capacity,
        SIZE,
        ACTIONS,
        flush_every=flush_every,
        episode_steps=LENGTH,
    )


class History:
    """Fills a buffer with transitions of unique numbers, and keeps them."""

    def __init__(self, buffer, environments=1):
        self.buffer, self.shape = buffer, (SEEDS, environments)
        self.transitions = []
        self.count = 0
        self.observations = self._new(SIZE)
        buffer.begin(torch.from_numpy(self.observations))

    def _new(self, *tail):
        size = int(np.prod([*self.shape, *tail]))
        self.count += size
        return np.arange(self.count - size, self.count, dtype=np.float32).reshape(
            *self.shape, *tail
        )

    def step(self):
        """Adds a transition, and begins a new episode after the last one."""
        actions, rewards, next_observations = self._new(ACTIONS), self._new(), self._new(SIZE)
        self.buffer.add(actions, rewards, torch.from_numpy(next_observations))
        last = len(self.transitions) % LENGTH == LENGTH - 1
        self.transitions.append((self.observations, actions, rewards, next_observations, last))
        self.observations = self._new(SIZE) if last else next_observations
        if last:
            self.buffer.begin(torch.from_numpy(self.observations))

    def steps(self, count, flush_every=5):
        for _ in range(count):
            self.step()
            if len(self.transitions) % flush_every == 0:
                self.buffer.flush()
        self.buffer.flush()


def sampled(buffer, seed, count=4000):
    """Transitions (s, a, r, s', last) sampled from a seed's buffer, as tuples of numbers."""
    indices, next_indices, last = buffer.sample(np.random.default_rng(0), 2, count // 2)
    rows = buffer.seed_rows(range(seed, seed + 1)).numpy()
    samples = np.concatenate(
        [rows[indices], rows[next_indices][..., :SIZE], last[..., None]], axis=-1
    )
    return [tuple(row) for row in samples.reshape(-1, 2 * SIZE + ACTIONS + 2).tolist()]


def expected(past, seed, capacity):
    """The transitions that the buffer should contain."""
    return {
        (
            *observations[seed, environment],
            *actions[seed, environment],
            rewards[seed, environment],
            *next_observations[seed, environment],
            float(last),
        )
        for observations, actions, rewards, next_observations, last in past.transitions[-capacity:]
        for environment in range(past.shape[1])
    }


@pytest.mark.parametrize("environments", [1, 3])
@pytest.mark.parametrize("steps", [1, 6, 7, 8, 19, 20, 21, 22, 47, 150])
def test_only_last_transitions_are_sampled(steps, environments):
    buffer = build_buffer(environments, capacity=20 * environments)
    past = History(buffer, environments)
    past.steps(steps)
    for seed in range(SEEDS):
        assert set(sampled(buffer, seed)) == expected(past, seed, 20)


def test_every_transition_is_equally_likely():
    buffer = build_buffer()
    History(buffer).steps(33)
    samples = sampled(buffer, 0, 20_000)
    counts = np.array([samples.count(row) for row in set(samples)])
    # 1000 of each are expected; the standard deviation is 31.
    assert len(counts) == 20
    assert abs(counts - 1000).max() < 4 * 31


@pytest.mark.parametrize("steps", [0, 3, 7, 10, 20, 40, 41, 43])
def test_buffer_is_restored_from_appended_rows(steps):
    buffer = build_buffer(2, capacity=40)
    past = History(buffer, 2)
    saved, first = [[], []], 0
    for steps_more in (4, 9, 7, steps):
        past.steps(steps_more)
        for seed in range(SEEDS):
            saved[seed].append(buffer.rows_since(seed, first))
        first = buffer.row
    # The ring buffer has overwritten older rows, which were saved before.
    rows = [torch.cat(parts, dim=1) for parts in saved]
    other = build_buffer(2, capacity=40)
    for seed in range(SEEDS):
        other.restore(seed, rows[seed], buffer.row)
    other.begin(torch.from_numpy(past.observations))
    past.buffer = other
    past.steps(3)
    for seed in range(SEEDS):
        assert set(sampled(other, seed)) == expected(past, seed, 20)


def test_million_transitions_of_ten_seeds_fit_into_one_gigabyte():
    buffer = ReplayBuffer(10, 1, 1_000_000, 19, 1, flush_every=1)
    rows = buffer.seed_rows(range(10))
    assert len(rows) >= 10_000_000
    assert rows.nbytes < 1e9
