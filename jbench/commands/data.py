"""Commands for datasets: collect, datasets."""

from pathlib import Path
from typing import Any

from jbench import names
from jbench.commands import options, parsing
from jbench.commands.output import Output, described
from jbench.settings.records import DatasetSettings
from jbench.wording import counted, progress_text, with_results


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
    from jbench.settings.base import validated
    from jbench.simulation.find import checked_task, dataset_robot, find_task

    output, database = Output(json), parsing.results_to_write(results)
    robot = {} if task is None else dataset_robot(find_task(task))
    settings = validated(DatasetSettings, "the dataset", **robot, **chosen)
    before = database.find("dataset", settings.id)
    if before is None and robot:
        checked_task(settings.robot)
    elif before is not None and before.status == "finished":
        output.say(f"The dataset {settings.id} is already finished; nothing to do.")
    with output.progress("collect", settings.steps, "control steps") as progress:
        record = collect_dataset(settings, database, threads, progress)
    option, tasks = (f" --task {task}", "") if robot else ("", ", for all five tasks")
    output.say(
        f"Dataset {record.id}: {settings.steps:,} control steps, {record.size / 1e6:.1f} MB, in "
        f"{record.path}{tasks}. Next: {with_results(f'jbench train-dae{option}', results)}"
    )
    output.document(described(record, bytes=record.size))


def datasets(results: Path = options.READ_RESULTS, json: bool = options.JSON) -> None:
    """List datasets."""
    from jbench.datasets.reader import list_datasets

    output = Output(json)
    listed, problems = list_datasets(parsing.existing_results(results))
    rows, entries = [], []
    for dataset in listed:
        record, settings = dataset.record, dataset.settings
        steps = dataset.episodes * names.EPISODE_STEPS
        robot = "plain" if settings.specs is None else settings.robot
        row = {
            "dataset": record.id,
            "status": record.status,
            "steps": progress_text(steps, settings.steps),
            "robot": robot if settings.augment is None else f"--augment {settings.augment}",
            "MB": f"{record.size / 1e6:.1f}",
            "last written (UTC)": record.manifest.updated[:16].replace("T", " "),
        }
        rows.append(row)
        entries.append(described(record, status=record.status, steps=steps, bytes=record.size))
    if rows:
        title = f"{counted(len(rows), 'dataset')} in {results}"
        output.table(title, list(rows[0]), [list(row.values()) for row in rows])
    elif not problems:
        to_write = Path(names.RESULTS) if names.is_reference(results) else results
        small = with_results("jbench collect --steps 100000", to_write)
        output.say(f"No datasets in {results}; {small} makes a small one.")
    output.document({"datasets": entries, "problems": problems})
    output.warn_of_damage(problems)
