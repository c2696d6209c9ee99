"""Commands that train encoders: train-dae, train-encoder."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Option

from jbench import names
from jbench.commands import options, parsing
from jbench.commands.output import Output
from jbench.errors import RequestError
from jbench.seeds import parse_numbers
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
        help=f"Kind of encoder: {', '.join(names.ENCODER_KINDS)}, one of another package, or "
        "MODULE:CLASS; several: a,b.",
        autocompletion=options.complete(*names.ENCODER_KINDS),
    ),
    task: str = Option(
        "face_direction",
        help=f"Task of the observations: {', '.join(names.TASKS)}, all (of these), or a task of "
        "another robot (jbench tasks).",
        autocompletion=options.complete_tasks,
    ),
    latent: str | None = Option(
        None,
        help="Number of latents, or several: 2,4,8 or 1-16 (default: 12; some kinds have one "
        "size).",
    ),
    dataset: str | None = options.DATASET,
    noise: float | None = Option(
        None, help="Standard deviation of the noise on scaled features (default: 0.1)."
    ),
    horizon: int | None = Option(
        None, help="Control steps ahead that the kind predicts (default: that of the kind)."
    ),
    epochs: int | None = Option(
        None,
        help="Number of passes over the training rows (default: that of the kind, such as dae's "
        "200; more for a small dataset, so that it has 4,000 updates).",
    ),
    batch: int | None = Option(
        None, help="Minibatch size (default: that of the kind; dae has 8192)."
    ),
    learning_rate: float | None = Option(
        None, help="Learning rate of Adam (default: 1e-3; the authors' script has 5e-4)."
    ),
    set_: list[str] = Option(
        [], "--set", metavar="NAME=VALUE", help="Set an option of the kind; repeatable."
    ),
    seed: str = Option(
        "0",
        help="Random seed of weights, minibatches, noise and the held-out split, or several, such "
        "as 0-9: an encoder for each.",
    ),
    device: str = Option(
        "auto",
        help="Device to train on: auto (a GPU if there is one), cpu, cuda or such as cuda:1.",
        autocompletion=options.complete(*names.DEVICES),
    ),
    verbose: bool = Option(False, "--verbose", help="Also print the errors as tables."),
    results: Path = options.RESULTS,
    json: bool = options.JSON,
) -> None:
    """Train encoders of any kind on a dataset.

    One encoder is trained for each kind and number of latents.
    """
    from jbench.commands import display
    from jbench.datasets import find_dataset
    from jbench.devices import find_device
    from jbench.encoders.states import States

    output, database = Output(json), parsing.results_to_write(results)
    train_on = find_device(device)
    typed = {"noise": noise, "horizon": horizon, "epochs": epochs, "batch": batch}
    typed |= {"learning_rate": learning_rate}
    given: dict[str, Any] = {name: value for name, value in typed.items() if value is not None}
    for name, value in parsing.parse_overrides(set_).items():
        if name in given:
            raise RequestError(f"{name} is given twice; type it once.")
        given[name] = value
    tasks, seeds = names.TASKS if task == "all" else (task,), parse_numbers(seed)
    # Wrong requests are refused before a dataset is missed.
    _planned(kind, given, latent, tasks, seeds, None)
    source = find_dataset(database, dataset, tasks[0])
    planned = _planned(kind, given, latent, tasks, seeds, source)
    records = []
    states: States | None = None
    for settings in planned:
        if states is None or (states.task, states.seed) != (settings.task, settings.seed):
            scale = given.get("scale", "dataset")
            states = States(source, settings.task, settings.seed, scale=scale)
        records.append(_train_one(settings, states, database, train_on, output))
    display.show_encoders(records, output, verbose=verbose)
    first = planned[0]
    draws = " --encoder-seeds each" if planned[-1].seed != first.seed else ""
    trial = " --algo td3 --steps 20k --seeds 0-1" if source.episodes < _TRIAL else ""
    command = f"jbench train --task {first.task} --encoder {first.representation}{draws}{trial}"
    output.say(f"Next: {with_results(command, results)}")
    output.document({"encoders": [display.described(record) for record in records]})


@options.like(train_encoder, "kind", "horizon", "set_")
def train_dae(**typed: Any) -> None:
    """Train the paper's denoising autoencoder on a dataset.

    An interrupted training resumes.
    """
    train_encoder(kind="dae", horizon=None, set_=[], **typed)


def _train_one(
    settings: "EncoderSettings",
    states: "States",
    database: "Results",
    device: "torch.device",
    output: Output,
) -> "Record":
    """Trains an encoder and says what was trained, or that it is finished already."""
    from jbench.encoders.loop import CHECKPOINT
    from jbench.encoders.training import train_encoder

    epochs = settings.options.get("epochs")
    before = database.find("encoder", settings.id)
    if before is not None and before.status != "finished":
        how = "resumes" if CHECKPOINT in before.roles() else "starts over"
        output.say(f"The encoder {settings.id} was interrupted; it {how}.")
    label = f"{settings.representation} {settings.task}"
    then = "measuring what the latents explain and predict"
    with output.progress(label, epochs or 1, "epochs", then) as progress:
        record = train_encoder(settings, states, database, progress, device=device)
    if before is not None and before.status == "finished":
        output.say(f"The encoder {settings.id} is already finished; nothing to do.")
    else:
        passes = "" if epochs is None else f", {counted(epochs, 'epoch')}"
        output.say(
            f"Encoder {settings.id}: {counted(settings.latents, 'latent')} of {states.size} "
            f"features, from {settings.dataset}{passes}."
        )
    _warn_of_error(record, output)
    return record


def _warn_of_error(record: "Record", output: Output) -> None:
    """Warns if an encoder that learns to reconstruct states explains far less than PCA."""
    from jbench.encoders.kind import Learned
    from jbench.encoders.kinds.predictive import Predictive
    from jbench.encoders.registry import find_kind

    kind = find_kind(record.settings["kind"])
    if not issubclass(kind, Learned) or issubclass(kind, Predictive):
        return
    (errors,) = record.read("encoder_errors").to_pylist()
    explained, pca = errors["test_explained"], errors["pca_explained"]
    if explained < pca - _FAR_LESS:
        output.warn(
            f"{record.id} explains {explained:.3f} of the variance and PCA of the same size "
            f"{pca:.3f}; train it longer, with --epochs of more than "
            f"{record.settings['options']['epochs']:,}, or on more steps."
        )


def _planned(
    kinds: str,
    options: dict[str, Any],
    latent: str | None,
    tasks: Sequence[str],
    seeds: Sequence[int],
    source: "Dataset | None",
) -> list["EncoderSettings"]:
    """Returns the settings of an encoder for each task, seed, kind and number of latents.

    Args:
        source: dataset to train on; None if it is not known yet.
    """
    from jbench.encoders.settings import encoder_settings, options_with_epochs

    typed = dict.fromkeys(
        name.lower() if name.lower() in names.ENCODER_KINDS else name for name in kinds.split(",")
    )
    return [
        encoder_settings(
            kind,
            options_with_epochs(kind, options, source.episodes, seed) if source else options,
            task=task,
            latents=size,
            dataset=source.id if source else "any",
            seed=seed,
        )
        for task in tasks
        for seed in seeds
        for kind, size in _sizes([*typed], task, latent)
    ]


def _sizes(kinds: list[str], task: str, latent: str | None) -> list[tuple[str, int]]:
    """Returns the kinds with their numbers of latents for a task.

    If any kind has several sizes, --latent is ignored for kinds that have only one.
    """
    from jbench.encoders.registry import latent_sizes

    numbers = parse_numbers(latent or "12", "--latent", "12, or 2,4,8, or 1-16")
    sizes = {kind: latent_sizes(kind, task) for kind in kinds}
    only = {kind: list(some) for kind, some in sizes.items() if len(some) == 1}
    if latent is not None and len(only) == len(kinds):
        only = {}
    return [(kind, number) for kind in kinds for number in only.get(kind, numbers)]
