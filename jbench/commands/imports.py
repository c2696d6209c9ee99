"""The import command."""

from pathlib import Path

from typer import Argument, Option

from jbench import names
from jbench.commands import options, parsing
from jbench.commands.output import Output
from jbench.wording import with_results


def import_(
    files: list[Path] = Argument(
        ..., parser=options.path, metavar="FILE", help="Files with learning curves."
    ),
    format: names.ImportFormat = Option(
        ..., "--from", help=f"Format of the files: {', '.join(names.IMPORT_FORMATS)}."
    ),
    task: str = options.REQUIRED_TASK,
    algo: str = Option(..., help="Label of the algorithm, such as cleanrl-td3."),
    seed_from: str | None = Option(
        None,
        metavar="REGEX",
        help="Regular expression that finds the seed in a file's path, or in the name of a run of "
        "W&B; its first group, or the whole match.",
    ),
    representation: str = Option(
        names.FULL, help="Label of what the agent observes: full, or one such as dae12."
    ),
    steps_column: str | None = Option(
        None,
        help="csv: column with the control steps (default: control_steps, global_step, timesteps, "
        "steps or step; wandb-csv: the first column).",
    ),
    return_column: str | None = Option(
        None,
        help="csv: column with the returns (default: episode_return, episodic_return, return or "
        "reward); wandb-csv: the metric.",
    ),
    seed_column: str | None = Option(
        None, help="csv: column with the seed, instead of --seed-from (default: seed)."
    ),
    tag: str | None = Option(
        None,
        help="tensorboard: tag with the returns (default: charts/episodic_return or "
        "rollout/ep_rew_mean).",
    ),
    returns: names.ReturnsName | None = Option(
        None,
        help="Kind of the returns: training or evaluation (default: evaluation if the column or "
        "tag begins with eval, else training).",
    ),
    results: Path = options.RESULTS,
    json: bool = options.JSON,
) -> None:
    """Import learning curves made by other programs.

    The report compares them with runs.
    """
    from jbench.importing.importer import import_curves
    from jbench.importing.request import ImportRequest
    from jbench.simulation import find_task

    output, database = Output(json), parsing.results_to_write(results)
    request = ImportRequest(
        format=format,
        task=find_task(task).name,
        algo=algo,
        seed_from=seed_from,
        representation=representation,
        tag=tag,
        steps_column=steps_column,
        return_column=return_column,
        seed_column=seed_column,
        returns=returns,
    )
    imported = import_curves(database, files, request)
    for curve in imported:
        output.say(
            f"{curve.id}: {curve.points:,} points, {curve.control_steps:,} control steps"
            + ("" if curve.is_new else "; imported before, nothing is changed")
        )
    new = sum(curve.is_new for curve in imported)
    output.say(
        f"Imported {new:,} of {len(imported):,} curves into {results}; they are not verified. "
        f"Next: {with_results('jbench report', results)}"
    )
    output.document({"imports": [curve._asdict() for curve in imported]})
