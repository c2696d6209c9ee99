"""Collecting a random-policy dataset: one simulation for all five tasks, or of another robot."""

from collections.abc import Callable

from jbench.datasets.by_robot import find_layout
from jbench.datasets.failed import way_on
from jbench.settings.records import DatasetSettings
from jbench.store import Record, Results
from jbench.store.code import check_code
from jbench.store.planned import Planned
from jbench.tasks.worlds import EpisodeError


def plan_dataset(settings: DatasetSettings, results: Results) -> Planned[DatasetSettings]:
    """Returns settings with the id of a recorded dataset of the same code, if there is one.

    Raises a RequestError if the last episode would be cut, see `DatasetLayout.check_steps`.
    """
    layout = find_layout(settings.robot)
    layout.check_steps(settings)
    return layout.plan(settings, results)


def collect(
    settings: DatasetSettings,
    results: Results,
    threads: int,
    progress: Callable[[int], None] = lambda steps: None,
) -> Record:
    """Collects a dataset, resumes its collection, or returns the finished one.

    The actions are uniform in [-1, 1] (paper, section 5.2). Every episode has its own generator, so
    the dataset does not depend on threads or interruptions. It is committed file by file, and the
    next ones are simulated while one is written. `progress` takes the control steps that are
    committed or simulated, at least each second. Raises a RequestError if its robot is not
    installed or has changed, or its last episode would be cut, and a WorkError if another process
    collects it, or the disk is full.
    An episode that can't go on fails the dataset with an EpisodeError; those before it are kept.
    """
    layout = find_layout(settings.robot)
    layout.check_steps(settings)
    with results.locked("dataset", settings.id) as existing:
        if existing is not None and existing.is_finished:
            return existing
        code = layout.code()
        if existing is not None:
            check_code(existing, code)
            record = existing
        else:
            provenance = {**layout.notes(), **code}
            record = results.create("dataset", settings.id, settings.model_dump(), provenance)

        if record.status == "failed":
            record.resume({"control_steps": layout.control_steps(record)})
        try:
            layout.collect(settings, record, threads, progress)
        except EpisodeError as error:
            record.fail(str(error), error.summary)
            raise error.with_clause(way_on(record, results, layout)) from error
        record.finish({}, join=False)

    return record
