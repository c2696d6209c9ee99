"""What an environment returns for a state: observation, reward and `info`.

The functions take any leading axes `...`, like `features` and `rewards`: none for one environment,
(num_envs,) for a vector of environments.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.tasks import features, rewards
from jbench.tasks.features import Array, State, Target
from jbench.tasks.resets import target_numbers


class Outcome(NamedTuple):
    """Observation, reward and further numbers of a state.

    Attributes:
        observation: (..., dim(O)) as in `features.observation`.
        reward: (...) as in `rewards.reward`.
        info: values by name, those of
            target: (..., n) the target's random numbers, see `resets.target_numbers`,
            distance: (...) from the torso to the target (m), if the reward depends on it,
            angle: (...) from heading to target in (-pi, pi] (rad), if the task observes it,
            reward_...: (...) each term of the reward, which is their product.
    """

    observation: NDArray[np.float32]
    reward: Array
    info: dict[str, Array]


def outcome(task: str, state: State, target: Target) -> Outcome:
    """Returns the outcome of states of a task, with the same leading axes as the targets."""
    values = features.features(task, state, target)
    info = {}
    if features.TASK_SPECS[task].target_numbers:
        info["target"] = target_numbers(task, target)
    if features.TASK_SPECS[task].rewards_position:
        info["distance"] = features.distance_to_target(state, target)
    angle = None
    if "angle_to_target" in values:
        info["angle"] = angle = values["angle_to_target"][..., 0]
    terms = rewards.reward_terms(task, state, target, angle)
    info.update({f"reward_{name}": term for name, term in terms.items()})
    observation = np.asarray(features.flatten(task, values), np.float32)
    return Outcome(observation, math.prod(terms.values()), info)
