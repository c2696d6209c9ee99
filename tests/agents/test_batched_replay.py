"""Tests of the replay buffer, which must sample the last transitions uniformly."""

import math

import numpy as np
import pytest
import torch

from jbench.agents.batched.replay import ReplayBuffer, Sizes

SIZE, ACTIONS, SEEDS = 3, 2, 2
LENGTH = 7  # transitions in an episode


def build_buffer(environments=1, capacity=20):
    sizes = Sizes(SEEDS, environments, capacity, SIZE, ACTIONS)
    return ReplayBuffer(sizes, flush_every=5, episode_steps=LENGTH, ends_are_terminal=True)


class History:
    """Fills a buffer with transitions of unique numbers, and keeps them."""

    def __init__(self, buffer, environments=1):
        self.buffer, self.shape = buffer, (SEEDS, environments)
        self.transitions = []
        self.count = 0
        self.observations = self._new(SIZE)
        buffer.begin(torch.from_numpy(self.observations))

    def _new(self, *tail):
        shape = (*self.shape, *tail)
        first, self.count = self.count, self.count + math.prod(shape)
        return np.arange(first, self.count, dtype=np.float32).reshape(shape)

    def step(self):
        """Adds a transition, and begins a new episode after the last one."""
        actions, rewards, next_observations = self._new(ACTIONS), self._new(), self._new(SIZE)
        self.buffer.add(actions, rewards, torch.from_numpy(next_observations))
        last = len(self.transitions) % LENGTH == LENGTH - 1
        parts = self.observations, actions, rewards[..., None], next_observations
        ends = np.full((*self.shape, 1), float(last))
        self.transitions.append(np.concatenate([*parts, ends], axis=-1))
        self.observations = self._new(SIZE) if last else next_observations
        if last:
            self.buffer.begin(torch.from_numpy(self.observations))

    def steps(self, count):
        for _ in range(count):
            self.step()
            if len(self.transitions) % 5 == 0:
                self.buffer.flush()
        self.buffer.flush()


def sampled(buffer, seed, count=4000):
    """Transitions (s, a, r, s', last) sampled from a seed's buffer, as tuples of numbers."""
    indices, next_indices, last = buffer.sample(np.random.default_rng(0), 2, count // 2)
    rows = buffer.seed_rows(range(seed, seed + 1)).numpy()
    parts = rows[indices], rows[next_indices][..., :SIZE], last[..., None]
    samples = np.concatenate(parts, axis=-1).reshape(-1, 2 * SIZE + ACTIONS + 2)
    return [tuple(row) for row in samples.tolist()]


def expected(past, seed, capacity):
    """The transitions that the buffer should contain."""
    kept = past.transitions[-capacity:]
    return {tuple(row) for rows in kept for row in rows[seed].tolist()}


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


def test_no_transition_is_terminal_where_ends_are_truncations():
    sizes = Sizes(1, 1, 20, SIZE, ACTIONS)
    buffer = ReplayBuffer(sizes, flush_every=2 * LENGTH, episode_steps=LENGTH)
    buffer.begin(torch.zeros(1, 1, SIZE))
    for _ in range(2):
        for _ in range(LENGTH):
            buffer.add(np.zeros((1, 1, ACTIONS)), np.zeros((1, 1)), torch.zeros(1, 1, SIZE))
        buffer.begin(torch.zeros(1, 1, SIZE))
    buffer.flush()
    assert not buffer.has_terminals
    assert not buffer.sample(np.random.default_rng(0), 1, 1000).is_terminal.any()


def test_million_transitions_of_ten_seeds_fit_into_one_gigabyte():
    # A hundredth of them, whose rows beyond the transitions are no smaller a part.
    sizes = Sizes(10, 1, 10_000, 19, 1)
    buffer = ReplayBuffer(sizes, flush_every=1, episode_steps=1000)
    rows = buffer.seed_rows(range(10))
    assert len(rows) >= 100_000
    assert rows.nbytes < 1e7
