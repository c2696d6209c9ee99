"""Options that several commands share."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from jbench import names


def complete(*known: str) -> Callable[[str], list[str]]:
    """Returns a shell completion that offers the names with the typed prefix."""
    return lambda incomplete: [name for name in known if name.startswith(incomplete)]


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
    ),
]
JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Print one JSON document to stdout, everything else to stderr."),
]
TaskOption = Annotated[
    str,
    typer.Option(help=f"Task: {', '.join(names.TASKS)}.", autocompletion=complete(*names.TASKS)),
]
PolicyTaskOption = Annotated[
    str | None,
    typer.Option(
        help="Task (default: the task of a trained policy; of other policies, evaluate takes "
        "face_direction, render and view move_to_pose).",
        autocompletion=complete(*names.TASKS),
    ),
]
OneTaskOption = Annotated[
    str | None, typer.Option(help="Only this task.", autocompletion=complete(*names.TASKS))
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
    str | None, typer.Option(help="Only these seeds, such as 0-9 or 0,2,5-7.")
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
DatasetOption = Annotated[str | None, typer.Option(help="Id of the dataset (default: the newest).")]
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
PolicyOption = Annotated[
    str,
    typer.Option(
        help=f"Policy: {names.POLICY_NAMES}.",
        autocompletion=complete(names.HEURISTIC, "random", "constant:1"),
    ),
]
CameraOption = Annotated[
    str,
    typer.Option(
        help=f"Camera: {', '.join(names.CAMERAS)}.", autocompletion=complete(*names.CAMERAS)
    ),
]
AugmentOption = Annotated[
    int | None, typer.Option(help="Seed of an augmented robot (default: the plain robot).")
]
