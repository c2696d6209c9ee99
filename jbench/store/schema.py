"""The tables of the database, as Arrow schemas. Units are in the fields' metadata."""

import pyarrow as pa


def _field(name: str, kind: pa.DataType, unit: str = "") -> pa.Field:
    return pa.field(name, kind, metadata={"unit": unit} if unit else None)


_RUN = _field("run", pa.string())
_WALL_TIME = _field("wall_time", pa.float64(), "s since the run began")
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
)
"""Columns of `episodes` that hold the last losses before an episode's end, null before any."""

EPISODES = pa.schema(
    [
        _RUN,
        _field("episode", pa.int32()),
        _CONTROL_STEPS,
        _RETURN,
        _LENGTH,
        _WALL_TIME,
        *(_field(name, pa.float64()) for name in LOSSES),
    ]
)
"""Training episodes of a run, in the order of their ends."""

EVALUATIONS = pa.schema(
    [
        _RUN,
        _field("evaluation", pa.int32()),
        _CONTROL_STEPS,
        _field("episode", pa.int32()),
        _RETURN,
        _LENGTH,
        _WALL_TIME,
    ]
)
"""Episodes of the deterministic policy, `episode` counting within each `evaluation`."""

ENCODER_EPOCHS = pa.schema(
    [
        _field("encoder", pa.string()),
        _field("epoch", pa.int32()),
        _field("train_mse", pa.float64(), "scaled features squared; corrupted input"),
        _field("test_mse", pa.float64(), "scaled features squared; clean input"),
        _field("test_denoising_mse", pa.float64(), "scaled features squared; corrupted input"),
        _WALL_TIME,
    ]
)
"""Errors of an autoencoder after each epoch of its training."""

ENCODER_FEATURES = pa.schema(
    [
        _field("encoder", pa.string()),
        _field("index", pa.int32()),
        _field("feature", pa.string()),
        _field("test_mse", pa.float64(), "scaled feature squared; clean input"),
        _field("test_variance", pa.float64(), "scaled feature squared"),
    ]
)
"""Error of a finished autoencoder on each feature of held-out episodes."""

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
        _field("created", pa.string(), "UTC"),
        _field("updated", pa.string(), "UTC"),
        _field("settings", pa.string(), "JSON"),
        _field("provenance", pa.string(), "JSON"),
    ]
)
"""One row for each run, from its manifest."""

ENCODERS = pa.schema(
    [
        _field("encoder", pa.string()),
        _field("task", pa.string()),
        _field("representation", pa.string()),
        _field("latents", pa.int64()),
        _field("seed", pa.int64()),
        _field("dataset", pa.string()),
        _field("status", pa.string()),
        _field("test_mse", pa.float64(), "scaled features squared; clean input"),
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
"""States of an evaluated policy; not a table of `jbench query`, being large."""

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
