"""The tables of the database, as Arrow schemas. Units are in the fields' metadata."""

from jbench.names import TASKS
from jbench.store.encoder_schema import ENCODER_TABLES, columns

_CELL = "task algo representation: string"
_CONTROL_STEPS = "control_steps: int64, control steps of the run, all environments"
_RETURN = "episode_return: float64, sum of rewards"
_LENGTH = "length: int32, control steps"
_TIMES = """wall_time: float64, s since the run began
    processor_time: float64, s of processor time since the run began"""
_MANIFEST = """created updated: string, UTC
    settings provenance: string, JSON"""

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
    run: string
    episode: int32
    {_CONTROL_STEPS}
    {_RETURN}
    {_LENGTH}
    {_TIMES}
    {" ".join(LOSSES)}: float64
""")
"""Training episodes of a run, ordered by their ends.

`processor_time` of runs that are trained in one process is divided evenly among them.
"""

EVALUATIONS = columns(f"""
    run: string
    evaluation: int32
    {_CONTROL_STEPS}
    episode: int32
    {_RETURN}
    {_LENGTH}
    {_TIMES}
""")
"""Episodes of the deterministic policy, `episode` counting within each `evaluation`."""

PATHS = columns(f"""
    run: string
    evaluation: int32
    {_CONTROL_STEPS}
    time: float32, s since the episode began
    x y target_x target_y: float32, m
    heading target_yaw: float32, rad
""")
"""Where the robot was in the first episode of a run's first evaluation and of its latest one.

Numbers of the target are null if they are not random in the task.
"""

METRICS = columns(f"""
    run: string
    {_CONTROL_STEPS}
    name: string
    value: float64
    wall_time: float64, s since the run began
""")
"""What a training loop passed to `Recording.log`, a row for each value."""

EPISODE_TABLES = {"episodes": EPISODES, "evaluations": EVALUATIONS}

LOG_TABLES = {**EPISODE_TABLES, "metrics": METRICS}
"""Tables to which a run in progress adds rows."""

RUN_TABLES = {**LOG_TABLES, "paths": PATHS}

RUNS = columns(f"""
    run: string
    {_CELL}
    encoder: string
    seed: int64
    steps: int64, control steps asked for
    engine time_limit: string
    variant: string, hash of the settings but seed and steps
    status: string
    episodes: int64
    wall_time processor_time: float64, s
    diverged: string, JSON; null unless the run diverged
    {_MANIFEST}
""")

ENCODERS = columns(f"""
    encoder task kind representation: string
    latents seed: int64
    dataset status: string
    test_mse: float64, scaled features squared; clean input
    test_explained: float64, fraction of the variance
    effective_rank: float64, of the latents on held-out episodes
    wall_time: float64, s
    {_MANIFEST}
""")

DATASETS = columns(f"""
    dataset: string
    seed: int64
    steps: int64, control steps asked for
    steps_done: int64, control steps
    status: string
    bytes: int64, bytes on disk
    {_MANIFEST}
""")

POLICY_EVALUATIONS = columns(f"""
    evaluation task policy: string
    seed episodes: int64
    status: string
    median q10 q90: float64, sum of rewards
    {_MANIFEST}
""")

POLICY_EPISODES = columns(f"""
    evaluation: string
    episode: int32
    {_RETURN}
    {_LENGTH}
    target_x target_y: float64, m
    target_yaw: float64, rad
""")

POLICY_STATES = columns("""
    episode: int32
    step: int16, control steps; the state after it
    x y z: float32, m
    heading: float32, rad
    upright: float32, reward
    motor_position: float32, rad
    motor_velocity: float32, rad/s
    action reward: float32
""")
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
"""Columns of the fields of `jbench.tasks.geometry.State`, in SI units."""

STEPS = columns(f"""
    episode: int32
    step: int16
    {" ".join(name for names in STATE_COLUMNS.values() for name in names)}: float32
    action: float32
""")
"""States of a dataset: `step` 0 to 1000, and the action taken in the state, null in an episode's
last. Too large to be a table of `jbench query`.
"""

DATASET_EPISODES = columns(f"""
    episode: int32
    {" ".join(f"{task}_target_{part}" for task in TASKS for part in ("x", "y", "yaw"))}: float64
""")
"""Episodes of a dataset: the target of each task (m, m, rad)."""

IMPORTS = columns(f"""
    import: string
    {_CELL}
    seed: int64
    format: string
    returns: string, training or evaluation
    points: int64
    control_steps: int64, control steps of the last point
    files: string, JSON: names by SHA-256
    status: string
    {_MANIFEST}
""")

IMPORT_POINTS = columns(f"""
    import: string
    point: int32
    control_steps: int64, control steps before the point, all environments
    episode: int32
    {_RETURN}
    {_LENGTH}
    wall_time: float64, s since the first point; null if unknown
""")
"""Points of imported curves, `episode` counting within a point.

A point is a training episode, an evaluation, or a value of a TensorBoard tag or a CSV column.
"""

PUBLISHED = columns(f"""
    figure: string
    {_CELL}
    control_steps: float64, control steps, center of the window
    quantile: int64, percent
    {_RETURN}
    source: string
""")

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
