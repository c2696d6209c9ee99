"""Which runs are trained in one process."""

from collections.abc import Sequence

import numpy as np

from jbench.settings.engines import ENGINES
from jbench.settings.recorded import SEED, alike
from jbench.settings.run import RunSettings


def batches(runs: Sequence[RunSettings], jobs: int, device: str) -> list[list[RunSettings]]:
    """Returns the runs of each process.

    On a CPU the seeds of a configuration are divided among `jobs` processes. On a GPU they are one
    stack in one process. A run of an engine that takes one seed has its own process.
    """
    configurations: dict[str, list[RunSettings]] = {}
    for run in runs:
        key = alike(run, SEED) if ENGINES[run.engine].takes_many_seeds else run.id
        configurations.setdefault(key, []).append(run)

    most = jobs if device == "cpu" else 1
    return [
        [seeds[i] for i in part]
        for seeds in configurations.values()
        for part in np.array_split(range(len(seeds)), min(most, len(seeds)))
    ]
