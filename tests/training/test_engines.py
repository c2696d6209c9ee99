"""Tests of how engines are made: robots are closed if an agent or another one can't be made."""

import pytest

import jbench
from jbench.errors import RequestError, WorkError
from jbench.store import Results
from jbench.training.engines import make_engine
from jbench.training.request import request_runs
from tests.drawn_gym_tasks import Licensed
from tests.gym_tasks import EPISODE


class LacksFile(jbench.Agent):
    """An agent that can't be made."""

    def __init__(self, settings, environment, seed, device):
        raise FileNotFoundError("weights.bin")

    def explore(self, observations):
        raise NotImplementedError

    def act(self, observations):
        raise NotImplementedError

    def learn(self, transition):
        raise NotImplementedError


def licensed_run(results, algo, overrides, **fields):
    """Returns the settings of a run whose robots need a license each, of which there are two."""
    (run,) = request_runs(
        Results(results),
        algo=algo,
        task="tests.drawn_gym_tasks:licensed",
        encoder="none",
        seeds=[0],
        base=None,
        overrides=overrides,
        steps=3 * EPISODE,
        **fields,
    )
    return run


def test_robots_of_an_agent_that_cannot_be_made_are_closed(tmp_path):
    run = licensed_run(tmp_path, f"{__name__}:LacksFile", {}, parallel=2)
    with pytest.raises(WorkError, match="FileNotFoundError: weights"):
        make_engine([run], [None], "cpu")
    assert Licensed.taken == 0


@pytest.mark.parametrize("engine", ["batched", "sb3"])
def test_robots_before_one_that_cannot_be_made_are_closed(tmp_path, engine):
    overrides = {"n_envs": 3, "n_steps": EPISODE, "batch_size": EPISODE}
    run = licensed_run(tmp_path, "ppo", overrides, engine=engine)
    with pytest.raises(RequestError, match="no license is free"):
        make_engine([run], [None], "cpu")
    assert Licensed.taken == 0
