"""The tables of the database, as Arrow schemas. Units are in the fields' metadata.

`docs/database.md` describes the rows.
"""

from itertools import chain

from jbench.names import TASKS
from jbench.store.columns import float32, float64, int16, int32, int64, table, text
from jbench.store.encoder_tables import ENCODER_TABLES, FEATURES, KEPT

_CELL = text("task", "algo", "representation")
_CONTROL_STEPS = int64("control_steps", unit="control steps of the run, all environments")
_RETURN = float64("episode_return", unit="sum of rewards")
_LENGTH = int32("length", unit="control steps")
_WALL_TIME = float64("wall_time", unit="s since the run began")
_PROCESSOR_TIME = float64("processor_time", unit="s of processor time since the run began")
_MANIFEST = [*text("created", "updated", unit="UTC"), *text("settings", "provenance", unit="JSON")]

TIMES = ("wall_time", "processor_time")
"""Columns that may differ between two computations of the same record."""

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

EPISODES = table(
    text("run"),
    int32("episode"),
    _CONTROL_STEPS,
    _RETURN,
    _LENGTH,
    _WALL_TIME,
    _PROCESSOR_TIME,
    float64(*LOSSES),
)
"""Training episodes of a run, ordered by their ends."""

EVALUATIONS = table(
    text("run"),
    int32("evaluation"),
    _CONTROL_STEPS,
    int32("episode"),
    _RETURN,
    _LENGTH,
    _WALL_TIME,
    _PROCESSOR_TIME,
)

PATHS = table(
    text("run"),
    int32("evaluation"),
    _CONTROL_STEPS,
    float32("time", unit="s since the episode began"),
    float32("x", "y", "target_x", "target_y", unit="m"),
    float32("heading", "target_yaw", unit="rad"),
)

METRICS = table(text("run"), _CONTROL_STEPS, text("name"), float64("value"), _WALL_TIME)

LOG_TABLES = {"episodes": EPISODES, "evaluations": EVALUATIONS, "metrics": METRICS}
"""Tables to which a run in progress adds rows."""

RUN_TABLES = {**LOG_TABLES, "paths": PATHS}

STATE_COLUMNS = {
    "position": (
        "position_x",
        "position_y",
        "position_z",
        "quaternion_w",
        "quaternion_x",
        "quaternion_y",
        "quaternion_z",
    ),
    "velocity": (
        "velocity_x",
        "velocity_y",
        "velocity_z",
        "angular_velocity_x",
        "angular_velocity_y",
        "angular_velocity_z",
    ),
    "motor_position": ("motor_position",),
    "motor_velocity": ("motor_velocity",),
    "torso_velocity": ("torso_velocity_x", "torso_velocity_y", "torso_velocity_z"),
}
"""Columns of the fields of `jbench.tasks.jitterbug.geometry.State`, in SI units."""

_TARGET_NAMES = [f"{task}_target_{part}" for task in TASKS for part in ("x", "y", "yaw")]

STEPS = table(int32("episode"), int16("step"), float32(*chain(*STATE_COLUMNS.values()), "action"))
"""`step` counts from 0 to 1000; the action is null in an episode's last state."""

DATASET_EPISODES = table(int32("episode"), float64(*_TARGET_NAMES))
"""The target of each task (m, m, rad)."""

TABLES = {
    "runs": table(
        text("run"),
        _CELL,
        text("encoder"),
        int64("seed"),
        int64("steps", unit="control steps asked for"),
        text("engine", "time_limit"),
        text("variant", unit="hash of the settings but seed and steps"),
        text("status"),
        int64("episodes"),
        float64("wall_time", "processor_time", unit="s"),
        text("diverged", unit="JSON; null unless the run diverged"),
        text("error", unit="why a run failed"),
        _MANIFEST,
    ),
    # Of a run that diverged they are its `returns.diverged_return`.
    "final_returns": table(
        text("run"),
        int64("seed"),
        float64(
            "evaluation_return", "training_return", unit="sum of rewards; null if there is none"
        ),
        float64("evaluation_return_at_end", unit="without the episodes that jbench evaluate added"),
        float64("wall_time", unit="s"),
        text("error", unit="why a run failed"),
    ),
    **RUN_TABLES,
    "encoders": table(
        text("encoder", "task", "kind", "representation"),
        int64("latents", "seed"),
        text("dataset", "status"),
        float64("test_mse", unit="scaled features squared; clean input"),
        float64("test_explained", unit="fraction of the variance"),
        float64("effective_rank", unit="of the latents on held-out episodes"),
        float64("wall_time", unit="s"),
        _MANIFEST,
    ),
    **ENCODER_TABLES,
    "encoder_features": table(
        *FEATURES,
        float64(KEPT, unit="fraction of the feature's direction; null for more than one layer"),
    ),
    "datasets": table(
        text("dataset"),
        int64("seed"),
        int64("steps", unit="control steps asked for"),
        int64("steps_done", unit="control steps"),
        text("status"),
        int64("bytes", unit="bytes on disk"),
        _MANIFEST,
    ),
    "policy_evaluations": table(
        text("evaluation", "task", "policy"),
        int64("seed", "episodes"),
        text("status"),
        float64("mean", "median", "q10", "q90", unit="sum of rewards"),
        _MANIFEST,
    ),
    "policy_episodes": table(
        text("evaluation"),
        int32("episode"),
        _RETURN,
        _LENGTH,
        float64("target_x", "target_y", unit="m"),
        float64("target_yaw", unit="rad"),
    ),
    "imports": table(
        text("import"),
        _CELL,
        int64("seed"),
        text("format"),
        text("returns", unit="training or evaluation"),
        int64("points"),
        int64("control_steps", unit="control steps of the last point"),
        text("files", unit="JSON: names by SHA-256"),
        text("status"),
        _MANIFEST,
    ),
    # A point is a training episode, an evaluation, or a value of a TensorBoard tag or a CSV column.
    "import_points": table(
        text("import"),
        int32("point"),
        int64("control_steps", unit="control steps before the point, all environments"),
        int32("episode"),
        _RETURN,
        _LENGTH,
        float64("wall_time", unit="s since the first point; null if unknown"),
    ),
    "published": table(
        text("figure"),
        _CELL,
        float64("control_steps", unit="control steps, center of the window"),
        int64("quantile", unit="percent"),
        _RETURN,
        text("source"),
    ),
}
"""The tables of `jbench query`."""

FILES = {
    **TABLES,
    **ENCODER_TABLES,
    "policy_states": table(
        int32("episode"),
        int16("step", unit="control steps; the state after it"),
        float32("x", "y", "z", unit="m"),
        float32("heading", unit="rad"),
        float32("upright", unit="reward"),
        float32("motor_position", unit="rad"),
        float32("motor_velocity", unit="rad/s"),
        float32("action", "reward"),
    ),
    "steps": STEPS,
    "dataset_episodes": DATASET_EPISODES,
}
"""All tables, including those too large for `jbench query`."""
