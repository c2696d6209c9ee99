"""Names that settings, options and files have. No heavy imports, so that help is fast."""

from pathlib import Path
from typing import Literal, get_args

from jbench.task_specs import TASK_SPECS

TASKS = tuple(TASK_SPECS)

DEVICES = ("auto", "cpu", "cuda")
"""Devices; auto is cuda if there is a GPU. `jbench.devices` also knows cuda:0, cuda:1 and so on."""

TimeLimit = Literal["bootstrap", "terminal"]
"""Whether the value of an episode's last state is bootstrapped (truncation) or 0 (terminal)."""

EngineName = Literal["batched", "sb3", "plugin"]
"""Training engines: jbench's (many seeds at a time), stable-baselines3 (one seed at a time), or the
agent of another package (one seed at a time)."""

Precision = Literal["float32", "tf32", "bfloat16"]
"""Precision of the batched engine's matrix products; parameters are float32 in any case."""

SettingsBase = Literal["published", "script", "figure8", "sb3", "suite"]
"""Sources of hyperparameters, of which single ones may then differ (`--settings` and `--set`).

They are Table 1, completed by the numbers of the paper's library (published) or by those of
stable-baselines3 (sb3), the authors' script, which differs from Table 1 (script), an earlier one,
probably that of Figures 7 and 8 (figure8), or jbench's settings for other robots (suite)."""

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


MAX_SEED = 2**63 - 1  # the database stores seeds as signed 64-bit integers
MAX_COUNT = 10**15  # the largest number of control steps that users may type

MAX_SEEDS = 30  # of a configuration with --until-decided, unless another number is typed

PAGE = "index.html"
"""File of a report to open in a browser."""

LISTING = "report.json"
"""File that lists what a report has written, beside its page."""

CHECKPOINT_EVERY = 60.0
"""Minimum seconds between two checkpoints of a run; a kill loses at most this and one episode."""
