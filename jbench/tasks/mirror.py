"""The robot's mirror symmetry: reflection at the world's plane x = 0, with the action negated.

The mirror image of a robot that makes the negated actions moves as the image of the robot, and
every task's reward is the same: x and -x are the robot's left and right at heading 0, where legs 1
and 4, and legs 2 and 3, change places. `docs/encoders.md` has the accuracy of the simulator.
"""

from functools import cache

from array_api_compat import array_namespace

from jbench.tasks.features import TASK_SPECS, Array

_SIGNS = {
    # The reflected orientation is (w, x, -y, -z), or (-w, -x, y, z), which is the same. Episodes
    # start with z >= 0, so only the second one is where the robot itself could have been.
    "position": (-1, 1, 1, -1, -1, 1, 1),
    # An angular velocity is an axial vector: its components in the mirror's plane change sign.
    "velocity": (-1, 1, 1, 1, -1, -1),
    "motor_position": (-1,),
    "motor_velocity": (-1,),
    "angle_to_target": (-1,),
    "speed_in_target_frame": (1, -1, 1),
    "target_in_jitterbug_frame": (-1, 1, 1),
}


@cache
def mirror_signs(task: str) -> tuple[int, ...]:
    """Returns dim(O) factors 1 or -1 that mirror an observation of a task."""
    return tuple(sign for name in TASK_SPECS[task].features for sign in _SIGNS[name])


def mirrored(task: str, observation: Array) -> Array:
    """Returns the observation (..., dim(O)) of the mirrored robot and its mirrored target."""
    xp = array_namespace(observation)
    device = getattr(observation, "device", None)
    return observation * xp.asarray(mirror_signs(task), dtype=observation.dtype, device=device)
