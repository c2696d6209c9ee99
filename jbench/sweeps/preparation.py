"""Makes the encoders that cells lack, and the datasets on which these are trained."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import count, groupby

import torch

from jbench.cores import cores
from jbench.datasets import collect, find_dataset
from jbench.devices import find_device
from jbench.encoders.registry import make_kind, options_with_epochs
from jbench.encoders.settings import EncoderSettings
from jbench.encoders.states import Scale, States
from jbench.encoders.training import train_encoder
from jbench.errors import RequestError, WorkError
from jbench.settings.records import DatasetSettings
from jbench.store import Results
from jbench.store.follow import POLL_SECONDS
from jbench.store.locks import HeldError
from jbench.sweeps.cell import Cell, all_runs
from jbench.training.events import Note, Progress, Report, Warned


def missing_encoders(
    cells: Iterable[Cell], results: Results
) -> list[tuple[DatasetSettings, list[EncoderSettings]]]:
    """Returns each dataset with those of its encoders that are not finished, if there are any."""
    datasets = {cell.dataset.id: cell.dataset for cell in cells if cell.dataset is not None}
    missing: dict[str, list[EncoderSettings]] = {id: [] for id in datasets}
    for encoder in {encoder.id: encoder for cell in cells for encoder in cell.encoders}.values():
        if not results.is_finished("encoder", encoder.id):
            missing[encoder.dataset].append(encoder)
    return [(datasets[id], encoders) for id, encoders in missing.items() if encoders]


def warnings_of_epochs(dataset: DatasetSettings, encoders: Iterable[EncoderSettings]) -> list[str]:
    """Returns a sentence for each kind of encoder that has few epochs, of a file that gives none.

    A sweep takes the number of epochs of its file, or else the default of the kind, so the same
    file always gives the same encoders. `jbench train-dae` chooses more for a small dataset.
    """
    sentences = []
    for encoder in encoders:
        epochs = encoder.options.get("epochs")
        if epochs is None or "epochs" in encoder.named:
            continue

        others = {name: value for name, value in encoder.options.items() if name != "epochs"}
        episodes = max(2, dataset.steps // dataset.episode_steps)
        steps = dataset.steps / episodes
        chosen = options_with_epochs(encoder.kind, others, episodes, steps, encoder.seed)["epochs"]
        if chosen > epochs:
            sentences.append(
                f"{encoder.representation} of {encoder.task} is trained for {epochs:,} epochs, few "
                f"for {dataset.steps:,} control steps, for which jbench train-encoder chooses "
                f"{chosen:,}: type epochs = {chosen} under [encoder.options.{encoder.kind}] of the "
                "matrix file."
            )

    return list(dict.fromkeys(sentences))


def prepare(cells: Sequence[Cell], results: Results, device: str, report: Report) -> dict[str, str]:
    """Makes the missing encoders of runs, and first the datasets on which they are trained.

    If another process is making one of them, this waits for it. Returns a sentence for each run
    whose encoder can't be made, by run id.
    """
    train_on = find_device(device)
    runs = all_runs(cells)
    needed = {run.encoder for run in runs}
    failures: dict[str, str] = {}  # by encoder
    for dataset, encoders in missing_encoders(cells, results):
        wanted = [encoder for encoder in encoders if encoder.id in needed]
        if wanted:
            for sentence in warnings_of_epochs(dataset, wanted):
                report(Warned(sentence))
            failures |= _make_encoders(dataset, wanted, results, train_on, report)

    for encoder_id, reason in failures.items():
        report(Warned(f"the runs on {encoder_id} are left out: {reason}"))

    return {run.id: failures[run.encoder] for run in runs if run.encoder in failures}


def _make_encoders(
    dataset: DatasetSettings,
    encoders: Sequence[EncoderSettings],
    results: Results,
    device: torch.device,
    report: Report,
) -> dict[str, str]:
    """Makes encoders, and first their dataset; returns why some can't be made, by encoder id."""
    if not results.is_finished("dataset", dataset.id):
        begun = Progress("collect", 0, dataset.steps, "control steps")
        try:
            _make(partial(collect, dataset, results, cores()), begun, report)
        except (RequestError, WorkError) as error:
            reason = f"its dataset can't be collected: {error}"
            return {encoder.id: reason for encoder in encoders}

    def data(encoder: EncoderSettings) -> tuple[str, int, Scale]:
        """Returns what the states of an encoder depend on: its task, seed and scale."""
        return encoder.task, encoder.seed, make_kind(encoder.kind, encoder.options).scale

    failures: dict[str, str] = {}
    for (task, seed, scale), sharing in groupby(sorted(encoders, key=data), data):
        states = States(find_dataset(results, dataset.id), task, seed, scale=scale)  # read once
        for encoder in sharing:
            work = f"{encoder.representation} {task}"
            begun = Progress(work, 0, encoder.options.get("epochs", 1), "epochs")
            train = partial(train_encoder, encoder, states, results, device=device)
            try:
                _make(train, begun, report)
            except (RequestError, WorkError) as error:
                failures[encoder.id] = f"its encoder can't be trained: {error}"

    return failures


def _make(make: Callable[..., object], begun: Progress, report: Report) -> None:
    """Makes a record and reports its progress; waits while another process is making it."""
    report(begun)
    for look in count():
        try:
            make(lambda done: report(replace(begun, done=done)))
            return
        except HeldError as error:
            if look == 0:
                report(Note(f"{error.reason}; waiting for it."))
            time.sleep(POLL_SECONDS)
