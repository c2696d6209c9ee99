"""The command collect: a dataset of random actions."""

from functools import partial
from pathlib import Path
from typing import Any

from jbench.commands import options, output, parsing
from jbench.commands.stopped import stopped_collection
from jbench.settings.records import DatasetSettings, dataset_robot
from jbench.wording import with_results


@options.with_settings(DatasetSettings, "steps", "seed", "augment")
def collect(
    task: str | None = options.some_task(
        None, help="Task of another robot (default: the Jitterbug, for its five tasks)."
    ),
    threads: int = options.THREADS,
    results: Path = options.RESULTS,
    json: bool = options.JSON,
    **chosen: Any,
) -> None:
    """Collect a dataset of random actions, of the Jitterbug or another robot."""
    from jbench.datasets import collect as collect_dataset
    from jbench.datasets import plan_dataset
    from jbench.encoders.settings import autoencoder_options
    from jbench.settings.base import validated
    from jbench.store.planned import sentences
    from jbench.tasks.find import checked_task, find_task

    database = parsing.results_to_write(results)
    robot: dict[str, Any] = {}
    if task is not None:
        about = find_task(task)
        robot = dataset_robot(about.name, about.specs)
    settings = validated(DatasetSettings, "the dataset", **robot, **chosen)
    plan = plan_dataset(settings, database)
    settings = plan.settings
    before = database.find("dataset", settings.id)
    steps_to_show = settings.steps
    if before is None:
        for sentence in sentences(plan.changed):
            output.say(sentence)
        if robot:
            output.note_task(checked_task(settings.robot))
    elif before.is_finished:
        output.say(f"The dataset {settings.id} is already finished; nothing to do.")
        steps_to_show = 0

    output.if_stopped(partial(stopped_collection, settings, database))
    with output.progress("collect", steps_to_show, "control steps") as progress:
        record = collect_dataset(settings, database, threads, progress)

    use = ", for all five tasks"
    next_command = "jbench train-dae"
    if robot:
        use = ""
        next_command += autoencoder_options(settings.robot)

    output.say(
        f"Dataset {record.id}: {settings.steps:,} control steps, {record.size / 1e6:.1f} MB, in "
        f"{record.path}{use}. Next: {with_results(next_command, results)}"
    )
    output.document(output.described(record, bytes=record.size))
