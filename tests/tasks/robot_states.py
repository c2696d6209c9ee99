"""States and targets for tests: fixed, drawn by hypothesis, and in batches."""

import math

import numpy as np
import torch
from hypothesis import strategies as st

from jbench.tasks.jitterbug.geometry import State, Target

_COMMON = {"position": 7, "velocity": 6, "motor_position": 1, "motor_velocity": 1}
FEATURES = {
    "move_from_origin": _COMMON,
    "face_direction": _COMMON | {"angle_to_target": 1},
    "move_in_direction": _COMMON | {"angle_to_target": 1, "speed_in_target_frame": 3},
    "move_to_position": _COMMON | {"target_in_jitterbug_frame": 3},
    "move_to_pose": _COMMON | {"target_in_jitterbug_frame": 3, "angle_to_target": 1},
}
"""The features that the paper's tasks observe, and their sizes."""
SIZES = {task: sum(sizes.values()) for task, sizes in FEATURES.items()}

REST = State(
    position=np.array([0, 0, 0.035, 1, 0, 0, 0]),
    velocity=np.zeros(6),
    motor_position=np.array(math.pi / 2),
    motor_velocity=np.array(0.0),
    torso_velocity=np.zeros(3),
)
"""The robot at rest at the origin: it faces -y."""


def rest(**changes):
    return REST._replace(**{name: np.array(value, float) for name, value in changes.items()})


def turned(yaw):
    """The robot at rest, turned to the left by `yaw`."""
    return rest(position=[0, 0, 0.035, math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)])


def target(x=0.0, y=0.0, z=0.035, yaw=0.0):
    return Target(np.array([x, y, z]), np.array(yaw))


def convert(arrays, kind, dtype="float64"):
    """The same state or target in arrays of numpy or torch."""
    if kind == "torch":
        return type(arrays)(*(torch.as_tensor(a, dtype=getattr(torch, dtype)) for a in arrays))
    return type(arrays)(*(np.asarray(a, dtype) for a in arrays))


def random_states(shape, seed=0):
    """Random states and targets with leading axes `shape`."""
    random = np.random.default_rng(seed)
    quaternion = random.normal(size=(*shape, 4))
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    xyz = random.uniform(-0.2, 0.2, (*shape, 3))
    state = State(
        position=np.concatenate([xyz, quaternion], -1),
        velocity=random.uniform(-1, 1, (*shape, 6)),
        motor_position=random.uniform(-math.pi, math.pi, shape),
        motor_velocity=random.uniform(-150, 150, shape),
        torso_velocity=random.uniform(-0.2, 0.2, (*shape, 3)),
    )
    goal = Target(random.uniform(-0.2, 0.2, (*shape, 3)), random.uniform(0, 2 * math.pi, shape))
    return state, goal


def numbers(low, high):
    return st.floats(low, high, allow_subnormal=False)


def vectors(size, bound):
    return st.lists(numbers(-bound, bound), min_size=size, max_size=size).map(np.array)


def quaternions():
    long_enough = vectors(4, 1.0).filter(lambda q: np.linalg.norm(q) > 0.1)
    return long_enough.map(lambda q: q / np.linalg.norm(q))


@st.composite
def states(draw):
    """States that vary in all quantities that a reward depends on."""
    position = np.concatenate([draw(vectors(3, 0.2)), draw(quaternions())])
    return REST._replace(position=position, torso_velocity=draw(vectors(3, 0.3)))


def targets():
    return st.builds(Target, vectors(3, 0.2), numbers(0, 2 * math.pi).map(np.array))
