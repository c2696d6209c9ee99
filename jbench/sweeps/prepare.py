"""Makes what the runs of a matrix need: its encoders, and the dataset that they learn from."""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from typing import TypeVar

from jbench.datasets import collect, find_dataset
from jbench.encoders.loop import find_device
from jbench.encoders.settings import EncoderSettings
from jbench.encoders.states import States
from jbench.encoders.training import train_encoder
from jbench.errors import RequestError, WorkError
from jbench.settings.dataset import DatasetSettings
from jbench.store import Results
from jbench.store.locks import HeldError
from jbench.sweeps.matrix import Cell

_LOOK_EVERY = 2.0  # s between two looks at what another process makes

Show = Callable[[str, int, str], AbstractContextManager[Callable[[int], None]]]
"""Shows the progress of a piece of work of some name, total and unit; gives what is told of it."""

_Made = TypeVar("_Made")


def missing_encoders(cells: Iterable[Cell], results: Results) -> list[EncoderSettings]:
    """Returns the encoders of some cells that are not finished, each once."""
    wanted = {cell.encoder.id: cell.encoder for cell in cells if cell.encoder is not None}
    return [settings for settings in wanted.values() if not _finished(results, settings.id)]


def missing_dataset(dataset: DatasetSettings, results: Results) -> bool:
    """Returns whether a dataset has to be collected, or finished."""
    record = results.find("dataset", dataset.id)
    return record is None or record.status != "finished"


def prepare(
    encoders: list[EncoderSettings],
    dataset: DatasetSettings,
    results: Results,
    threads: int,
    device: str,
    show: Show,
    note: Callable[[str], None],
) -> dict[str, str]:
    """Makes encoders, and first the dataset that they learn from.

    If another process is making one of them, waits for it.

    Args:
        encoders: that are missing, all of this dataset.
        dataset: that they learn from.
        results: where they go.
        threads: robots that are simulated at a time.
        device: to train on, one of `jbench.names.DEVICES`.
        show: shows the progress of each.
        note: prints a sentence.

    Returns:
        A sentence for each encoder that can't be made, by its id.
    """
    if not encoders:
        return {}
    try:
        if missing_dataset(dataset, results):
            with show("collect", dataset.steps, "control steps") as progress:
                _unless_held(lambda: collect(dataset, results, threads, progress), note)
    except (RequestError, WorkError) as error:
        return {settings.id: f"its dataset can't be collected: {error}" for settings in encoders}
    failures = {}
    for settings, states in _with_states(encoders, dataset, results):
        try:
            _make(settings, states, results, device, show, note)
        except (RequestError, WorkError) as error:
            failures[settings.id] = f"its encoder can't be trained: {error}"
    return failures


def _make(
    settings: EncoderSettings,
    states: States,
    results: Results,
    device: str,
    show: Show,
    note: Callable[[str], None],
) -> None:
    """Trains an encoder."""
    found = find_device(device)
    label, epochs = f"{settings.representation} {settings.task}", settings.options.get("epochs", 1)
    with show(label, epochs, "epochs") as progress:
        _unless_held(lambda: train_encoder(settings, states, results, progress, device=found), note)


def _with_states(
    encoders: list[EncoderSettings], dataset: DatasetSettings, results: Results
) -> Iterator[tuple[EncoderSettings, States]]:
    """Gives encoders with the states that they learn from, which are read once for each task."""
    source = find_dataset(results, dataset.id)
    states: States | None = None
    for settings in sorted(encoders, key=lambda settings: settings.task):
        if states is None or states.task != settings.task:
            states = States(source, settings.task, settings.seed)
        yield settings, states


def _unless_held(make: Callable[[], _Made], note: Callable[[str], None]) -> _Made:
    """Returns what is made, once no other process makes it."""
    told = False
    while True:
        try:
            return make()
        except HeldError as error:
            if not told:
                note(f"{str(error).partition(';')[0]}; it is waited for.")
                told = True
            time.sleep(_LOOK_EVERY)


def _finished(results: Results, encoder: str) -> bool:
    try:
        record = results.find("encoder", encoder)
    except WorkError:
        return False
    return record is not None and record.status == "finished"
