"""The commands train-encoder and train-dae, which is the same with another help."""

import contextlib
from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from typer import Option

from jbench import names, typed_values
from jbench.commands import options, output, parsing
from jbench.commands.encoder_tables import show_errors, show_explained
from jbench.commands.requested_encoders import Wanted, planned_encoders, with_known_size
from jbench.commands.stopped import stopped_encoders
from jbench.errors import RequestError
from jbench.representation_names import ENCODER_KINDS
from jbench.wording import counted, with_results

if TYPE_CHECKING:
    import torch

    from jbench.datasets import Dataset
    from jbench.encoders.settings import EncoderSettings
    from jbench.encoders.states import States
    from jbench.store import Record, Results

_FAR_LESS = 0.1  # of the variance
_TRIAL = 1_000_000  # control steps; who collects fewer first tries what comes next


def train_encoder(
    kind: str = Option(
        "dae",
        help=f"Kind of encoder: {', '.join(ENCODER_KINDS)}, one of another "
        "package, or MODULE:CLASS; several: a,b.",
        autocompletion=lambda: ENCODER_KINDS,
    ),
    task: str = options.some_task(
        "face_direction",
        help=f"Task of the observations: {', '.join(names.TASKS)}, all (of these), or a task of "
        "another robot (jbench tasks).",
    ),
    latent: str | None = Option(
        None, help="Number of latents, or several: 2,4,8 or 1-16 (default: 12, or the only size)."
    ),
    dataset: str | None = options.DATASET,
    settings: names.EncoderBase | None = Option(
        None,
        help="Source of dae's options: script (the authors' script, whose training is not that of "
        "the paper's text; docs/encoders.md).",
    ),
    noise: float | None = options.number(
        None,
        unit="NOISE",
        help="Standard deviation of the noise on scaled features (default: 0.1).",
    ),
    horizon: int | None = options.whole_number(
        None,
        unit="STEPS",
        help="Control steps ahead that the kind predicts (default: that of the kind).",
    ),
    epochs: int | None = options.whole_number(
        None,
        unit="EPOCHS",
        help="Number of passes over the training rows (default: that of the kind, such as dae's "
        "200; more for a small dataset, so that it has 4,000 updates).",
    ),
    batch: int | None = options.whole_number(
        None, unit="ROWS", help="Minibatch size (default: the kind's; dae has 8192)."
    ),
    learning_rate: float | None = options.number(
        None,
        unit="RATE",
        help="Learning rate of Adam (default: 1e-3; the authors' script has 5e-4).",
    ),
    set_: list[str] = options.SET_OF_ENCODER,
    seed: str = Option(
        "0",
        help="Random seed of weights, minibatches, noise and the held-out split, or several, such "
        "as 0-9: an encoder for each.",
    ),
    device: str = options.DEVICE_OF_ENCODER,
    verbose: bool = Option(False, "--verbose", help="Also print the errors as tables."),
    results: Path = options.RESULTS,
    json: bool = options.JSON,
) -> None:
    """Train encoders of any kind on a dataset.

    One encoder is trained for each kind and number of latents.
    """
    from jbench.datasets import find_dataset
    from jbench.devices import find_device
    from jbench.encoders.find import kept_settings
    from jbench.encoders.states import States

    database = parsing.results_to_write(results)
    train_on = find_device(device)
    typed = {
        "noise": noise,
        "horizon": horizon,
        "epochs": epochs,
        "batch": batch,
        "learning_rate": learning_rate,
    }
    assigned = (f"{name}={value}" for name, value in typed.items() if value is not None)
    given = parsing.parse_overrides([*assigned, *set_])
    wanted = Wanted(
        kinds=kind,
        options=given,
        base=settings,
        latent=latent,
        tasks=names.TASKS if task == "all" else (task,),
        seeds=typed_values.parse_numbers(seed, "--seed"),
    )
    # Wrong requests are refused before a dataset is missed.
    planned_encoders(wanted, None)
    source = find_dataset(database, dataset, wanted.tasks[0])
    read = lru_cache(1)(partial(States, source, scale=given.get("scale", "dataset")))
    planned = planned_encoders(wanted, source)
    if latent is None:
        planned = [
            with_known_size(encoder, read(encoder.task, encoder.seed)) for encoder in planned
        ]

    planned = [kept_settings(database, encoder) for encoder in planned]
    planned = _with_recorded_code(planned, database)
    output.if_stopped(partial(stopped_encoders, planned, database))
    records = [
        _train_one(encoder, read(encoder.task, encoder.seed), database, train_on)
        for encoder in planned
    ]
    if verbose:
        for record in records:
            show_errors(record)

    show_explained(records)
    output.say(f"Next: {with_results(_training_command(planned, source, database), results)}")
    output.document({"encoders": [output.described(record) for record in records]})


def _training_command(
    encoders: Sequence["EncoderSettings"], source: "Dataset", database: "Results"
) -> str:
    """Returns the command that trains agents on the first of some encoders.

    Its representation names the newest one of the plain robot, so another one has its id there.
    """
    from jbench.encoders.find import find_encoder

    first = encoders[0]
    name = first.id
    with contextlib.suppress(RequestError):
        if find_encoder(database, first.representation, first.task) == first.id:
            name = first.representation

    command = f"jbench train --task {first.task} --encoder {name}"
    if encoders[-1].seed != first.seed:
        command += " --encoder-seeds each"
    if source.control_steps < _TRIAL:
        command += " --steps 20k --seeds 0-1"

    return command


def _with_recorded_code(
    encoders: Sequence["EncoderSettings"], database: "Results"
) -> list["EncoderSettings"]:
    """Returns the settings of encoders as recorded ones of the same code; prints what changed."""
    from jbench.encoders.training import plan_encoder
    from jbench.store.planned import say_changed

    plans = [plan_encoder(encoder, database) for encoder in encoders]
    for sentence in say_changed(plans, database.ids("encoder")):
        output.say(sentence)
    return [plan.settings for plan in plans]


def _train_one(
    settings: "EncoderSettings", states: "States", database: "Results", device: "torch.device"
) -> "Record":
    """Trains one encoder, with its progress; one that is finished is returned as it is."""
    from jbench.encoders.training import train_encoder

    before = database.find("encoder", settings.id)
    is_finished = before is not None and before.is_finished
    if before is not None and not is_finished:
        _say_interrupted(before)

    epochs = settings.options.get("epochs")
    epochs_to_show = epochs or 1
    if is_finished:
        epochs_to_show = 0

    label = f"{settings.representation} {settings.task}"
    last_work = "measuring what the latents explain and predict"
    with output.progress(label, epochs_to_show, "epochs", last_work) as progress:
        record = train_encoder(settings, states, database, progress, device=device)

    if is_finished:
        output.say(f"The encoder {settings.id} is already finished; nothing to do.")
    else:
        origin = settings.dataset
        if epochs is not None:
            origin += f", {counted(epochs, 'epoch')}"
        output.say(
            f"Encoder {settings.id}: {counted(settings.latents, 'latent')} of {states.size} "
            f"features, from {origin}."
        )

    _warn_if_far_from_pca(settings, record)
    return record


def _say_interrupted(encoder: "Record") -> None:
    """Prints whether an unfinished encoder resumes, unless another process is training it."""
    from jbench.encoders.loop import CHECKPOINT
    from jbench.store import locks

    if locks.is_held(encoder.path):
        return
    if CHECKPOINT in encoder.roles():
        output.say(f"The encoder {encoder.id} was interrupted; it resumes.")
    else:
        output.say(f"The encoder {encoder.id} was interrupted; it starts over.")


def _warn_if_far_from_pca(settings: "EncoderSettings", encoder: "Record") -> None:
    """Warns if an encoder that learns to reconstruct states explains far less of them than PCA."""
    from jbench.encoders.kind import Learned
    from jbench.encoders.kinds.predictive import Predictive
    from jbench.encoders.registry import find_kind

    kind = find_kind(settings.kind)
    if not issubclass(kind, Learned) or issubclass(kind, Predictive):
        return

    (errors,) = encoder.read("encoder_errors").to_pylist()
    explained = errors["test_explained"]
    pca = errors["pca_explained"]
    if explained < pca - _FAR_LESS:
        epochs = settings.options["epochs"]
        output.warn(
            f"{encoder.id} explains {explained:.3f} of the variance and PCA of the same size "
            f"{pca:.3f}; train it longer, with --epochs of more than {epochs:,}, or on more steps."
        )
