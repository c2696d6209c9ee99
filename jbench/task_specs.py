"""Names of tasks, and the five tasks as data; no heavy imports, so help and completion are fast."""

from dataclasses import dataclass

_STATE = ("position", "velocity", "motor_position", "motor_velocity")


@dataclass(frozen=True)
class TaskSpec:
    """One of the five tasks as data (paper, section 4.2).

    `rewards` are the names of the terms whose product is the reward. The target is at the origin
    with yaw 0 unless they are drawn.
    """

    features: tuple[str, ...]
    rewards: tuple[str, ...]
    draws_position: bool = False
    draws_yaw: bool = False

    @property
    def rewards_position(self) -> bool:
        """Whether the reward depends on the robot's position."""
        return not {"near", "away"}.isdisjoint(self.rewards)

    @property
    def target_numbers(self) -> tuple[str, ...]:
        """The numbers of a target that are random, in order: x and y (m), and yaw (rad)."""
        return ("x", "y") * self.draws_position + ("yaw",) * self.draws_yaw


TASK_SPECS = {
    # "away" is what is left of 1 by "near", the target being at the origin.
    "move_from_origin": TaskSpec(_STATE, ("away", "upright")),
    "face_direction": TaskSpec(
        (*_STATE, "angle_to_target"), ("heading", "upright"), draws_yaw=True
    ),
    "move_in_direction": TaskSpec(
        (*_STATE, "angle_to_target", "speed_in_target_frame"), ("speed", "upright"), draws_yaw=True
    ),
    "move_to_position": TaskSpec(
        (*_STATE, "target_in_jitterbug_frame"), ("near", "upright"), draws_position=True
    ),
    "move_to_pose": TaskSpec(
        (*_STATE, "target_in_jitterbug_frame", "angle_to_target"),
        ("near", "heading", "upright"),
        draws_position=True,
        draws_yaw=True,
    ),
}
"""The five tasks in the paper's order of increasing difficulty."""

SUITE = "dmc:"

SUITE_TASKS = tuple(
    f"{SUITE}{domain}-{task}"
    for domain, tasks in {
        "acrobot": "swingup swingup_sparse",
        "ball_in_cup": "catch",
        "cartpole": "balance balance_sparse swingup swingup_sparse two_poles three_poles",
        "cheetah": "run",
        "dog": "stand walk trot run fetch",
        "finger": "spin turn_easy turn_hard",
        "fish": "upright swim",
        "hopper": "stand hop",
        "humanoid": "stand walk run run_pure_state",
        "humanoid_CMU": "stand walk run",
        "manipulator": "bring_ball bring_peg insert_ball insert_peg",
        "pendulum": "swingup",
        "point_mass": "easy hard",
        "quadruped": "walk run escape fetch",
        "reacher": "easy hard",
        "stacker": "stack_2 stack_4",
        "swimmer": "swimmer6 swimmer15",
        "walker": "stand walk run",
    }.items()
    for task in tasks.split()
)
"""The tasks of dm_control's suite with episodes of 1000 control steps, for completion."""

TASK_GROUP = "jbench.tasks"
"""Entry points of functions that return a `dm_env.Environment`."""
