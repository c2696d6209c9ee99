"""The tables of the database, as Arrow schemas. Units are in the fields' metadata.

`docs/database.md` and, for encoders, `docs/encoders.md` describe the rows.
"""

import re

import pyarrow as pa

from jbench.names import TASKS


def columns(text: str) -> pa.Schema:
    """Returns the schema that a text describes: `names: type, unit` in each line or `|` part."""
    fields = []
    for part in re.split(r"\n| \| ", text.strip()):
        names, _, described = part.strip().partition(": ")
        kind, _, unit = described.partition(", ")
        metadata = {"unit": unit} if unit else None
        fields += [pa.field(n, pa.type_for_alias(kind), metadata=metadata) for n in names.split()]
    return pa.schema(fields)


_CELL = "task algo representation: string"
_CONTROL_STEPS = "control_steps: int64, control steps of the run, all environments"
_RETURN = "episode_return: float64, sum of rewards"
_LENGTH = "length: int32, control steps"
_TIMES = """wall_time: float64, s since the run began
    processor_time: float64, s of processor time since the run began"""
_MANIFEST = """created updated: string, UTC
    settings provenance: string, JSON"""

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

EPISODES = columns(f"""
    run: string | episode: int32 | {_CONTROL_STEPS}
    {_RETURN} | {_LENGTH}
    {_TIMES}
    {" ".join(LOSSES)}: float64
""")
"""Training episodes of a run, ordered by their ends."""

EVALUATIONS = columns(f"""
    run: string | evaluation: int32 | {_CONTROL_STEPS}
    episode: int32 | {_RETURN} | {_LENGTH}
    {_TIMES}
""")

PATHS = columns(f"""
    run: string | evaluation: int32 | {_CONTROL_STEPS}
    time: float32, s since the episode began
    x y target_x target_y: float32, m
    heading target_yaw: float32, rad
""")

METRICS = columns(f"""
    run: string | {_CONTROL_STEPS}
    name: string | value: float64
    wall_time: float64, s since the run began
""")

LOG_TABLES = {"episodes": EPISODES, "evaluations": EVALUATIONS, "metrics": METRICS}
"""Tables to which a run in progress adds rows."""

RUN_TABLES = {**LOG_TABLES, "paths": PATHS}

_ERRORS = """test_mse test_variance pca_mse random_mse: float64, scaled features squared
    heuristic_mse heuristic_variance: float64, scaled features squared
    pca_heuristic_mse random_heuristic_mse: float64, scaled features squared"""

KEPT = "kept"  # a column that is computed when rows are read

_FEATURES = f"""encoder: string | index: int32 | feature: string
    {_ERRORS}"""

ENCODER_TABLES = {
    # On up to 128 held-out episodes. Kinds that do not corrupt their input have no
    # `test_denoising_mse`.
    "encoder_epochs": columns("""
        encoder: string | epoch: int32
        train_loss: float64, what its kind minimizes; dae: as test_denoising_mse
        test_mse: float64, scaled features squared; clean input
        test_denoising_mse: float64, scaled features squared; corrupted input
        wall_time: float64, s of training
    """),
    # `heuristic`: on ten episodes of the task's hand-written policy. A variance is that of the
    # target states.
    "encoder_features": columns(_FEATURES),
    # Means of the columns of `encoder_features`.
    "encoder_errors": columns(f"""
        encoder: string | test_states heuristic_states: int64
        {_ERRORS}
        test_explained pca_explained random_explained: float64, fraction of the variance
        heuristic_explained pca_heuristic_explained: float64, fraction of the variance
        random_heuristic_explained: float64, fraction of the variance
    """),
    # A row per `target`: `yaw_rate`, `tilt_rate`, `forward_speed` and `reward`. `r2` is null for a
    # constant target; encoders of before version 5 have neither `linear_r2` nor `amplitude`.
    "encoder_predictions": columns("""
        encoder target: string
        r2: float64, fraction of the variance
        linear_r2: float64, fraction of the variance; of a linear regression
        amplitude: float64, of the latents; null if linear_r2 is below 0.5
        effective_rank: float64, of the latents, the same for every target
        learned_rows test_rows: int64
    """),
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

STEPS = columns(f"""
    episode: int32 | step: int16
    {" ".join(name for names in STATE_COLUMNS.values() for name in names)} action: float32
""")
"""`step` counts from 0 to 1000; the action is null in an episode's last state."""

DATASET_EPISODES = columns(f"""
    episode: int32
    {" ".join(f"{task}_target_{part}" for task in TASKS for part in ("x", "y", "yaw"))}: float64
""")
"""The target of each task (m, m, rad)."""

TABLES = {
    "runs": columns(f"""
        run: string | {_CELL}
        encoder: string | seed: int64 | steps: int64, control steps asked for
        engine time_limit: string | variant: string, hash of the settings but seed and steps
        status: string | episodes: int64
        wall_time processor_time: float64, s
        diverged: string, JSON; null unless the run diverged
        error: string, why a run failed
        {_MANIFEST}
    """),
    # Of a run that diverged they are its `returns.diverged_return`.
    "final_returns": columns("""
        run: string | seed: int64
        evaluation_return training_return: float64, sum of rewards; null if there is none
        evaluation_return_at_end: float64, without the episodes that jbench evaluate added
        wall_time: float64, s
        error: string, why a run failed
    """),
    **RUN_TABLES,
    "encoders": columns(f"""
        encoder task kind representation: string | latents seed: int64 | dataset status: string
        test_mse: float64, scaled features squared; clean input
        test_explained: float64, fraction of the variance
        effective_rank: float64, of the latents on held-out episodes
        wall_time: float64, s
        {_MANIFEST}
    """),
    **ENCODER_TABLES,
    "encoder_features": columns(f"""
        {_FEATURES}
        {KEPT}: float64, fraction of the feature's direction; null for more than one layer
    """),
    "datasets": columns(f"""
        dataset: string | seed: int64
        steps: int64, control steps asked for | steps_done: int64, control steps
        status: string | bytes: int64, bytes on disk
        {_MANIFEST}
    """),
    "policy_evaluations": columns(f"""
        evaluation task policy: string | seed episodes: int64 | status: string
        median q10 q90: float64, sum of rewards
        {_MANIFEST}
    """),
    "policy_episodes": columns(f"""
        evaluation: string | episode: int32 | {_RETURN} | {_LENGTH}
        target_x target_y: float64, m | target_yaw: float64, rad
    """),
    "imports": columns(f"""
        import: string | {_CELL} | seed: int64
        format: string | returns: string, training or evaluation
        points: int64 | control_steps: int64, control steps of the last point
        files: string, JSON: names by SHA-256 | status: string
        {_MANIFEST}
    """),
    # A point is a training episode, an evaluation, or a value of a TensorBoard tag or a CSV column.
    "import_points": columns(f"""
        import: string | point: int32
        control_steps: int64, control steps before the point, all environments
        episode: int32 | {_RETURN} | {_LENGTH}
        wall_time: float64, s since the first point; null if unknown
    """),
    "published": columns(f"""
        figure: string | {_CELL}
        control_steps: float64, control steps, center of the window
        quantile: int64, percent | {_RETURN} | source: string
    """),
}
"""The tables of `jbench query`."""

FILES = {
    **TABLES,
    **ENCODER_TABLES,
    "policy_states": columns("""
        episode: int32 | step: int16, control steps; the state after it
        x y z: float32, m | heading: float32, rad | upright: float32, reward
        motor_position: float32, rad | motor_velocity: float32, rad/s
        action reward: float32
    """),
    "steps": STEPS,
    "dataset_episodes": DATASET_EPISODES,
}
"""All tables, including those too large for `jbench query`."""
