"""Names that users type. There are no heavy imports here, so help and completion are fast."""

import difflib
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal, TypeVar, get_args

from jbench.errors import RequestError
from jbench.task_specs import TASK_SPECS

_Name = TypeVar("_Name", bound=str)

TASKS = tuple(TASK_SPECS)

_KINDS = {
    "dae": ("autoencoders:DenoisingAutoencoder", "latents of a denoising autoencoder"),
    "dae-yaw": (
        "autoencoders:DenoisingAutoencoderWithYawRate",
        "dae with the yaw rate as a latent",
    ),
    "ae": ("autoencoders:Autoencoder", "latents of an autoencoder"),
    "ddae": (
        "autoencoders:DynamicDenoisingAutoencoder",
        "latents of an autoencoder that predicts the next states",
    ),
    "vae": ("variational:VariationalAutoencoder", "latents of a variational autoencoder"),
    "lld-vae": (
        "variational:LocallyLinearVariationalAutoencoder",
        "vae with locally linear dynamics",
    ),
    "pca": ("linear:PrincipalComponents", "principal components"),
    "random": ("linear:RandomProjection", "random projection"),
    "scaled": ("linear:Scaled", "all features, scaled as encoders scale them"),
    "planar": ("planar:PlanarReduction", "scaled, without position and heading in the plane"),
    "planar-no-yaw": ("planar:PlanarWithoutYawRate", "planar without the yaw rate"),
    "heading": ("planar:HeadingFrame", "planar with position and heading"),
    "raw": ("linear:Raw", "the observation in SI units"),
    "planar-mirror": ("planar:PlanarMirror", "planar, folded by the mirror symmetry"),
    "forward": ("predictive:ForwardModel", "latents that predict the next states and the reward"),
    "inverse": ("predictive:InverseModel", "latents that predict the action"),
    "dmd": ("linear:DynamicModes", "directions of a linear model of the dynamics"),
    "contrastive": (
        "predictive:Contrastive",
        "latents that tell the future of a state from others",
    ),
    "random-features": ("linear:RandomFeatures", "tanh of random directions"),
}
"""Built-in kinds of encoders: the class in jbench.encoders.kinds, and what the latents are."""

ENCODER_KINDS = {kind: f"jbench.encoders.kinds.{path}" for kind, (path, _) in _KINDS.items()}
"""Built-in kinds of encoders and their classes; other packages may add kinds."""

MEANINGS = {
    "full": "the observation of the task",
    **{kind: meaning for kind, (_, meaning) in _KINDS.items()},
    "ofe": "features that are learned with the agent",
    "-without-": "without these features of the observation",
    "-of-": "of these features of the observation",
    "-script": "trained as in the authors' script",
    "-observation": "inputs on the observation's scale",
    "-sd": "inputs scaled to unit variance",
    "-whitened": "latents whitened",
    "-standardized": "latents scaled to mean 0 and standard deviation 1",
    "-extremes": "latents scaled to their extremes",
}
"""What representations and the endings of their names mean, in a few words."""

DEVICES = ("auto", "cpu", "cuda")
"""Devices; auto is cuda if there is a GPU. `jbench.devices` also knows cuda:0, cuda:1 and so on."""

TimeLimit = Literal["bootstrap", "terminal"]
"""Whether the value of an episode's last state is bootstrapped (truncation) or 0 (terminal)."""

EngineName = Literal["batched", "sb3", "plugin"]
"""Training engines: jbench's (many seeds at a time), stable-baselines3 (one seed at a time), or the
agent of another package (one seed at a time)."""

Precision = Literal["float32", "tf32", "bfloat16"]
"""Precision of the batched engine's matrix products; parameters are float32 in any case."""

Base = Literal["published", "script", "figure8", "sb3", "suite"]
"""Sources of hyperparameters: Table 1, completed by the numbers of the paper's library (published)
or by those of stable-baselines3 (sb3), the authors' script, which differs from Table 1 (script), an
earlier one, probably that of Figures 7 and 8 (figure8), or jbench's settings for other robots
(suite)."""

EncoderBase = Literal["script"]
"""Sources of the options of an encoder that is not trained as in the paper's text."""

EncoderSeeds = Literal["newest", "each"]
"""Whether all seeds of an agent have the newest encoder, or each the encoder with its own seed."""

Order = Literal["quantile-first", "smooth-first"]
ORDERS: tuple[Order, ...] = get_args(Order)
"""Whether quantiles across seeds come before the moving average (Figure 9) or after (Figure 8)."""

ReturnsName = Literal["evaluation", "training"]
RETURNS: tuple[ReturnsName, ...] = get_args(ReturnsName)
"""The returns that a run records: deterministic evaluations, and training episodes."""

ImportFormat = Literal["sb3-monitor", "sb3-evaluations", "tensorboard", "wandb-csv", "csv"]
IMPORT_FORMATS: tuple[ImportFormat, ...] = get_args(ImportFormat)

SWEEPS = ("smoke", "fig7", "fig8", "fig9", "question", "authors", "robots")
"""The shipped matrices: a small one, the paper's figures, the comparisons that answer whether
learning on a reduced-order observation helps, the agents of the authors' figures, and the same
question on other robots."""

Status = Literal["unfinished", "finished", "failed"]
STATUSES: tuple[Status, ...] = get_args(Status)

KeepState = Literal["no", "whole", "compact"]  # compact: actions instead of the replay buffer

ExecutorName = Literal["local", "ray"]

LoggerName = Literal["tensorboard", "wandb", "trackio"]
LOGGERS: tuple[LoggerName, ...] = get_args(LoggerName)

FIGURE_FORMATS = ("png", "svg", "pdf")

HEURISTIC = "heuristic"  # the hand-written policies of all tasks

POLICIES = (HEURISTIC, "random", "constant")
"""Policies of jbench that are not trained; constant:U is a constant command."""

RESULTS = "results"
REFERENCE = "reference"  # value of `--results` for the results shipped with jbench
SHIPPED_RESULTS = Path(__file__).with_name(REFERENCE)
"""The results directory in the package; in a checkout, results/reference is a link to it."""

POLICY_FILES = ("policy.safetensors", "policy.json")
"""Files of a run's kept policy: its weights and its layers."""

ENCODER_FILES = ("encoder.safetensors", "encoder.json")
"""Files of a finished encoder: its weights and its description."""

POLICY_NAMES = (
    f"{HEURISTIC}, random, constant:U with U in [-1, 1], the id of a run, {REFERENCE}/ID of a run "
    "that is shipped with jbench, the FILE.zip of a stable-baselines3 model, an installed policy, "
    "or MODULE:NAME"
)


def is_reference(path: Path) -> bool:
    """Returns whether `--results` means the shipped results; your own `reference` wins."""
    if path.exists():
        return path.resolve() == SHIPPED_RESULTS.resolve()
    return path == Path(REFERENCE)


FULL = "full"  # representation of an agent without an encoder
NO_ENCODER = ("none", FULL)  # values of `--encoder` for such an agent
OFE = "ofe"  # prefix of the representation if features are learned with the agent, such as ofe12

_SCALES = "observation|sd"
_RESCALES = "whitened|standardized|extremes"

REPRESENTATION = re.compile(
    r"(?P<kind>[a-z][a-z0-9-]*?):?(?P<latents>[0-9]+)?(?P<endings>"
    r"(?:-(?P<features>(?:without|of)-[A-Za-z0-9_.]+|features-[0-9a-f]{8}))?"
    r"(?:-(?P<base>script))?"
    # Only after a number of latents: planar-no-yaw is a kind.
    rf"(?(latents)(?P<options>(?:-(?!(?:{_SCALES}|{_RESCALES})\b)[a-z_]+-[A-Za-z0-9_.]+)*))"
    rf"(?:-(?P<scale>{_SCALES}))?(?:-(?P<rescale>{_RESCALES}))?)"
)
"""A representation: a kind of encoder, its number of latents, and what is not the default: features
of the observation, training, options and scales, such as dae12, dae12-noise-0.2 or
dae12-observation-whitened."""


def features_in(representation: str) -> str:
    """Returns which features of the observation a representation is of: "" for all.

    Those of dae8-without-velocity and of raw10-without-velocity are without-velocity.
    """
    match = REPRESENTATION.fullmatch(representation)
    return "" if match is None else match["features"] or ""


# Kinds whose number of latents follows from the task, so that names leave it out.
_SIZE_OF_TASK = ("scaled", "planar", "planar-no-yaw", "planar-mirror", "heading", "raw")


def kind_in(representation: str) -> str:
    """Returns the kind of a representation, such as `scaled` for scaled16."""
    match = REPRESENTATION.fullmatch(representation)
    return representation.rstrip("0123456789") if match is None else match["kind"]


def shown_representation(representation: str) -> str:
    """Returns a representation's name, without a size that the task determines."""
    match = REPRESENTATION.fullmatch(representation)
    if match is None or match["kind"] not in _SIZE_OF_TASK:
        return representation
    return match["kind"] + match["endings"]


MAX_SEED = 2**63 - 1  # the database stores seeds as signed 64-bit integers
MAX_COUNT = 10**15  # the largest number of control steps that users may type

MAX_SEEDS = 30  # of a configuration with --until-decided, unless another number is typed

PAGE = "index.html"
"""File of a report to open in a browser."""

LISTING = "report.json"
"""File that lists what a report has written, beside its page."""

CHECKPOINT_EVERY = 60.0
"""Minimum seconds between two checkpoints of a run; a kill loses at most this and one episode."""


def known(what: str, value: str, names: Sequence[_Name]) -> _Name:
    """Returns the value if it is one of the names; raises a RequestError that lists them if not."""
    for name in names:
        if name == value:
            return name
    close = closest(value, names)
    hint = f"did you mean {close}? Choose" if close else "choose"
    raise RequestError(f"Unknown {what} {value!r}; {hint} {in_prose(names)}.")


def shown_as(shortened: str, names: Iterable[str]) -> list[str]:
    """Returns the names that a table shows as a text with … in place of a part; else none."""
    if "…" not in shortened:
        return []
    pattern = ".*".join(map(re.escape, shortened.split("…")))
    return [name for name in names if re.fullmatch(pattern, name)]


def closest(value: str, names: Sequence[str]) -> str | None:
    """Returns the name that was probably meant, also by its initials: lr is learning_rate."""
    # As stable-baselines3 describes the networks.
    if value in ("net_arch", "policy", "policy_kwargs") and "hidden_layers" in names:
        return "hidden_layers"
    by_initials = {"".join(word[:1] for word in name.split("_")): name for name in names}
    close = difflib.get_close_matches(str(value).lower(), names, 1)
    return by_initials.get(value) or next(iter(close), None)


def in_prose(names: Iterable[str], word: str = "or") -> str:
    """Returns names as a list in prose: `a, b or c`."""
    *others, last = names
    return f"{', '.join(others)} {word} {last}" if others else last


def parse_numbers(
    text: str, option: str = "--seeds", example: str = "seeds like 0-9, or 0,2,5-7"
) -> list[int]:
    """Returns the whole numbers of a text like 0-9 or 0,2,5-7, each once, in order.

    Raises a RequestError, which names option and example, if it is not such a text.
    """
    numbers: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"(\d{1,19})(?:-(\d{1,19}))?", part.strip())
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, -1)
        if not 0 <= last - first < 10_000:  # more is a typing error
            raise RequestError(f"{option} {text}: type {example}.")
        numbers.update(range(first, last + 1))
    return sorted(numbers)


def in_ranges(numbers: Iterable[int]) -> str:
    """Returns whole numbers in the form that `parse_numbers` reads, such as 0-4,7."""
    ranges: list[list[int]] = []
    for number in sorted(numbers):
        if ranges and number == ranges[-1][-1] + 1:
            ranges[-1] = [ranges[-1][0], number]
        else:
            ranges.append([number])
    return ",".join("-".join(map(str, ends)) for ends in ranges)
