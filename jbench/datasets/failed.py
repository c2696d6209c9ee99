"""Datasets whose collection failed in an episode: what is kept of them, and what to type."""

from jbench.datasets.layout import DatasetLayout
from jbench.settings.base import validated
from jbench.settings.records import DatasetSettings
from jbench.store import Record, Results
from jbench.tasks.find import EPISODES_REPEAT
from jbench.tasks.worlds import fails_by_numbers
from jbench.wording import with_results


def collecting_command(results: Results, layout: DatasetLayout) -> str:
    """Returns the command that collects a dataset of a robot."""
    return with_results(f"jbench collect{layout.option}", results.name)


def way_on(record: Record, results: Results, layout: DatasetLayout) -> str:
    """Returns what a failed dataset has kept, and what to type, as clauses.

    The same seed repeats an episode that failed by its numbers, so only another seed helps.
    """
    about = f"the dataset {record.id} in {record.path}"
    settings = validated(DatasetSettings, about, **record.settings)
    kept = f"{layout.control_steps(record):,} of {settings.steps:,} control steps are kept"
    repeats = record.manifest.provenance.get(EPISODES_REPEAT) is not False
    if not repeats or not fails_by_numbers(record.manifest.summary):
        return f"{kept}, and the jbench collect command that started it continues there"

    command = collecting_command(results, layout)
    again = f"{command} --steps {settings.steps} --seed {settings.seed + 1}"
    return f"{kept}, and {again} makes other episodes"


def sentence_on_failed(record: Record, results: Results, layout: DatasetLayout) -> str:
    """Returns why a dataset has failed, what it has kept, and what to type."""
    reason = (record.error or "").rstrip(".")
    return f"The dataset {record.id} has failed ({reason}); {way_on(record, results, layout)}."
