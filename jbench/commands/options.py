"""Options that several commands share."""

import importlib.metadata
from collections.abc import Callable
from glob import escape, glob
from pathlib import Path
from typing import Annotated

import typer

from jbench import names


def complete(*known: str) -> Callable[[str], list[str]]:
    """Returns a shell completion that offers the names with the typed prefix."""
    return lambda incomplete: [name for name in known if name.startswith(incomplete)]


def complete_tasks(incomplete: str) -> list[str]:
    """Offers the Jitterbug's tasks, installed ones, and those of dm_control's suite."""
    points = importlib.metadata.entry_points(group=names.TASK_GROUP)
    return complete(*names.TASKS, *sorted(p.name for p in points), *names.SUITE_TASKS)(incomplete)


def complete_records(kind: str, *known: str) -> Callable[[typer.Context, str], list[str]]:
    """Returns a completion that offers the names, and the ids of records in --results."""

    def offer(context: typer.Context, incomplete: str) -> list[str]:
        ids = _ids(Path(context.params.get("results") or names.RESULTS), kind)
        return complete(*known, *ids)(incomplete)

    return offer


def complete_policies(context: typer.Context, incomplete: str) -> list[str]:
    """Offers hand-written policies, runs of --results, and shipped policies."""
    shipped = _ids(Path(names.REFERENCE), "run", "policy*.json")
    known = names.HEURISTIC, "random", "constant:1", *(f"{names.REFERENCE}/{id}" for id in shipped)
    return complete_records("run", *known)(context, incomplete)


def complete_encoders(context: typer.Context, incomplete: str) -> list[str]:
    """Offers the representations of the encoders in --results, and their ids after a slash."""
    ids = complete_records("encoder")(context, incomplete if "/" in incomplete else "")
    representations = sorted({id.split("/")[1] for id in ids if id.count("/") > 1})
    return ids if "/" in incomplete else complete("none", *representations)(incomplete)


def complete_results(incomplete: str) -> list[str]:
    """Offers the shipped results and directories."""
    directories = (name for name in glob(f"{escape(incomplete)}*") if Path(name).is_dir())
    return [*complete(names.REFERENCE)(incomplete), *sorted(directories)]


def complete_settings(context: typer.Context, incomplete: str) -> list[str]:
    """Offers the hyperparameters of the typed algorithm of jbench."""
    from jbench.settings.algorithms import SETTINGS

    settings = SETTINGS.get(context.params.get("algo") or "ddpg")
    return complete(*(f"{name}=" for name in getattr(settings, "model_fields", ())))(incomplete)


def _ids(results: Path, kind: str, file: str = "manifest.json") -> list[str]:
    """Returns the ids of records with such a file; results need not exist."""
    if names.is_reference(results):
        results = Path(__file__).parents[1] / names.REFERENCE
    root = results / f"{kind}s"
    return sorted(found.parent.relative_to(root).as_posix() for found in root.rglob(file))


def path(text: str | Path) -> Path:
    """Returns a path as typed; an empty one, as of an unset shell variable, is refused."""
    if not str(text):
        raise typer.BadParameter("it is empty; type . for the working directory")
    return Path(text)


RESULTS = Path(names.RESULTS)
"""Default of `--results`."""

ResultsOption = Annotated[Path, typer.Option("--results", parser=path, help="Results directory.")]
ReadResultsOption = Annotated[
    Path,
    typer.Option(
        "--results",
        parser=path,
        help=f"Results directory ({names.REFERENCE}: the results shipped with jbench).",
        autocompletion=complete_results,
    ),
]
JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Print one JSON document to stdout, everything else to stderr."),
]
DryRunOption = Annotated[
    bool,
    typer.Option(
        "--dry-run", help="Show the status of the runs and the time left, and train nothing."
    ),
]
TaskOption = Annotated[
    str,
    typer.Option(
        help=f"Task: {', '.join(names.TASKS)}, {names.SUITE}DOMAIN-TASK of dm_control's suite, one "
        "of another package (jbench tasks), or MODULE:NAME of a function that returns a "
        "dm_env.Environment.",
        autocompletion=complete_tasks,
    ),
]
PolicyTaskOption = Annotated[
    str | None,
    typer.Option(
        help="Task (default: the task of a trained policy; of other policies, evaluate takes "
        "face_direction, render and view move_to_pose).",
        autocompletion=complete_tasks,
    ),
]
OneTaskOption = Annotated[
    str | None, typer.Option(help="Only this task.", autocompletion=complete_tasks)
]
OneAlgorithmOption = Annotated[
    str | None,
    typer.Option(help="Only this algorithm.", autocompletion=complete(*names.ALGORITHMS)),
]
OneRepresentationOption = Annotated[
    str | None,
    typer.Option(help="Only this representation: full, or one such as dae12."),
]
OneStatusOption = Annotated[
    str | None,
    typer.Option(
        help=f"Only runs of this status: {', '.join(names.STATUSES)}.",
        autocompletion=complete(*names.STATUSES),
    ),
]
SomeSeedsOption = Annotated[
    str | None,
    typer.Option("--seeds", "--seed", help="Only these seeds, such as 0-9 or 0,2,5-7."),
]
KeepStateOption = Annotated[
    bool,
    typer.Option(
        "--keep-state",
        help="Keep the last checkpoint of finished runs, with the replay buffer, so that the same "
        "command with more --steps continues them.",
    ),
]
LogOption = Annotated[
    str | None,
    typer.Option(
        callback=lambda name: name and names.known("value of --log", name, names.LOGGERS),
        help=f"Also write the rows to an experiment tracker: {', '.join(names.LOGGERS)}.",
        autocompletion=complete(*names.LOGGERS),
    ),
]
DatasetOption = Annotated[
    str | None,
    typer.Option(
        help="Id of the dataset (default: the newest).", autocompletion=complete_records("dataset")
    ),
]
CsvOption = Annotated[bool, typer.Option("--csv", help="Print CSV to standard output.")]
ThreadsOption = Annotated[int, typer.Option(min=0, help="Number of threads (0: one per core).")]
JobsOption = Annotated[
    int,
    typer.Option(min=0, help="Number of worker processes (0: one per core, or one for a GPU)."),
]
FinalEpisodesOption = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Episodes of a run's last evaluation (default: 100, but not more than the run has "
        "training episodes).",
    ),
]
RetryOption = Annotated[bool, typer.Option("--retry-failed", help="Retry runs that failed before.")]
PolicyArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="POLICY",
        help=f"Policy: {names.POLICY_NAMES}.  [default: {names.HEURISTIC}]",
        autocompletion=complete_policies,
    ),
]
PolicyOption = Annotated[str | None, typer.Option("--policy", hidden=True)]
"""How POLICY was typed in older versions."""
CameraOption = Annotated[
    str | None,
    typer.Option(
        help=f"Camera: {', '.join(names.CAMERAS)} (default: tracking), or one of another robot's "
        "model (default: its first).",
        autocompletion=complete(*names.CAMERAS),
    ),
]
AugmentOption = Annotated[
    int | None, typer.Option(help="Seed of an augmented robot (default: the plain robot).")
]
