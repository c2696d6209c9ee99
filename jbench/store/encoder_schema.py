"""The tables of encoders, as Arrow schemas. Units are in the fields' metadata."""

import pyarrow as pa


def field(name: str, kind: pa.DataType, unit: str = "") -> pa.Field:
    """Returns a column with its unit in its metadata."""
    return pa.field(name, kind, metadata={"unit": unit} if unit else None)


ENCODER_EPOCHS = pa.schema(
    [
        field("encoder", pa.string()),
        field("epoch", pa.int32()),
        field("train_loss", pa.float64(), "what its kind minimizes; dae: as test_denoising_mse"),
        field("test_mse", pa.float64(), "scaled features squared; clean input"),
        field("test_denoising_mse", pa.float64(), "scaled features squared; corrupted input"),
        field("wall_time", pa.float64(), "s of training"),
    ]
)
"""Errors of an encoder after each epoch on up to 128 held-out episodes; empty for closed forms.

`test_denoising_mse` is null for kinds that do not corrupt their input.
"""

_ERRORS = tuple(
    field(name, pa.float64(), "scaled features squared")
    for name in (
        *("test_mse", "test_variance", "pca_mse", "random_mse"),
        *("heuristic_mse", "heuristic_variance", "pca_heuristic_mse", "random_heuristic_mse"),
    )
)

ENCODER_FEATURES = pa.schema(
    [
        field("encoder", pa.string()),
        field("index", pa.int32()),
        field("feature", pa.string()),
        *_ERRORS,
    ]
)
"""Error of a finished encoder on each feature: `test` on the held-out episodes, `heuristic` on ten
episodes of the task's hand-written policy. `pca` and `random` are PCA and a random projection of
the same size, fitted to the same states. A variance is that of the target states.
"""

ENCODER_ERRORS = pa.schema(
    [
        field("encoder", pa.string()),
        field("test_states", pa.int64()),
        field("heuristic_states", pa.int64()),
        *_ERRORS,
        *(
            field(f"{which}_explained", pa.float64(), "fraction of the variance")
            for which in ("test", "pca", "random", "heuristic", "pca_heuristic", "random_heuristic")
        ),
    ]
)
"""Error of a finished encoder over all features: the means of the columns of `encoder_features`,
and 1 - error / variance. `ddae` is compared with the future state, PCA with the present one.
"""

ENCODER_PREDICTIONS = pa.schema(
    [
        field("encoder", pa.string()),
        field("target", pa.string()),
        field("r2", pa.float64(), "fraction of the variance"),
        field("linear_r2", pa.float64(), "fraction of the variance; of a linear regression"),
        field("amplitude", pa.float64(), "of the latents; null if linear_r2 is below 0.5"),
        field("effective_rank", pa.float64(), "of the latents, the same for every target"),
        field("learned_rows", pa.int64()),
        field("test_rows", pa.int64()),
    ]
)
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
"""The tables of an encoder's files by name."""
