"""Makes the encoders that runs need, and the datasets on which these are trained."""

import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import groupby

from jbench.cores import cores
from jbench.datasets import collect, find_dataset
from jbench.devices import find_device
from jbench.encoders.registry import EncoderSettings, make_kind
from jbench.encoders.states import Scale, States
from jbench.encoders.training import train_encoder
from jbench.errors import RequestError, WorkError
from jbench.settings.records import DatasetSettings
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.store.follow import LOOK_EVERY
from jbench.store.locks import HeldError
from jbench.store.manifest import Kind
from jbench.sweeps.cell import Cell
from jbench.training.events import Event, Report


def missing_encoders(
    cells: Iterable[Cell], results: Results
) -> list[tuple[DatasetSettings, list[EncoderSettings]]]:
    """Returns each dataset with those of its encoders that are not finished, if there are any."""
    datasets = {cell.dataset.id: cell.dataset for cell in cells if cell.dataset is not None}
    missing: dict[str, list[EncoderSettings]] = {id: [] for id in datasets}
    for encoder in {encoder.id: encoder for cell in cells for encoder in cell.encoders}.values():
        if not is_finished(results, "encoder", encoder.id):
            missing[encoder.dataset].append(encoder)
    return [(datasets[id], encoders) for id, encoders in missing.items() if encoders]


def is_finished(results: Results, kind: Kind, id: str) -> bool:
    """Returns whether a record is finished; False if it is damaged, which its writer reports."""
    try:
        record = results.find(kind, id)
    except WorkError:
        return False
    return record is not None and record.status == "finished"


def prepare(
    cells: Sequence[Cell],
    runs: Sequence[RunSettings],
    results: Results,
    device: str,
    report: Report,
) -> dict[str, str]:
    """Makes the missing encoders of runs, and first the datasets on which they are trained.

    If another process is making one of them, this waits for it. The cells contain the runs, and
    maybe others. Returns a sentence for each run whose encoder can't be made, by run id.
    """
    needed = {run.encoder for run in runs}
    failures: dict[str, str] = {}
    for dataset, encoders in missing_encoders(cells, results):
        if wanted := [encoder for encoder in encoders if encoder.id in needed]:
            failures |= _make(wanted, dataset, results, device, report)
    for encoder_id, reason in failures.items():
        report(Event("warning", text=f"the runs on {encoder_id} are left out: {reason}"))
    return {run.id: failures[run.encoder] for run in runs if run.encoder in failures}


def _make(
    encoders: Sequence[EncoderSettings],
    dataset: DatasetSettings,
    results: Results,
    device: str,
    report: Report,
) -> dict[str, str]:
    """Makes encoders of a dataset; returns a sentence for each that can't be made, by id."""
    try:
        if not is_finished(results, "dataset", dataset.id):
            progress = _progress("collect", dataset.steps, "control steps", report)
            _when_free(lambda: collect(dataset, results, cores(), progress), report)
    except (RequestError, WorkError) as error:
        return {settings.id: f"its dataset can't be collected: {error}" for settings in encoders}
    source = find_dataset(results, dataset.id)

    def about(settings: EncoderSettings) -> tuple[str, int, Scale]:
        return settings.task, settings.seed, make_kind(settings.kind, settings.options).scale

    failures = {}
    for (task, seed, scale), sharing in groupby(sorted(encoders, key=about), about):
        states = States(source, task, seed, scale=scale)  # read once
        for settings in sharing:
            label, epochs = settings.representation, settings.options.get("epochs", 1)
            progress = _progress(f"{label} {task}", epochs, "epochs", report)
            train = partial(train_encoder, settings, states, results, progress)
            try:
                _when_free(partial(train, device=find_device(device)), report)
            except (RequestError, WorkError) as error:
                failures[settings.id] = f"its encoder can't be trained: {error}"
    return failures


def _progress(what: str, total: int, unit: str, report: Report) -> Callable[[int], None]:
    """Returns a function that reports how much of the total is done; nothing is done yet."""

    def progress(done: int) -> None:
        report(Event("progress", text=what, steps=done, total=total, unit=unit))

    progress(0)
    return progress


def _when_free(make: Callable[[], object], report: Report) -> None:
    """Makes a record; waits while another process is making it."""
    noted = False
    while True:
        try:
            make()
            return
        except HeldError as error:
            if not noted:
                report(Event("note", text=f"{str(error).partition(';')[0]}; waiting for it."))
            noted = True
            time.sleep(LOOK_EVERY)
