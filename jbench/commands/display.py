"""Tables of encoders, of runs and of a report, and warnings of runs that are too short."""

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

from jbench.commands.output import Output
from jbench.errors import WorkError
from jbench.names import EPISODE_STEPS
from jbench.returns import final_return
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.listing import evaluation_return
from jbench.wording import counted

FINAL_RETURNS = (
    "Final returns. Quote the evaluation return: the mean over the last evaluation, in which the "
    "policy is\ndeterministic. The training return, exploration included, is the mean over the "
    "last quarter of the\nepisodes, at most 100."
)


def described(record: Record, **more: Any) -> dict[str, Any]:
    """Returns the entry of a record in a command's JSON document."""
    return {
        "id": record.id,
        "path": str(record.path),
        "settings": record.settings,
        "summary": record.manifest.summary,
        **more,
    }


_ENCODER_TABLES = {
    "encoder_errors": "Errors on held-out episodes and on those of the hand-written policy",
    "encoder_predictions": "R² of the next control step, and effective rank of the latents",
    "encoder_epochs": "Mean squared error by epoch (scaled features)",
    "encoder_features": "Mean squared error of each scaled feature on held-out episodes and on "
    "those of the hand-written policy",
}
"""Titles of the tables of an encoder's errors; those of several encoders have only the first."""


def show_encoders(records: Sequence[Record], output: Output, *, verbose: bool) -> None:
    """Prints what encoders explain and predict: a sentence on a single one, a table of several.

    Args:
        verbose: whether to print their errors as tables first.
    """
    if verbose:
        _show_errors(records, output)
    rows = [_encoder_row(record) for record in records]
    if len(records) > 1:
        title = "Variance explained and R² of the next control step, on held-out episodes"
        output.table(title, list(rows[0]), [list(row.values()) for row in rows])
        return
    (row,), latents = rows, records[0].settings["latents"]
    predicted = ", ".join(f"{target} {r2}" for target, r2 in list(row.items())[3:] if r2)
    output.say(
        f"On held-out episodes it explains {row['explained']} of the variance (PCA with "
        f"{counted(latents, 'latent')}: {row['PCA']})"
        + (f" and predicts the next control step with R² {predicted}." if predicted else ".")
    )


def _encoder_row(record: Record) -> dict[str, str]:
    """Returns the cells of an encoder by column."""
    (errors,) = record.read("encoder_errors").to_pylist()
    # Encoders trained before this table existed have no rows.
    predictions = record.read("encoder_predictions").to_pylist()
    return {
        "encoder": record.id,
        "explained": f"{errors['test_explained']:.3f}",
        "PCA": f"{errors['pca_explained']:.3f}",
        **{
            row["target"].replace("_", " "): "" if row["r2"] is None else f"{row['r2']:.3f}"
            for row in predictions
        },
    }


def _show_errors(records: Sequence[Record], output: Output) -> None:
    """Prints the tables of the errors of encoders, of eight epochs at most."""
    import pandas as pd

    for name in [*_ENCODER_TABLES][: 4 if len(records) == 1 else 1]:
        frame = pd.concat(record.read(name).to_pandas() for record in records)
        if name == "encoder_epochs":
            frame = frame.iloc[:: -max(1, len(frame) // 8)][::-1]
        if len(records) == 1:
            frame = frame.drop(columns=["encoder", "index"], errors="ignore")
            if name == "encoder_errors":
                frame = frame.T.reset_index(names="error").rename(columns={0: "value"})
        if len(frame):
            output.frame(_ENCODER_TABLES[name], frame)
    for record in records:
        values = record.manifest.summary.get("singular_values")
        if values is not None:  # of an encoder with linear dynamics
            shown = ", ".join(f"{value:.3f}" for value in values)
            output.say(f"{record.id}: singular values of the dynamics {shown}.")


def show_runs(runs: Sequence[RunSettings], results: Results, output: Output) -> None:
    """Prints the final returns of each run in the results."""
    rows = []
    for run in runs:
        try:
            record = results.find("run", run.id)
            if record is not None:
                rows.append(_run_row(record))
        except WorkError as error:
            output.warn(str(error))
    output.table(FINAL_RETURNS, ("run", "episodes", "training return", "evaluation return"), rows)


def _run_row(record: Record) -> tuple[object, ...]:
    returns = record.read("episodes")["episode_return"].to_numpy()
    finals = final_return(returns), evaluation_return(record)
    means = ("" if mean is None else f"{mean:.0f}" for mean in finals)
    name = record.id if record.status == "finished" else f"{record.id} ({record.status})"
    return name, len(returns), *means


def warn_of_short_runs(runs: Sequence[RunSettings], output: Output) -> None:
    """Warns of unexpected numbers of control steps of runs, one of each configuration."""
    for sentence in dict.fromkeys(chain.from_iterable(map(_short_steps, runs))):
        output.warn(sentence)


def _short_steps(run: RunSettings) -> Iterator[str]:
    """Yields what a user may not expect of the number of control steps of a run."""
    from jbench.settings.algorithms import OffPolicySettings

    if not run.is_ours:
        return
    end, episode = run.last_step, EPISODE_STEPS * run.environments
    if run.steps % EPISODE_STEPS:
        middle = f"in the middle of an episode of {EPISODE_STEPS:,}, whose return is not recorded"
        where = middle if end % episode else f"at the end of an episode of {EPISODE_STEPS:,}"
        yield f"a run of {run.steps:,} control steps ends after {end:,}, {where}."
    algorithm = run.algorithm
    if isinstance(algorithm, OffPolicySettings) and end < algorithm.first_update:
        yield (
            f"{run.algo} first updates its networks after {algorithm.first_update:,} control "
            f"steps, so a run of {run.steps:,} learns nothing; raise --steps, or lower that number "
            "with --set learning_starts=N and --set train_freq=N (in a matrix file, the same keys "
            f"of [hyperparameters.{run.algo}])."
        )
