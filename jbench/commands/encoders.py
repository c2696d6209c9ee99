"""The commands train-encoder and train-dae, which is the same with another help."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Option

from jbench import names, typed_values
from jbench.commands import options, output, parsing
from jbench.commands.encoder_tables import show_errors, show_explained
from jbench.commands.kept import kept_encoders
from jbench.representation_names import ENCODER_KINDS
from jbench.wording import counted, with_results

if TYPE_CHECKING:
    import torch

    from jbench.datasets import Dataset
    from jbench.encoders.settings import EncoderSettings
    from jbench.encoders.states import States
    from jbench.store import Record, Results

_FAR_LESS = 0.1  # of the variance
_TRIAL = 1000  # episodes; who collects fewer first tries what comes next


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
    set_: list[str] = options.SET,
    seed: str = Option(
        "0",
        help="Random seed of weights, minibatches, noise and the held-out split, or several, such "
        "as 0-9: an encoder for each.",
    ),
    device: str = options.DEVICE,
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
    wanted = _Wanted(
        kinds=kind,
        options=given,
        base=settings,
        latent=latent,
        tasks=names.TASKS if task == "all" else (task,),
        seeds=typed_values.parse_numbers(seed, "--seed"),
    )
    # Wrong requests are refused before a dataset is missed.
    _planned(wanted, None)
    source = find_dataset(database, dataset, wanted.tasks[0])
    read = lru_cache(1)(partial(States, source, scale=given.get("scale", "dataset")))
    planned = _planned(wanted, source)
    if latent is None:
        planned = [_counted(encoder, read(encoder.task, encoder.seed)) for encoder in planned]

    planned = [kept_settings(database, encoder) for encoder in planned]
    planned = _with_recorded_code(planned, database)
    output.if_stopped(partial(kept_encoders, planned, database))
    records = [
        _train_one(encoder, read(encoder.task, encoder.seed), database, train_on)
        for encoder in planned
    ]
    for record in records if verbose else ():
        show_errors(record)

    show_explained(records)
    first = planned[0]
    draws = " --encoder-seeds each" if planned[-1].seed != first.seed else ""
    trial = " --steps 20k --seeds 0-1" if source.episodes < _TRIAL else ""
    command = f"jbench train --task {first.task} --encoder {first.representation}{draws}{trial}"
    output.say(f"Next: {with_results(command, results)}")
    output.document({"encoders": [output.described(record) for record in records]})


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
    from jbench.encoders.kind import Learned
    from jbench.encoders.kinds.predictive import Predictive
    from jbench.encoders.loop import CHECKPOINT
    from jbench.encoders.registry import find_kind
    from jbench.encoders.training import train_encoder
    from jbench.store import locks

    epochs = settings.options.get("epochs")
    before = database.find("encoder", settings.id)
    is_held = locks.is_held(database.folder("encoder", settings.id).path)
    if before is not None and not before.is_finished and not is_held:
        how = "resumes" if CHECKPOINT in before.roles() else "starts over"
        output.say(f"The encoder {settings.id} was interrupted; it {how}.")

    label = f"{settings.representation} {settings.task}"
    then = "measuring what the latents explain and predict"
    is_finished = before is not None and before.is_finished
    with output.progress(label, 0 if is_finished else epochs or 1, "epochs", then) as progress:
        record = train_encoder(settings, states, database, progress, device=device)

    if is_finished:
        output.say(f"The encoder {settings.id} is already finished; nothing to do.")
    else:
        passes = "" if epochs is None else f", {counted(epochs, 'epoch')}"
        output.say(
            f"Encoder {settings.id}: {counted(settings.latents, 'latent')} of {states.size} "
            f"features, from {settings.dataset}{passes}."
        )

    kind = find_kind(settings.kind)
    (errors,) = record.read("encoder_errors").to_pylist()
    explained = errors["test_explained"]
    pca = errors["pca_explained"]
    reconstructs = issubclass(kind, Learned) and not issubclass(kind, Predictive)
    if reconstructs and explained < pca - _FAR_LESS:
        output.warn(
            f"{record.id} explains {explained:.3f} of the variance and PCA of the same size "
            f"{pca:.3f}; train it longer, with --epochs of more than {epochs:,}, or on more steps."
        )

    return record


def _counted(encoder: "EncoderSettings", states: "States") -> "EncoderSettings":
    """Returns settings with the number of latents that a kind of another package has."""
    import torch

    from jbench.encoders.kind import Fitted
    from jbench.encoders.registry import find_kind, latent_sizes
    from jbench.encoders.training import counted_latents

    has_several = len(latent_sizes(encoder.kind, encoder.task, encoder.options)) > 1
    is_ours = encoder.kind in ENCODER_KINDS
    if is_ours or not has_several or not issubclass(find_kind(encoder.kind), Fitted):
        return encoder

    states.read(torch.device("cpu"))
    observed = states if encoder.columns is None else states.only(encoder.columns)
    count = counted_latents(encoder.kind, encoder.options, observed, encoder.latents)
    return encoder.model_copy(update={"latents": count})


@dataclass(frozen=True)
class _Wanted:
    """The encoders that a user wants.

    Attributes:
        kinds: names with commas.
        options: of the kinds, those that were typed.
        base: source of the other options.
        latent: numbers of latents as typed, or None for 12 or the only size.
        tasks, seeds: an encoder for each.
    """

    kinds: str
    options: dict[str, Any]
    base: names.EncoderBase | None
    latent: str | None
    tasks: Sequence[str]
    seeds: Sequence[int]


def _planned(wanted: _Wanted, source: "Dataset | None") -> list["EncoderSettings"]:
    """Returns the settings of an encoder for each task, seed, kind and number of latents.

    If any kind has several sizes, --latent is ignored for kinds that have only one. The dataset is
    None if it is not known yet.
    """
    from jbench.encoders.registry import latent_sizes
    from jbench.encoders.settings import encoder_settings

    typed = wanted.options
    latent = wanted.latent or str(options.LATENTS)
    numbers = typed_values.parse_numbers(latent, "--latent", "12, or 2,4,8, or 1-16")
    known = dict.fromkeys(
        name.lower() if name.lower() in ENCODER_KINDS else name for name in wanted.kinds.split(",")
    )

    planned = []
    for task in wanted.tasks:
        possible = {kind: list(latent_sizes(kind, task, typed)) for kind in known}
        only = {kind: sizes for kind, sizes in possible.items() if len(sizes) == 1}
        if wanted.latent is not None and len(only) == len(known):
            only.clear()

        for seed, kind in product(wanted.seeds, known):
            planned += [
                encoder_settings(
                    kind,
                    typed,
                    task=task,
                    seed=seed,
                    base=wanted.base,
                    episodes=source.episodes if source else None,
                    mean_steps=source.control_steps / source.episodes if source else None,
                    latents=size,
                    dataset=source.id if source else "any",
                )
                for size in only.get(kind, numbers)
            ]

    return planned
