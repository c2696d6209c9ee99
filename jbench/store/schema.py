"""The tables of the database, as Arrow schemas. Units are in the fields' metadata.

`docs/database.md` and, for encoders, `docs/encoders.md` describe the rows.
"""

from functools import partial
from itertools import chain

import pyarrow as pa

from jbench.names import TASKS

Columns = list[pa.Field]


def columns(type_: pa.DataType, *names: str, unit: str | None = None) -> Columns:
    """Returns columns of one type and unit."""
    metadata = {"unit": unit} if unit else None
    return [pa.field(name, type_, metadata=metadata) for name in names]


def table(*groups: Columns) -> pa.Schema:
    """Returns the schema of a table with these columns."""
    return pa.schema(chain.from_iterable(groups))


text = partial(columns, pa.string())
int16 = partial(columns, pa.int16())
int32 = partial(columns, pa.int32())
int64 = partial(columns, pa.int64())
float32 = partial(columns, pa.float32())
float64 = partial(columns, pa.float64())

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

_ERRORS = float64(
    "test_mse",
    "test_variance",
    "pca_mse",
    "random_mse",
    "heuristic_mse",
    "heuristic_variance",
    "pca_heuristic_mse",
    "random_heuristic_mse",
    unit="scaled features squared",
)

KEPT = "kept"  # a column that is computed when rows are read

_FEATURES = [text("encoder"), int32("index"), text("feature"), _ERRORS]

ENCODER_TABLES = {
    # On up to 128 held-out episodes. Kinds that do not corrupt their input have no
    # `test_denoising_mse`.
    "encoder_epochs": table(
        text("encoder"),
        int32("epoch"),
        float64("train_loss", unit="what its kind minimizes; dae: as test_denoising_mse"),
        float64("test_mse", unit="scaled features squared; clean input"),
        float64("test_denoising_mse", unit="scaled features squared; corrupted input"),
        float64("wall_time", unit="s of training"),
    ),
    # `heuristic`: on ten episodes of the task's hand-written policy. A variance is that of the
    # target states.
    "encoder_features": table(*_FEATURES),
    # Means of the columns of `encoder_features`.
    "encoder_errors": table(
        text("encoder"),
        int64("test_states", "heuristic_states"),
        _ERRORS,
        float64(
            "test_explained",
            "pca_explained",
            "random_explained",
            "heuristic_explained",
            "pca_heuristic_explained",
            "random_heuristic_explained",
            unit="fraction of the variance",
        ),
    ),
    # A row per `target`: `yaw_rate`, `tilt_rate`, `forward_speed` and `reward`. `r2` is null for a
    # constant target; encoders of before version 5 have neither `linear_r2` nor `amplitude`.
    "encoder_predictions": table(
        text("encoder", "target"),
        float64("r2", unit="fraction of the variance"),
        float64("linear_r2", unit="fraction of the variance; of a linear regression"),
        float64("amplitude", unit="of the latents; null if linear_r2 is below 0.5"),
        float64("effective_rank", unit="of the latents, the same for every target"),
        int64("learned_rows", "test_rows"),
    ),
}

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
        *_FEATURES,
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
