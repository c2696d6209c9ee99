"""Commands for datasets: collect, datasets."""

from typing import TYPE_CHECKING, Annotated

import typer

from jbench.commands import parsing
from jbench.commands.options import (
    RESULTS,
    AugmentOption,
    JsonOption,
    ReadResultsOption,
    ResultsOption,
    ThreadsOption,
    complete_tasks,
)
from jbench.commands.output import Output
from jbench.errors import WorkError
from jbench.names import is_reference
from jbench.wording import are, counted, done_of, with_results

if TYPE_CHECKING:
    from jbench.datasets.listing import Listed


def collect(
    steps: Annotated[
        str, typer.Option(help="Number of control steps, a multiple of 1000.")
    ] = "5e6",
    seed: Annotated[int, typer.Option(help="Random seed.")] = 0,
    threads: ThreadsOption = 0,
    augment: AugmentOption = None,
    task: Annotated[
        str | None,
        typer.Option(
            help="Task of another robot (default: the Jitterbug, for its five tasks).",
            autocompletion=complete_tasks,
        ),
    ] = None,
    results: ResultsOption = RESULTS,
    json: JsonOption = False,
) -> None:
    """Collect a dataset of random actions, of the Jitterbug or another robot."""
    from jbench.commands import display
    from jbench.datasets import collect as collect_dataset
    from jbench.settings.base import validated
    from jbench.settings.records import DatasetSettings
    from jbench.simulation.find import checked_task, dataset_robot, find_task

    output, database = Output(json), parsing.results_to_write(results)
    robot = {} if task is None else dataset_robot(find_task(task))
    settings = validated(
        DatasetSettings,
        "the dataset",
        **robot,
        steps=parsing.count("--steps", steps),
        seed=parsing.seed(seed),
        augment=parsing.augmented(augment),
    )
    before = database.find("dataset", settings.id)
    if before is None and robot:
        checked_task(settings.robot)
    elif before is not None and before.status == "finished":
        output.say(f"The dataset {settings.id} is already finished; nothing to do.")
    with output.progress("collect", settings.steps, "control steps") as progress:
        record = collect_dataset(settings, database, parsing.all_cores(threads), progress)
    option, tasks = (f" --task {task}", "") if robot else ("", ", for all five tasks")
    output.say(
        f"Dataset {record.id}: {settings.steps:,} control steps, {record.size / 1e6:.1f} MB, in "
        f"{record.path}{tasks}. Next: {with_results(f'jbench train-dae{option}', results)}"
    )
    output.document(display.described(record, bytes=record.size))


def datasets(results: ReadResultsOption = RESULTS, json: JsonOption = False) -> None:
    """List datasets."""
    from jbench.commands import display
    from jbench.datasets.listing import list_datasets

    output = Output(json)
    listed, problems = list_datasets(parsing.existing_results(results))
    if listed or problems:
        header = ("dataset", "status", "steps", "robot", "MB", "last written (UTC)")
        output.table(
            f"{counted(len(listed), 'dataset')} in {results}",
            header,
            [_row(each) for each in listed],
        )
    else:
        to_write = RESULTS if is_reference(results) else results
        small = with_results("jbench collect --steps 100000", to_write)
        output.say(f"No datasets in {results}; {small} makes a small one.")
    described = [
        display.described(
            each.record, status=each.record.status, steps=each.steps, bytes=each.record.size
        )
        for each in listed
    ]
    output.document({"datasets": described, "problems": problems})
    for problem in problems:
        output.warn(problem)
    if problems:
        count = f"{counted(len(problems), 'dataset')} {are(len(problems))}"
        raise WorkError(f"{count} unreadable and left out; see above.")


def _row(listed: "Listed") -> tuple[str, ...]:
    augment, robot = listed.settings.augment, listed.settings.robot
    plain = "plain" if listed.settings.specs is None else robot
    return (
        listed.record.id,
        listed.record.status,
        done_of(listed.steps, listed.settings.steps),
        plain if augment is None else f"--augment {augment}",
        f"{listed.record.size / 1e6:.1f}",
        listed.record.manifest.updated[:16].replace("T", " "),
    )
