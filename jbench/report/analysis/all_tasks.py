"""Scores of several tasks together.

Returns of tasks with different ranges are normalized before they are joined: 0 is the lowest and 1
the highest return of a task, over all its runs and points, or the bounds that a reader typed. Tasks
of dm_control share a range.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from jbench.array_types import FloatArray
from jbench.report.analysis.scores import seed_scores
from jbench.report.data.configuration import Configuration
from jbench.report.data.order import in_order
from jbench.report.data.source_names import FILE

# Names of several tasks together, which share a range or do not.
ALL_TASKS = "all tasks"
NORMALIZED = "all tasks, normalized"

Range = tuple[float, float]  # lowest and highest return


def ranges(configurations: Iterable[Configuration]) -> dict[str, Range]:
    """Returns the range of each task's returns: `return_range` if known, else the recorded.

    It is (0, 0) if none of a task's returns is finite.
    """
    known: dict[str, Range] = {}
    unknown = set[str]()
    for config in configurations:
        possible = config.return_range
        if possible is None:
            recorded = config.returns[np.isfinite(config.returns)]
            if not len(recorded):
                unknown.add(config.task)
                continue
            possible = float(recorded.min()), float(recorded.max())

        lowest, highest = possible
        low, high = known.get(config.task, (lowest, highest))
        known[config.task] = (min(low, lowest), max(high, highest))

    return dict.fromkeys(unknown, (0.0, 0.0)) | known


def strata(finals: Sequence[FloatArray], tasks: Sequence[Range]) -> tuple[list[FloatArray], Range]:
    """Returns final returns (seeds,) that can be joined, and their range: normalized if needed."""
    if len({*tasks}) == 1:
        return [*finals], tasks[0]
    normalized = [
        (final - low) / ((high - low) or 1.0)
        for final, (low, high) in zip(finals, tasks, strict=True)
    ]
    return normalized, (0.0, 1.0)


def together(known: Mapping[str, Range]) -> str:
    """Returns what several tasks together are called."""
    return ALL_TASKS if len({*known.values()}) == 1 else NORMALIZED


def on_all_tasks(configurations: Iterable[Configuration]) -> list[list[Configuration]]:
    """Returns the configurations, by task, that were trained equally long on each of several."""
    groups: dict[tuple[str, int], dict[str, Configuration]] = {}
    known = [config for config in configurations if len(seed_scores(config).final)]
    for config in known:
        # A file has one curve of a method on a task, of any length.
        steps = 0 if config.source == FILE else int(config.steps.max())
        groups.setdefault((config.label, steps), {}).setdefault(config.task, config)

    tasks = in_order(config.task for config in known)
    whole = [group for group in groups.values() if len(group) == len(tasks) > 1]
    return [[group[task] for task in tasks] for group in whole]
