"""The tables of the database, as Arrow schemas. Units are in the fields' metadata."""

import pyarrow as pa

from jbench.names import TASKS


def _field(name: str, kind: pa.DataType, unit: str = "") -> pa.Field:
    return pa.field(name, kind, metadata={"unit": unit} if unit else None)


_RUN = _field("run", pa.string())
_WALL_TIME = _field("wall_time", pa.float64(), "s since the run began")
_PROCESSOR_TIME = _field("processor_time", pa.float64(), "s of processor time since the run began")
_RETURN = _field("episode_return", pa.float64(), "sum of rewards")
_LENGTH = _field("length", pa.int32(), "control steps")
_CONTROL_STEPS = _field("control_steps", pa.int64(), "control steps of the run, all environments")

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
        _field("episode", pa.int32()),
        _CONTROL_STEPS,
        _RETURN,
        _LENGTH,
        _WALL_TIME,
        _PROCESSOR_TIME,
        *(_field(name, pa.float64()) for name in LOSSES),
    ]
)
"""Training episodes of a run, ordered by their ends.

`processor_time` of runs that are trained in one process is divided evenly among them.
"""

EVALUATIONS = pa.schema(
    [
        _RUN,
        _field("evaluation", pa.int32()),
        _CONTROL_STEPS,
        _field("episode", pa.int32()),
        _RETURN,
        _LENGTH,
        _WALL_TIME,
        _PROCESSOR_TIME,
    ]
)
"""Episodes of the deterministic policy, `episode` counting within each `evaluation`."""

ENCODER_EPOCHS = pa.schema(
    [
        _field("encoder", pa.string()),
        _field("epoch", pa.int32()),
        _field("train_loss", pa.float64(), "what its kind minimises; dae: as test_denoising_mse"),
        _field("test_mse", pa.float64(), "scaled features squared; clean input"),
        _field("test_denoising_mse", pa.float64(), "scaled features squared; corrupted input"),
        _field("wall_time", pa.float64(), "s of training"),
    ]
)
"""Errors of an encoder after each epoch on up to 128 held-out episodes; empty for closed forms.

`test_denoising_mse` is null for kinds that do not corrupt their input.
"""

_SQUARED = "scaled features squared"
_ERRORS = (
    _field("test_mse", pa.float64(), _SQUARED),
    _field("test_variance", pa.float64(), _SQUARED),
    _field("pca_mse", pa.float64(), _SQUARED),
    _field("random_mse", pa.float64(), _SQUARED),
    _field("heuristic_mse", pa.float64(), _SQUARED),
    _field("heuristic_variance", pa.float64(), _SQUARED),
    _field("pca_heuristic_mse", pa.float64(), _SQUARED),
    _field("random_heuristic_mse", pa.float64(), _SQUARED),
)

ENCODER_FEATURES = pa.schema(
    [
        _field("encoder", pa.string()),
        _field("index", pa.int32()),
        _field("feature", pa.string()),
        *_ERRORS,
    ]
)
"""Error of a finished encoder on each feature: `test` on the held-out episodes, `heuristic` on ten
episodes of the task's hand-written policy. `pca` and `random` are PCA and a random projection of
the same size, fitted to the same states. A variance is that of the target states.
"""

ENCODER_ERRORS = pa.schema(
    [
        _field("encoder", pa.string()),
        _field("test_states", pa.int64()),
        _field("heuristic_states", pa.int64()),
        *_ERRORS,
        *(
            _field(f"{which}explained", pa.float64(), "fraction of the variance")
            for which in (
                *("test_", "pca_", "random_"),
                *("heuristic_", "pca_heuristic_", "random_heuristic_"),
            )
        ),
    ]
)
"""Error of a finished encoder over all features: the means of the columns of `encoder_features`,
and 1 - error / variance. `ddae` is compared with the future state, PCA with the present one.
"""

ENCODER_PREDICTIONS = pa.schema(
    [
        _field("encoder", pa.string()),
        _field("target", pa.string()),
        _field("r2", pa.float64(), "fraction of the variance"),
        _field("effective_rank", pa.float64(), "of the latents, the same for every target"),
        _field("learned_rows", pa.int64()),
        _field("test_rows", pa.int64()),
    ]
)
"""How well an encoder's latents and the action predict the next control step.

`r2` of a small network with fixed settings on held-out episodes, with a row per `target`:
`yaw_rate`, `tilt_rate`, `forward_speed` and `reward`. It is null for a constant target. Encoders
that were trained before this table existed have no rows.
"""

RUNS = pa.schema(
    [
        _RUN,
        _field("task", pa.string()),
        _field("algo", pa.string()),
        _field("representation", pa.string()),
        _field("encoder", pa.string()),
        _field("seed", pa.int64()),
        _field("steps", pa.int64(), "control steps asked for"),
        _field("engine", pa.string()),
        _field("time_limit", pa.string()),
        _field("variant", pa.string(), "hash of the settings but seed and steps"),
        _field("status", pa.string()),
        _field("episodes", pa.int64()),
        _field("wall_time", pa.float64(), "s"),
        _field("processor_time", pa.float64(), "s"),
        _field("diverged", pa.string(), "JSON; null unless the run diverged"),
        _field("created", pa.string(), "UTC"),
        _field("updated", pa.string(), "UTC"),
        _field("settings", pa.string(), "JSON"),
        _field("provenance", pa.string(), "JSON"),
    ]
)
"""One row per run, from its manifest."""

ENCODERS = pa.schema(
    [
        _field("encoder", pa.string()),
        _field("task", pa.string()),
        _field("kind", pa.string()),
        _field("representation", pa.string()),
        _field("latents", pa.int64()),
        _field("seed", pa.int64()),
        _field("dataset", pa.string()),
        _field("status", pa.string()),
        _field("test_mse", pa.float64(), "scaled features squared; clean input"),
        _field("test_explained", pa.float64(), "fraction of the variance"),
        _field("effective_rank", pa.float64(), "of the latents on held-out episodes"),
        _field("wall_time", pa.float64(), "s"),
        _field("created", pa.string(), "UTC"),
        _field("updated", pa.string(), "UTC"),
        _field("settings", pa.string(), "JSON"),
        _field("provenance", pa.string(), "JSON"),
    ]
)
"""One row for each encoder, from its manifest."""

DATASETS = pa.schema(
    [
        _field("dataset", pa.string()),
        _field("seed", pa.int64()),
        _field("steps", pa.int64(), "control steps asked for"),
        _field("steps_done", pa.int64(), "control steps"),
        _field("status", pa.string()),
        _field("bytes", pa.int64(), "bytes on disk"),
        _field("created", pa.string(), "UTC"),
        _field("updated", pa.string(), "UTC"),
        _field("settings", pa.string(), "JSON"),
        _field("provenance", pa.string(), "JSON"),
    ]
)
"""One row for each dataset, from its manifest."""

POLICY_EVALUATIONS = pa.schema(
    [
        _field("evaluation", pa.string()),
        _field("task", pa.string()),
        _field("policy", pa.string()),
        _field("seed", pa.int64()),
        _field("episodes", pa.int64()),
        _field("status", pa.string()),
        _field("median", pa.float64(), "sum of rewards"),
        _field("q10", pa.float64(), "sum of rewards"),
        _field("q90", pa.float64(), "sum of rewards"),
        _field("created", pa.string(), "UTC"),
        _field("updated", pa.string(), "UTC"),
        _field("settings", pa.string(), "JSON"),
        _field("provenance", pa.string(), "JSON"),
    ]
)
"""One row for each evaluation of a policy by `jbench evaluate`, from its manifest."""

POLICY_EPISODES = pa.schema(
    [
        _field("evaluation", pa.string()),
        _field("episode", pa.int32()),
        _RETURN,
        _LENGTH,
        _field("target_x", pa.float64(), "m"),
        _field("target_y", pa.float64(), "m"),
        _field("target_yaw", pa.float64(), "rad"),
    ]
)
"""Episodes of a policy that was evaluated by `jbench evaluate`."""

POLICY_STATES = pa.schema(
    [
        _field("episode", pa.int32()),
        _field("step", pa.int16(), "control steps; the state after it"),
        *(_field(name, pa.float32(), "m") for name in ("x", "y", "z")),
        _field("heading", pa.float32(), "rad"),
        _field("upright", pa.float32(), "reward"),
        _field("motor_position", pa.float32(), "rad"),
        _field("motor_velocity", pa.float32(), "rad/s"),
        _field("action", pa.float32()),
        _field("reward", pa.float32()),
    ]
)
"""States of an evaluated policy; too large to be a table of `jbench query`."""

STEPS = pa.schema(
    [
        _field("episode", pa.int32()),
        _field("step", pa.int16()),
        *(
            _field(name, pa.float32())
            for name in (
                *("position_x", "position_y", "position_z"),
                *("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z"),
                *("velocity_x", "velocity_y", "velocity_z"),
                *("angular_velocity_x", "angular_velocity_y", "angular_velocity_z"),
                *("motor_position", "motor_velocity"),
                *("torso_velocity_x", "torso_velocity_y", "torso_velocity_z"),
                "action",
            )
        ),
    ]
)
"""States of a dataset in SI units, as in `jbench.tasks.features.State`: `step` 0 to 1000, and the
action taken in the state, null in an episode's last. Too large to be a table of `jbench query`.
"""

DATASET_EPISODES = pa.schema(
    [
        _field("episode", pa.int32()),
        *(
            _field(f"{task}_target_{part}", pa.float64())
            for task in TASKS
            for part in ("x", "y", "yaw")
        ),
    ]
)
"""Episodes of a dataset: the target of each task (m, m, rad)."""

PUBLISHED = pa.schema(
    [
        _field("figure", pa.string()),
        _field("task", pa.string()),
        _field("algo", pa.string()),
        _field("representation", pa.string()),
        _field("training_steps", pa.float64(), "control steps, centre of the window"),
        _field("quantile", pa.int64(), "percent"),
        _RETURN,
        _field("source", pa.string()),
    ]
)
"""The learning curves of the paper, read from its figures."""

TABLES = {
    "runs": RUNS,
    "episodes": EPISODES,
    "evaluations": EVALUATIONS,
    "encoders": ENCODERS,
    "encoder_epochs": ENCODER_EPOCHS,
    "encoder_features": ENCODER_FEATURES,
    "encoder_errors": ENCODER_ERRORS,
    "encoder_predictions": ENCODER_PREDICTIONS,
    "datasets": DATASETS,
    "policy_evaluations": POLICY_EVALUATIONS,
    "policy_episodes": POLICY_EPISODES,
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
