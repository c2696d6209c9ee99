"""Tables of encoders, of runs and of a report, and warnings of runs that are too short."""

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

from jbench.commands.output import Output
from jbench.errors import WorkError
from jbench.names import EPISODE_STEPS
from jbench.returns import final_return
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.listing import evaluation_return
from jbench.wording import counted

if TYPE_CHECKING:
    from jbench.report.table import Table


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


def show_table(table: "Table", output: Output) -> None:
    """Prints a table of a report."""
    texts = table.texts()
    rows = list(texts.itertuples(index=False, name=None))
    output.table(table.title, [str(name) for name in texts], rows)


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
    """Prints the errors of encoders; those of a single one by epoch and feature."""
    if len(records) == 1:
        _show_encoder(records[0], output)
    rows = []
    for record in records:
        (errors,) = record.read("encoder_errors").to_pylist()
        predictions = record.read("encoder_predictions").to_pylist()
        explained = ("random", "heuristic", "pca_heuristic")
        rows.append(
            (
                record.id,
                f"{errors['test_mse']:.5f}",
                *(f"{errors[f'{which}_explained']:.3f}" for which in explained),
                f"{predictions[0]['effective_rank']:.1f}" if predictions else "",
            )
        )
        _show_singular_values(record, output)
    header = ("encoder", "error", "random directions", "on the heuristic", "PCA", "effective rank")
    output.table(
        "Error on held-out episodes; variance that random directions explain there; variance "
        "explained on episodes of the hand-written policy; effective rank of the latents",
        header,
        rows,
    )


def _show_singular_values(record: Record, output: Output) -> None:
    """Prints the singular values of an encoder's dynamics, if it has any."""
    values = record.manifest.summary.get("singular_values")
    if values is not None:
        above = ", ".join(f"{sum(v > least for v in values)} above {least}" for least in (0.9, 0.5))
        output.say(
            f"{record.id}: singular values of the dynamics {', '.join(f'{v:.3f}' for v in values)} "
            f"({above})."
        )


def _show_encoder(record: Record, output: Output) -> None:
    """Prints the errors of a trained encoder by epoch, and the final errors by feature."""
    epochs = record.read("encoder_epochs").to_pylist()
    losses = ("train_loss", "test_mse", "test_denoising_mse")
    shown = sorted({*range(0, len(epochs), max(1, len(epochs) // 8)), len(epochs) - 1})
    if epochs:
        output.table(
            f"{record.id}: mean squared error by epoch (scaled features)",
            ("epoch", "training loss", "test, clean", "test, corrupted"),
            [
                (e["epoch"], *("" if e[name] is None else f"{e[name]:.5f}" for name in losses))
                for e in (epochs[i] for i in shown)
            ],
        )
    output.table(
        "Mean squared error of each scaled feature on held-out episodes, and (last two columns) on "
        "episodes of the hand-written policy",
        ("feature", "error", "PCA", "variance", "explained", "error", "PCA"),
        [
            (
                row["feature"],
                f"{row['test_mse']:.5f}",
                f"{row['pca_mse']:.5f}",
                f"{row['test_variance']:.5f}",
                f"{1 - row['test_mse'] / max(row['test_variance'], 1e-12):.3f}",
                f"{row['heuristic_mse']:.5f}",
                f"{row['pca_heuristic_mse']:.5f}",
            )
            for row in record.read("encoder_features").to_pylist()
        ],
    )


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
