"""Name and unit of each dimension of an observation."""

from jbench.tasks.features import TASK_SPECS


def feature_labels(task: str) -> list[str]:
    """Returns a name for each dimension of a task's observation."""
    axes = {
        "position": ("x", "y", "z", "qw", "qx", "qy", "qz"),
        "velocity": ("x", "y", "z", "angular_x", "angular_y", "angular_z"),
        "speed_in_target_frame": ("x", "y", "z"),
        "target_in_jitterbug_frame": ("x", "y", "z"),
    }
    return [
        f"{name}_{axis}" if axis else name
        for name in TASK_SPECS[task].features
        for axis in axes.get(name, ("",))
    ]


def feature_units(task: str) -> list[str]:
    """Returns the SI unit of each dimension of a task's features; 1 for quaternions."""
    units = {
        "position": ("m",) * 3 + ("1",) * 4,
        "velocity": ("m/s",) * 3 + ("rad/s",) * 3,
        "motor_position": ("rad",),
        "motor_velocity": ("rad/s",),
        "angle_to_target": ("rad",),
        "speed_in_target_frame": ("m/s",) * 3,
        "target_in_jitterbug_frame": ("m",) * 3,
    }
    return [unit for name in TASK_SPECS[task].features for unit in units[name]]
