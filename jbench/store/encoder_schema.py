"""The tables of encoders, as Arrow schemas. Units are in the fields' metadata."""

import pyarrow as pa


def columns(text: str) -> pa.Schema:
    """Returns the schema that a text describes: `names: type, unit` in each line."""
    fields = []
    for line in text.strip().splitlines():
        names, _, described = line.strip().partition(": ")
        kind, _, unit = described.partition(", ")
        metadata = {"unit": unit} if unit else None
        fields += [pa.field(n, pa.type_for_alias(kind), metadata=metadata) for n in names.split()]
    return pa.schema(fields)


ENCODER_EPOCHS = columns("""
    encoder: string
    epoch: int32
    train_loss: float64, what its kind minimizes; dae: as test_denoising_mse
    test_mse: float64, scaled features squared; clean input
    test_denoising_mse: float64, scaled features squared; corrupted input
    wall_time: float64, s of training
""")
"""Errors of an encoder after each epoch on up to 128 held-out episodes; empty for closed forms.

`test_denoising_mse` is null for kinds that do not corrupt their input.
"""

_ERRORS = """test_mse test_variance pca_mse random_mse: float64, scaled features squared
    heuristic_mse heuristic_variance: float64, scaled features squared
    pca_heuristic_mse random_heuristic_mse: float64, scaled features squared"""

ENCODER_FEATURES = columns(f"""
    encoder: string
    index: int32
    feature: string
    {_ERRORS}
""")
"""Error of a finished encoder on each feature: `test` on the held-out episodes, `heuristic` on ten
episodes of the task's hand-written policy. `pca` and `random` are PCA and a random projection of
the same size, fitted to the same states. A variance is that of the target states.
"""

ENCODER_ERRORS = columns(f"""
    encoder: string
    test_states heuristic_states: int64
    {_ERRORS}
    test_explained pca_explained random_explained: float64, fraction of the variance
    heuristic_explained pca_heuristic_explained: float64, fraction of the variance
    random_heuristic_explained: float64, fraction of the variance
""")
"""Error of a finished encoder over all features: the means of the columns of `encoder_features`,
and 1 - error / variance. `ddae` is compared with the future state, PCA with the present one.
"""

ENCODER_PREDICTIONS = columns("""
    encoder target: string
    r2: float64, fraction of the variance
    linear_r2: float64, fraction of the variance; of a linear regression
    amplitude: float64, of the latents; null if linear_r2 is below 0.5
    effective_rank: float64, of the latents, the same for every target
    learned_rows test_rows: int64
""")
"""How well an encoder's latents and the action predict the next control step.

`r2` of a small network with fixed settings on held-out episodes, with a row per `target`:
`yaw_rate`, `tilt_rate`, `forward_speed` and `reward`. It is null for a constant target.
`amplitude` is the standard deviation of the latents along the direction in which a linear
regression predicts the target. Encoders that were trained before this table existed have no rows,
and those before version 5 have neither `linear_r2` nor `amplitude`.
"""

ENCODER_TABLES = {
    "encoder_epochs": ENCODER_EPOCHS,
    "encoder_features": ENCODER_FEATURES,
    "encoder_errors": ENCODER_ERRORS,
    "encoder_predictions": ENCODER_PREDICTIONS,
}
