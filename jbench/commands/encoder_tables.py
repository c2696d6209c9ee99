"""What train-encoder prints of encoders: their errors, and what they explain and predict."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from jbench.commands import output
from jbench.wording import counted

if TYPE_CHECKING:
    from jbench.store import Record

_EPOCHS = 20  # rows of a table, about

_ERRORS = {
    "encoder_errors": "Errors on held-out episodes and on those of the hand-written policy",
    "encoder_predictions": "R² of the next control step, and effective rank of the latents",
    "encoder_epochs": "Mean squared error by epoch (scaled features)",
    "encoder_features": "Mean squared error of each scaled feature on held-out episodes and on "
    "those of the hand-written policy",
}


def show_errors(record: "Record") -> None:
    """Prints what an encoder loses of each feature, and how it learned."""
    for name, title in _ERRORS.items():
        frame = record.read(name).to_pandas().drop(columns=["encoder", "index"], errors="ignore")
        if len(frame):
            some = frame.iloc[:: -max(1, len(frame) // _EPOCHS)][::-1]
            output.frame(f"{record.id}: {title}", some)

    values = record.manifest.summary.get("singular_values")
    if values is not None:  # of an encoder with linear dynamics
        shown = ", ".join(f"{value:.3f}" for value in values)
        output.say(f"{record.id}: singular values of the dynamics {shown}.")


def show_explained(records: Sequence["Record"]) -> None:
    """Prints what encoders explain and predict: a sentence on a single one, a table of several."""
    rows = []
    for record in records:
        (errors,) = record.read("encoder_errors").to_pylist()
        # Encoders trained before this table existed have no rows.
        predictions = record.read("encoder_predictions").to_pylist()
        rows.append(
            {
                "encoder": record.id,
                "explained": _share(errors["test_explained"]),
                "PCA": _share(errors["pca_explained"]),
                **{row["target"].replace("_", " "): _share(row["r2"]) for row in predictions},
            }
        )

    if len(records) > 1:
        import pandas as pd

        title = "Variance explained and R² of the next control step, on held-out episodes"
        output.frame(title, pd.DataFrame(rows))
        return

    (row,) = rows
    del row["encoder"]
    explained = row.pop("explained")
    pca = row.pop("PCA")
    latents = records[0].settings["latents"]
    sentence = (
        f"On held-out episodes it explains {explained} of the variance (PCA with "
        f"{counted(latents, 'latent')}: {pca})"
    )
    predicted = ", ".join(f"{target} {r2}" for target, r2 in row.items() if r2)
    if predicted:
        sentence += f" and predicts the next control step with R² {predicted}"

    output.say(f"{sentence}.")


def _share(share: float | None) -> str:
    """Returns a share of a variance as text; "" if it is unknown."""
    return "" if share is None else f"{share:.3f}"
