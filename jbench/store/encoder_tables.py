"""The tables of an encoder: its epochs, its errors, and what can be predicted from its latents.

`docs/encoders.md` describes the rows.
"""

from jbench.store.columns import float64, int32, int64, table, text

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

FEATURES = [text("encoder"), int32("index"), text("feature"), _ERRORS]

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
    "encoder_features": table(*FEATURES),
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
