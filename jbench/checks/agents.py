"""Checks of agents and update rules: shapes, learning, seeds, state and restore, policy."""

import json
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
import torch

from jbench.agents.algorithms import algorithm_fields, describe_settings
from jbench.agents.algorithms import settings_class as class_of_settings
from jbench.agents.batched.make import make_batched_engine
from jbench.agents.batched.rule import Rule
from jbench.agents.ending_environments import environments_class
from jbench.agents.environments import Environments, SeedState
from jbench.agents.find import find_class
from jbench.agents.plugin_engine import PluginEngine
from jbench.agents.training_loop import TrainingLoop
from jbench.checks.checked import NamedCheck, NotableError
from jbench.closing import closed_on_error
from jbench.errors import WorkError
from jbench.settings.base import settings_with
from jbench.wording import counted

EPISODE = 50
"""Control steps of the episodes that are trained."""

_EPISODES = 3

_TOLERANCE = 1e-4
"""Of actions, whose sums are rounded in another order."""

_QUICK = {
    "learning_starts": 20,
    "batch_size": 8,
    "train_freq": 10,
    "gradient_steps": 2,
    "buffer_size": 1000,
}
"""Settings of a rule with which it learns within the first episode, unless others are typed."""

_Make = Callable[..., TrainingLoop]  # takes seeds and a number of environments

_MakeOnRobots = Callable[[Environments], TrainingLoop]


def agent_checks(name: str, task: str, settings: Mapping[str, Any]) -> Iterator[NamedCheck]:
    """Yields the checks of an agent."""
    yield "class", partial(_agent_class, name, settings)
    kind = find_class(name)
    values = settings_with(class_of_settings(name), name, settings)

    make = partial(_on_short_episodes, partial(PluginEngine, name, kind, values), task)
    yield from _checks_of_both(name, make, task)
    yield "evaluation", partial(_evaluation, make)
    yield "state", partial(_state, make)
    yield "policy", partial(_policy, make)


def rule_checks(name: str, task: str, settings: Mapping[str, Any]) -> Iterator[NamedCheck]:
    """Yields the checks of an update rule; the engine itself keeps its state."""
    yield "class", partial(_agent_class, name, settings)
    kind: type[Rule] = find_class(name)
    values: Any = settings_with(class_of_settings(name), name, {**_QUICK, **settings})

    make = partial(_on_short_episodes, partial(make_batched_engine, kind, values), task)
    yield from _checks_of_both(name, make, task)
    yield "side by side", partial(_side_by_side, make)
    yield "policy", partial(_policy, make)


def _on_short_episodes(
    make: _MakeOnRobots, task: str, seeds: list[int], environments: int = 1
) -> TrainingLoop:
    """Returns a training of new agents, one per seed, whose episodes are short."""
    robots = environments_class(task)(task, seeds, environments, episode_steps=EPISODE)
    with closed_on_error(robots):
        return make(robots)


def _checks_of_both(name: str, make: _Make, task: str) -> Iterator[NamedCheck]:
    """Yields the checks that agents and update rules share."""
    yield "settings", partial(_settings, name)
    yield "made", partial(_made, make, task)
    yield "actions", partial(_actions, make)
    yield "learning", partial(_trains, make)
    yield "environments", partial(_trains, make, environments=2)
    yield "seeds", partial(_seeds, make)


def _agent_class(name: str, settings: Mapping[str, Any]) -> str:
    """Finds the class and says which engine trains it."""
    fields = algorithm_fields(name, overrides=settings)
    return f"{name} is trained by the engine {fields['engine']}"


def _settings(name: str) -> str:
    """Checks that each setting has a description."""
    described = describe_settings(name)
    silent = [each["name"] for each in described if not each["description"]]
    if silent:
        raise NotableError(
            f"no description of {', '.join(silent)}: give Field a description, which jbench "
            "algorithms shows"
        )
    return f"{counted(len(described), 'setting')}, each with a default and a description"


def _made(make: _Make, task: str) -> str:
    """Makes an agent on the task."""
    with make([0]) as engine:
        size = engine.environments.size
        actions = engine.environments.action_size
    return f"on {task}, with observations of {size} and actions of {actions}"


def _actions(make: _Make) -> str:
    """Checks that actions are deterministic, of each robot alone, and have the right shape."""
    with make([0]) as engine:
        size = engine.environments.size
        action_size = engine.environments.action_size
        for count in (1, 7):
            observations = np.zeros((1, count, size), np.float32)
            actions = engine.act(observations)
            if actions.shape != (1, count, action_size):
                raise WorkError(f"act returns the shape {actions.shape} for {count} observations.")

        again = engine.act(observations)
        if not np.array_equal(actions, again):
            raise WorkError(
                "act returns other actions for the same observations: it must be deterministic."
            )

        _check_finite(engine)
        _check_each_alone(engine)

    return "act is deterministic, for any number of observations"


def _check_each_alone(engine: TrainingLoop) -> None:
    """Raises a WorkError if the action for an observation depends on others beside it."""
    size = engine.environments.size
    observations = np.random.default_rng(0).normal(size=(1, 7, size)).astype(np.float32)
    together = engine.act(observations)
    alone = [engine.act(observations[:, i : i + 1]) for i in range(7)]
    if np.abs(together - np.concatenate(alone, axis=1)).max() > _TOLERANCE:
        raise WorkError(
            "act returns another action for an observation beside others than alone: an evaluation "
            "would depend on its number of episodes."
        )


def _trains(make: _Make, environments: int = 1) -> str:
    """Trains some short episodes; losses and weights must be finite."""
    with make([0], environments) as engine:
        _train(engine)
        losses = engine.losses(0)
        engine.check_weights()
        _check_finite(engine)

    if environments > 1:
        return f"{_EPISODES} episodes of {environments} environments side by side"

    if not losses:
        raise NotableError(
            f"learn returned no losses in {_EPISODES} short episodes; jbench records those with a "
            "column, such as critic_loss"
        )

    values = ", ".join(f"{name} {value:.3g}" for name, value in losses.items())
    return f"{_EPISODES} episodes of {EPISODE} control steps; {values}"


def _seeds(make: _Make) -> str:
    """Checks that the seed, and only the seed, decides the numbers of a training."""
    first, again, other = (_trace(make, [seed]) for seed in (0, 0, 1))
    _check_equal(
        first,
        again,
        "training again with the same seed gives other numbers: draw all random numbers from "
        "generators that the seed seeds, and depend on no time, no memory address and no "
        "order of a set.",
    )
    if np.array_equal(first, other, equal_nan=True):
        raise NotableError("another seed gives the same numbers; jbench compares different seeds")

    return "the same seed gives the same numbers, another seed others"


def _side_by_side(make: _Make) -> str:
    """Checks that a seed's numbers are the same beside another seed."""
    _check_equal(
        _trace(make, [0]),
        _trace(make, [0, 1]),
        "a seed's numbers depend on the other seeds, or on an update before.",
    )
    return "a seed's numbers do not depend on the other seeds"


def _evaluation(make: _Make) -> str:
    """Checks that evaluating changes nothing in training."""
    _check_equal(
        _trace(make, [0]),
        _trace(make, [0], evaluate=True),
        "evaluating between two steps changes the training: act and policy must change nothing "
        "that explore or learn use.",
    )
    return "act and policy change nothing in training"


def _state(make: _Make) -> str:
    """Checks that a training resumed from its saved state has the same numbers."""
    with make([0]) as engine:
        _train(engine, episodes=1)
        saved = engine.state(0)
        if saved is None:
            raise NotableError("no state and restore: a killed run starts over")
        whole = _numbers(engine)

    # As a checkpoint holds it.
    copy = SeedState(
        {name: tensor.clone() for name, tensor in saved.tensors.items()},
        json.loads(json.dumps(saved.scalars)),
    )
    with make([0]) as engine:
        engine.restore([copy])
        resumed = _numbers(engine)

    _check_equal(
        whole,
        resumed,
        "resumed training gives other numbers than uninterrupted training: state must "
        "return everything that changes, and restore must set it again.",
    )
    return "a resumed run has the numbers of an uninterrupted one"


def _policy(make: _Make) -> str:
    """Checks that the saved policy acts as the agent does."""
    with make([0]) as engine:
        _train(engine)
        saved = engine.policy(0)
        if saved is None:
            raise NotableError("policy returns None: a run is saved without its policy")
        size = engine.environments.size
        observations = np.random.default_rng(0).normal(size=(1, 5, size)).astype(np.float32)
        difference = np.abs(saved.act(observations[0]) - engine.act(observations)[0].clip(-1, 1))

    if difference.max() > _TOLERANCE:
        raise WorkError(
            f"the saved policy acts differently from act, by up to {difference.max():.2g}: policy "
            "must return the module that act uses."
        )

    return f"saved, and acts as act does, within {difference.max():.1g}"


def _check_equal(first: np.ndarray, second: np.ndarray, fault: str) -> None:
    """Raises a WorkError with the fault unless both trainings saw the same numbers."""
    if not np.array_equal(first, second, equal_nan=True):
        raise WorkError(fault)


def _check_finite(engine: TrainingLoop) -> None:
    """Raises the error of a seed that diverged."""
    for error in engine.diverged.values():
        raise error


def _train(engine: TrainingLoop, episodes: int = _EPISODES) -> None:
    """Trains the agent for some short episodes."""
    made = engine.control_steps
    for _ in engine.learn(made + episodes * EPISODE * engine.environments.observations.shape[1]):
        pass


def _numbers(engine: TrainingLoop) -> np.ndarray:
    """Trains on; returns the observations of the first seed at every step."""
    end = engine.control_steps + _EPISODES * EPISODE
    seen = [engine.environments.observations[0].clone() for _ in engine.learn(end)]
    return torch.stack(seen).numpy()


def _trace(make: _Make, seeds: list[int], evaluate: bool = False) -> np.ndarray:
    """Returns the observations (steps, environments, size) of the first seed in a new training."""
    with make(seeds) as engine:
        observations = np.zeros((len(seeds), 3, engine.environments.size), np.float32)
        seen = []
        for _ in engine.learn(_EPISODES * EPISODE):
            if evaluate:
                engine.act(observations)
                engine.policy(0)
            seen.append(engine.environments.observations[0].clone())

    return torch.stack(seen).numpy()
