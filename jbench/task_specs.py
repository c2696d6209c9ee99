"""Names of tasks, and the five tasks as data; no heavy imports, so help and completion are fast."""

import math
from dataclasses import dataclass
from typing import Literal

_STATE = ("position", "velocity", "motor_position", "motor_velocity")


@dataclass(frozen=True)
class TaskSpec:
    """One of the five tasks as data (paper, section 4.2).

    `rewards` are the names of the terms whose product is the reward, and `drawn` those of the
    target's numbers that are drawn, in order: x and y (m), and yaw (rad). The others are 0.
    """

    features: tuple[str, ...]
    rewards: tuple[str, ...]
    drawn: tuple[str, ...] = ()

    @property
    def has_speed(self) -> bool:
        """Whether observations or rewards depend on the velocity of the center of mass."""
        return "speed_in_target_frame" in self.features or "speed" in self.rewards


_ANGLE = "angle_to_target"
_TARGET = "target_in_jitterbug_frame"

TASK_SPECS = {
    # "away" is what is left of 1 by "near", the target being at the origin.
    "move_from_origin": TaskSpec(_STATE, ("away", "upright")),
    "face_direction": TaskSpec((*_STATE, _ANGLE), ("heading", "upright"), ("yaw",)),
    "move_in_direction": TaskSpec(
        (*_STATE, _ANGLE, "speed_in_target_frame"), ("speed", "upright"), ("yaw",)
    ),
    "move_to_position": TaskSpec((*_STATE, _TARGET), ("near", "upright"), ("x", "y")),
    "move_to_pose": TaskSpec(
        (*_STATE, _TARGET, _ANGLE), ("near", "heading", "upright"), ("x", "y", "yaw")
    ),
}
"""The five tasks in the paper's order of increasing difficulty."""

EPISODE_STEPS = 1000
"""Control steps of an episode of the Jitterbug (paper, section 4.1)."""

CONTROL_TIMESTEP = 0.01
"""Simulated seconds in a control step of the Jitterbug."""

PHYSICS_STEPS = 50
"""Physics steps of 0.2 ms in a control step of the Jitterbug; the action is held constant."""

SOLVED_RETURN = 900
"""Episode return from which a task of the Jitterbug is solved (paper, Figure 9)."""

CAMERAS = ("overhead", "tracking", "ego", "spectator")
"""The cameras of the Jitterbug: the paper's three (section 4.1) and a fixed view from the side."""

SUITE = "dmc:"

_SUITE_NAMES = """
acrobot-swingup acrobot-swingup_sparse ball_in_cup-catch cartpole-balance cartpole-balance_sparse
cartpole-swingup cartpole-swingup_sparse cartpole-two_poles cartpole-three_poles cheetah-run
dog-stand dog-walk dog-trot dog-run dog-fetch finger-spin finger-turn_easy finger-turn_hard
fish-upright fish-swim hopper-stand hopper-hop humanoid-stand humanoid-walk humanoid-run
humanoid-run_pure_state humanoid_CMU-stand humanoid_CMU-walk humanoid_CMU-run manipulator-bring_ball
manipulator-bring_peg manipulator-insert_ball manipulator-insert_peg pendulum-swingup
point_mass-easy point_mass-hard quadruped-walk quadruped-run quadruped-escape quadruped-fetch
reacher-easy reacher-hard stacker-stack_2 stacker-stack_4 swimmer-swimmer6 swimmer-swimmer15
walker-stand walker-walk walker-run
"""
SUITE_TASKS = tuple(f"{SUITE}{name}" for name in _SUITE_NAMES.split())
"""The tasks of dm_control's suite with episodes of 1000 control steps, for completion."""

GYM = "gym:"
"""Prefix of the tasks of Gymnasium's registry, such as gym:Pendulum-v1,g=9.8."""

TASK_GROUP = "jbench.tasks"
"""Entry points of functions that return a `dm_env.Environment` or a `gymnasium.Env`."""


def episode_steps(task: str) -> int | None:
    """Returns the control steps of an episode; None if the settings of its robot say it."""
    return EPISODE_STEPS if task in TASK_SPECS else None


def solved_return(task: str) -> float | None:
    """Returns the episode return from which a task is solved; None if nothing says so."""
    return SOLVED_RETURN if task in TASK_SPECS else None


def return_range(task: str) -> tuple[float, float] | None:
    """Returns the least and the largest possible return of an episode; None if unknown."""
    if task in TASK_SPECS or task.startswith(SUITE):
        return 0.0, 1000.0
    return None


def highest_return(task: str) -> float:
    """Returns the largest possible return of an episode; infinity if it is unknown."""
    known = return_range(task)
    if known is None:
        return math.inf

    _, highest = known
    return highest


def default_base(task: str) -> Literal["published", "suite"]:
    """Returns the source of a task's hyperparameters if users name none."""
    return "published" if task in TASK_SPECS else "suite"


def has_specs(task: str) -> bool:
    """Returns whether settings record what robot, observation and actions of a task are."""
    return task not in TASK_SPECS
