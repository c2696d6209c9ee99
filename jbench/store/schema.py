"""The tables of the database, as Arrow schemas. Units are in the fields' metadata."""

import pyarrow as pa

from jbench.names import TASKS
from jbench.store.encoder_schema import ENCODER_TABLES, field

_RUN = field("run", pa.string())
_CELL = tuple(field(name, pa.string()) for name in ("task", "algo", "representation"))
_WALL_TIME = field("wall_time", pa.float64(), "s since the run began")
_PROCESSOR_TIME = field("processor_time", pa.float64(), "s of processor time since the run began")
_RETURN = field("episode_return", pa.float64(), "sum of rewards")
_LENGTH = field("length", pa.int32(), "control steps")
_CONTROL_STEPS = field("control_steps", pa.int64(), "control steps of the run, all environments")
_MANIFEST = (
    field("created", pa.string(), "UTC"),
    field("updated", pa.string(), "UTC"),
    field("settings", pa.string(), "JSON"),
    field("provenance", pa.string(), "JSON"),
)

LOSSES = (
    "actor_loss",
    "critic_loss",
    "entropy_coefficient",
    "policy_loss",
    "value_loss",
    "entropy_loss",
    "prediction_loss",
)
"""Columns of `episodes`: the last losses before an episode's end; null before any update."""

EPISODES = pa.schema(
    [
        _RUN,
        field("episode", pa.int32()),
        _CONTROL_STEPS,
        _RETURN,
        _LENGTH,
        _WALL_TIME,
        _PROCESSOR_TIME,
        *(field(name, pa.float64()) for name in LOSSES),
    ]
)
"""Training episodes of a run, ordered by their ends.

`processor_time` of runs that are trained in one process is divided evenly among them.
"""

EVALUATIONS = pa.schema(
    [
        _RUN,
        field("evaluation", pa.int32()),
        _CONTROL_STEPS,
        field("episode", pa.int32()),
        _RETURN,
        _LENGTH,
        _WALL_TIME,
        _PROCESSOR_TIME,
    ]
)
"""Episodes of the deterministic policy, `episode` counting within each `evaluation`."""

PATHS = pa.schema(
    [
        _RUN,
        field("evaluation", pa.int32()),
        _CONTROL_STEPS,
        field("time", pa.float32(), "s since the episode began"),
        *(field(name, pa.float32(), "m") for name in ("x", "y", "target_x", "target_y")),
        *(field(name, pa.float32(), "rad") for name in ("heading", "target_yaw")),
    ]
)
"""Where the robot was in the first episode of a run's first evaluation and of its latest one.

Numbers of the target are null if they are not random in the task.
"""

METRICS = pa.schema(
    [
        _RUN,
        _CONTROL_STEPS,
        field("name", pa.string()),
        field("value", pa.float64()),
        _WALL_TIME,
    ]
)
"""What a training loop passed to `Recording.log`, a row for each value."""

EPISODE_TABLES = {"episodes": EPISODES, "evaluations": EVALUATIONS}
"""Tables with a row for each episode of a run."""

LOG_TABLES = {**EPISODE_TABLES, "metrics": METRICS}
"""Tables to which a run in progress adds rows."""

RUN_TABLES = {**LOG_TABLES, "paths": PATHS}
"""All tables of a run's files by name."""

RUNS = pa.schema(
    [
        _RUN,
        *_CELL,
        field("encoder", pa.string()),
        field("seed", pa.int64()),
        field("steps", pa.int64(), "control steps asked for"),
        field("engine", pa.string()),
        field("time_limit", pa.string()),
        field("variant", pa.string(), "hash of the settings but seed and steps"),
        field("status", pa.string()),
        field("episodes", pa.int64()),
        field("wall_time", pa.float64(), "s"),
        field("processor_time", pa.float64(), "s"),
        field("diverged", pa.string(), "JSON; null unless the run diverged"),
        *_MANIFEST,
    ]
)
"""One row per run, from its manifest."""

ENCODERS = pa.schema(
    [
        field("encoder", pa.string()),
        field("task", pa.string()),
        field("kind", pa.string()),
        field("representation", pa.string()),
        field("latents", pa.int64()),
        field("seed", pa.int64()),
        field("dataset", pa.string()),
        field("status", pa.string()),
        field("test_mse", pa.float64(), "scaled features squared; clean input"),
        field("test_explained", pa.float64(), "fraction of the variance"),
        field("effective_rank", pa.float64(), "of the latents on held-out episodes"),
        field("wall_time", pa.float64(), "s"),
        *_MANIFEST,
    ]
)
"""One row for each encoder, from its manifest."""

DATASETS = pa.schema(
    [
        field("dataset", pa.string()),
        field("seed", pa.int64()),
        field("steps", pa.int64(), "control steps asked for"),
        field("steps_done", pa.int64(), "control steps"),
        field("status", pa.string()),
        field("bytes", pa.int64(), "bytes on disk"),
        *_MANIFEST,
    ]
)
"""One row for each dataset, from its manifest."""

POLICY_EVALUATIONS = pa.schema(
    [
        field("evaluation", pa.string()),
        field("task", pa.string()),
        field("policy", pa.string()),
        field("seed", pa.int64()),
        field("episodes", pa.int64()),
        field("status", pa.string()),
        field("median", pa.float64(), "sum of rewards"),
        field("q10", pa.float64(), "sum of rewards"),
        field("q90", pa.float64(), "sum of rewards"),
        *_MANIFEST,
    ]
)
"""One row for each evaluation of a policy by `jbench evaluate`, from its manifest."""

POLICY_EPISODES = pa.schema(
    [
        field("evaluation", pa.string()),
        field("episode", pa.int32()),
        _RETURN,
        _LENGTH,
        field("target_x", pa.float64(), "m"),
        field("target_y", pa.float64(), "m"),
        field("target_yaw", pa.float64(), "rad"),
    ]
)
"""Episodes of a policy that was evaluated by `jbench evaluate`."""

POLICY_STATES = pa.schema(
    [
        field("episode", pa.int32()),
        field("step", pa.int16(), "control steps; the state after it"),
        *(field(name, pa.float32(), "m") for name in ("x", "y", "z")),
        field("heading", pa.float32(), "rad"),
        field("upright", pa.float32(), "reward"),
        field("motor_position", pa.float32(), "rad"),
        field("motor_velocity", pa.float32(), "rad/s"),
        field("action", pa.float32()),
        field("reward", pa.float32()),
    ]
)
"""States of an evaluated policy; too large to be a table of `jbench query`."""

STATE_COLUMNS = {
    "position": (
        *("position_x", "position_y", "position_z"),
        *("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z"),
    ),
    "velocity": (
        *("velocity_x", "velocity_y", "velocity_z"),
        *("angular_velocity_x", "angular_velocity_y", "angular_velocity_z"),
    ),
    "motor_position": ("motor_position",),
    "motor_velocity": ("motor_velocity",),
    "torso_velocity": ("torso_velocity_x", "torso_velocity_y", "torso_velocity_z"),
}
"""Columns of the fields of `jbench.tasks.features.State`, in SI units."""

STEPS = pa.schema(
    [
        field("episode", pa.int32()),
        field("step", pa.int16()),
        *(field(name, pa.float32()) for names in STATE_COLUMNS.values() for name in names),
        field("action", pa.float32()),
    ]
)
"""States of a dataset: `step` 0 to 1000, and the action taken in the state, null in an episode's
last. Too large to be a table of `jbench query`.
"""

DATASET_EPISODES = pa.schema(
    [
        field("episode", pa.int32()),
        *(
            field(f"{task}_target_{part}", pa.float64())
            for task in TASKS
            for part in ("x", "y", "yaw")
        ),
    ]
)
"""Episodes of a dataset: the target of each task (m, m, rad)."""

_IMPORT = field("import", pa.string())

IMPORTS = pa.schema(
    [
        _IMPORT,
        *_CELL,
        field("seed", pa.int64()),
        field("format", pa.string()),
        field("returns", pa.string(), "training or evaluation"),
        field("points", pa.int64()),
        field("control_steps", pa.int64(), "control steps of the last point"),
        field("files", pa.string(), "JSON: names by SHA-256"),
        field("status", pa.string()),
        *_MANIFEST,
    ]
)
"""One row for each learning curve that `jbench import` read, from its manifest."""

IMPORT_POINTS = pa.schema(
    [
        _IMPORT,
        field("point", pa.int32()),
        field("control_steps", pa.int64(), "control steps before the point, all environments"),
        field("episode", pa.int32()),
        _RETURN,
        _LENGTH,
        field("wall_time", pa.float64(), "s since the first point; null if unknown"),
    ]
)
"""Points of imported curves, `episode` counting within a point.

A point is a training episode, an evaluation, or a value of a TensorBoard tag or a CSV column.
"""

PUBLISHED = pa.schema(
    [
        field("figure", pa.string()),
        *_CELL,
        field("control_steps", pa.float64(), "control steps, center of the window"),
        field("quantile", pa.int64(), "percent"),
        _RETURN,
        field("source", pa.string()),
    ]
)
"""The learning curves of the paper, read from its figures."""

TABLES = {
    "runs": RUNS,
    **RUN_TABLES,
    "encoders": ENCODERS,
    **ENCODER_TABLES,
    "datasets": DATASETS,
    "policy_evaluations": POLICY_EVALUATIONS,
    "policy_episodes": POLICY_EPISODES,
    "imports": IMPORTS,
    "import_points": IMPORT_POINTS,
    "published": PUBLISHED,
}
"""The tables of `jbench query`."""

FILES = {
    **TABLES,
    "policy_states": POLICY_STATES,
    "steps": STEPS,
    "dataset_episodes": DATASET_EPISODES,
}
"""All tables, including those too large for `jbench query`."""
