"""Listing datasets."""

from typing import NamedTuple

from pydantic import ValidationError

from jbench.datasets import layout
from jbench.names import EPISODE_STEPS
from jbench.settings.records import DatasetSettings
from jbench.store import Record, Results


class Listed(NamedTuple):
    """A finished or unfinished dataset.

    Attributes:
        steps: committed control steps.
    """

    record: Record
    settings: DatasetSettings
    steps: int


def list_datasets(results: Results) -> tuple[list[Listed], list[str]]:
    """Returns all datasets, oldest first, and an error for each unreadable one."""
    records, problems = results.scan("dataset")
    datasets = []
    for record in records:
        try:
            settings = DatasetSettings.model_validate(record.settings)
        except ValidationError as error:
            problems.append(
                f"The dataset {record.id} has invalid settings "
                f"({error.errors()[0]['msg']}); delete {record.path} to make it again."
            )
            continue
        steps = record.rows(layout.tables(settings.robot)[1]) * EPISODE_STEPS
        datasets.append(Listed(record, settings, steps))
    return datasets, problems
