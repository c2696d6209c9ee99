"""Commands that train encoders: train-dae, train-encoder."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Option

from jbench import names
from jbench.commands import options, parsing
from jbench.commands.output import Output
from jbench.errors import RequestError
from jbench.seeds import parse_numbers, parse_seeds
from jbench.wording import counted, with_results

if TYPE_CHECKING:
    import torch

    from jbench.encoders.settings import EncoderSettings
    from jbench.encoders.states import States
    from jbench.store import Record, Results

_FAR_LESS = 0.1  # of the variance

_TRIAL = 1000  # episodes; who collects fewer first tries what comes next

_TASKS = Option(
    "face_direction",
    help=f"Task of the observations: {', '.join(names.TASKS)}, all (of these), or a task of "
    "another robot (jbench tasks).",
    autocompletion=options.complete_tasks,
)
_LATENTS = Option(
    None,
    help="Number of latents, or several: 2,4,8 or 1-16 (default: 12; some kinds have one size).",
)
_NOISE = Option(None, help="Standard deviation of the noise on scaled features (default: 0.1).")
_EPOCHS = Option(
    None,
    help="Number of passes over the training rows (default: that of the kind, such as dae's 200; "
    "more for a small dataset, so that it has 4,000 updates).",
)
_BATCH = Option(None, help="Minibatch size (default: that of the kind; dae has 8192).")
_RATE = Option(None, help="Learning rate of Adam (default: 1e-3; the authors' script has 5e-4).")
_SEEDS = Option(
    "0",
    help="Random seed of weights, minibatches, noise and the held-out split, or several, such as "
    "0-9: an encoder for each.",
)
_VERBOSE = Option(False, "--verbose", help="Also print the errors as tables.")
_DEVICE = Option(
    "auto",
    help="Device to train on: auto (a GPU if there is one), cpu, cuda or such as cuda:1.",
    autocompletion=options.complete(*names.DEVICES),
)


def train_dae(
    task: str = _TASKS,
    latent: str | None = _LATENTS,
    dataset: str | None = options.DATASET,
    noise: float | None = _NOISE,
    epochs: int | None = _EPOCHS,
    batch: int | None = _BATCH,
    learning_rate: float | None = _RATE,
    seed: str = _SEEDS,
    device: str = _DEVICE,
    verbose: bool = _VERBOSE,
    results: Path = options.RESULTS,
    json: bool = options.JSON,
) -> None:
    """Train the paper's denoising autoencoder on a dataset.

    An interrupted training resumes.
    """
    chosen = {"noise": noise, "epochs": epochs, "batch": batch, "learning_rate": learning_rate}
    _train(["dae"], chosen, task, latent, dataset, seed, device, verbose, results, Output(json))


def train_encoder(
    kind: str = Option(
        "dae",
        help=f"Kind of encoder: {', '.join(names.ENCODER_KINDS)}, one of another package, or "
        "MODULE:CLASS; several: a,b.",
        autocompletion=options.complete(*names.ENCODER_KINDS),
    ),
    task: str = _TASKS,
    latent: str | None = _LATENTS,
    dataset: str | None = options.DATASET,
    noise: float | None = _NOISE,
    horizon: int | None = Option(
        None, help="Control steps ahead that the kind predicts (default: that of the kind)."
    ),
    epochs: int | None = _EPOCHS,
    batch: int | None = _BATCH,
    learning_rate: float | None = _RATE,
    set_: list[str] = Option(
        [], "--set", metavar="NAME=VALUE", help="Set an option of the kind; repeatable."
    ),
    seed: str = _SEEDS,
    device: str = _DEVICE,
    verbose: bool = _VERBOSE,
    results: Path = options.RESULTS,
    json: bool = options.JSON,
) -> None:
    """Train encoders of any kind on a dataset.

    One encoder is trained for each kind and number of latents.
    """
    chosen: dict[str, Any] = {"noise": noise, "horizon": horizon, "epochs": epochs}
    chosen |= {"batch": batch, "learning_rate": learning_rate}
    for name, value in parsing.parse_overrides(set_).items():
        if chosen.get(name) is not None:
            raise RequestError(f"{name} is given twice; type it once.")
        chosen[name] = value
    typed = (
        name.lower() if name.lower() in names.ENCODER_KINDS else name for name in kind.split(",")
    )
    kinds = list(dict.fromkeys(typed))
    _train(kinds, chosen, task, latent, dataset, seed, device, verbose, results, Output(json))


def _train(
    kinds: list[str],
    options: dict[str, Any],
    task: str,
    latent: str | None,
    dataset: str | None,
    seed: str,
    device: str,
    verbose: bool,
    results: Path,
    output: Output,
) -> None:
    """Trains an encoder for each task, seed, kind and number of latents."""
    from jbench.commands import display
    from jbench.datasets import find_dataset
    from jbench.devices import find_device
    from jbench.encoders.settings import encoder_settings, options_with_epochs
    from jbench.encoders.states import States

    database = parsing.results_to_write(results)
    tasks = names.TASKS if task == "all" else (task,)
    train_on = find_device(device)
    given = {name: value for name, value in options.items() if value is not None}
    for name in tasks:  # wrong requests are refused before a dataset is missed
        for kind, size in _sizes(kinds, name, latent):
            encoder_settings(kind, given, task=name, latents=size, dataset="any")
    source = find_dataset(database, dataset, tasks[0])
    planned = [
        encoder_settings(
            kind,
            options_with_epochs(kind, given, source.episodes, number),
            task=name,
            latents=size,
            dataset=source.id,
            seed=number,
        )
        for name in tasks
        for number in parse_seeds(seed)
        for kind, size in _sizes(kinds, name, latent)
    ]
    records = []
    states: States | None = None
    for settings in planned:
        # Kinds share the states, which are read once: they all have the given scale.
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


def _train_one(
    settings: "EncoderSettings",
    states: "States",
    database: "Results",
    device: "torch.device",
    output: Output,
) -> "Record":
    """Trains an encoder and says what was trained, or that it is finished already."""
    from jbench.encoders.training import CHECKPOINT, train_encoder

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


def _sizes(kinds: list[str], task: str, latent: str | None) -> list[tuple[str, int]]:
    """Returns the kinds with their numbers of latents for a task.

    If any kind has several sizes, --latent is ignored for kinds that have only one.
    """
    from jbench.encoders.registry import latent_sizes

    numbers = parse_numbers("--latent", latent or "12", "12, or 2,4,8, or 1-16")
    sizes = {kind: latent_sizes(kind, task) for kind in kinds}
    only = {kind: list(some) for kind, some in sizes.items() if len(some) == 1}
    if latent is not None and len(only) == len(kinds):
        only = {}
    return [(kind, number) for kind in kinds for number in only.get(kind, numbers)]
