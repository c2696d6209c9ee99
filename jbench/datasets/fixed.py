"""Collecting episodes of one length, file by file, while the next files are simulated."""

import itertools
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from threading import Event
from typing import NamedTuple

import pyarrow as pa

from jbench.settings.records import DatasetSettings
from jbench.store import Record
from jbench.tasks.worlds import EpisodeError

PART_EPISODES = 10
"""Episodes of a file, and of a commit."""

REPORT_SECONDS = 0.5
"""Seconds between two reports of progress."""


class Part(NamedTuple):
    """Tables of some episodes; `failure` is the error of the next one, which can't go on."""

    tables: dict[str, pa.Table]
    failure: EpisodeError | None = None


class SimulatedSteps:
    """The control steps of a file that have been simulated; counted by one thread."""

    def __init__(self, ended: Event) -> None:
        """Begins to count until the collection has ended."""
        self.done = 0
        self._ended = ended

    def count(self, steps: int) -> None:
        """Counts further control steps; raises a CancelledError after the end of the collection."""
        if self._ended.is_set():
            raise CancelledError
        self.done += steps


Simulate = Callable[[range, SimulatedSteps], Part]
"""Returns the tables of some episodes, and counts their control steps meanwhile."""


def collect_fixed(
    settings: DatasetSettings,
    record: Record,
    episode_table: str,
    simulation: AbstractContextManager[Simulate],
    max_files: int,
    progress: Callable[[int], None],
) -> None:
    """Collects the episodes that a dataset lacks, and commits them in order.

    Args:
        settings: of the dataset.
        record: to which the episodes are appended.
        episode_table: name of the table with a row for each episode.
        simulation: a context with a function that simulates episodes; no thread is in the function
            when it ends.
        max_files: files that are simulated at the same time.
        progress: takes the control steps that are committed or simulated, at least each second.

    Raises:
        EpisodeError: if an episode can't go on; those before it are kept.
    """
    length = settings.episode_steps
    total = settings.steps // length
    first = record.rows(episode_table)
    starts = range(first, total, PART_EPISODES)
    parts = [range(start, min(start + PART_EPISODES, total)) for start in starts]
    progress(first * length)

    # Closed in reverse order: threads stop, the pool waits for them, and then their worlds close.
    ended = Event()
    with simulation as simulated, ThreadPoolExecutor(max_files) as makers, _setting(ended):
        for made, ahead in _in_order(makers, simulated, parts, max_files, ended):
            if made is not None:
                record.append(made.tables)
                if made.failure is not None:
                    raise made.failure

            progress(record.rows(episode_table) * length + ahead)


@contextmanager
def _setting(ended: Event) -> Iterator[None]:
    """Sets an event at the end of a block, however it ends."""
    try:
        yield
    finally:
        ended.set()


def _in_order(
    makers: ThreadPoolExecutor,
    simulated: Simulate,
    parts: Sequence[range],
    max_files: int,
    ended: Event,
) -> Iterator[tuple[Part | None, int]]:
    """Yields the part of each file, and the control steps that are simulated beyond it.

    While a file is simulated, None takes the place of its part, at least each second.
    """
    waiting = iter(parts)
    ahead = deque[tuple[Future[Part], SimulatedSteps]]()

    def submit(files: int) -> None:
        for part in itertools.islice(waiting, files):
            steps = SimulatedSteps(ended)
            ahead.append((makers.submit(simulated, part, steps), steps))

    submit(max_files)

    while ahead:
        first, _ = ahead[0]
        while not wait([first], REPORT_SECONDS).done:
            yield None, sum(steps.done for _, steps in ahead)
        ahead.popleft()
        submit(1)
        yield first.result(), sum(steps.done for _, steps in ahead)
