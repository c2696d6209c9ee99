"""What to import: the files, their format and columns, and where a seed's number is."""

import hashlib
import re
from codecs import BOM_UTF8
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from pydantic import Field

from jbench.errors import RequestError
from jbench.names import FULL, IMPORT_FORMATS, MAX_SEED, ImportFormat, ReturnsName, in_prose

if TYPE_CHECKING:
    import pandas as pd

MAX_STEPS = 1 << 53
"""Largest number of control steps; float64 counts no further."""

_USED_BY = {
    "tag": ("tensorboard",),
    "steps_column": ("csv", "wandb-csv"),
    "return_column": ("csv", "wandb-csv"),
    "seed_column": ("csv",),
    "returns": ("tensorboard", "wandb-csv", "csv"),
}
"""Formats that use an option; others refuse it."""


_DESCRIPTIONS = {
    "format": f"format of the files: {', '.join(IMPORT_FORMATS)}",
    "algo": "label of the algorithm, such as cleanrl-td3",
    "seed_from": "regular expression that finds the seed in a file's path, or in the name of a run "
    "of W&B; its first group, or the whole match",
    "representation": "label of what the agent observes: full, or one such as dae12",
    "tag": "tensorboard: tag with the returns (default: charts/episodic_return or "
    "rollout/ep_rew_mean)",
    "steps_column": "csv: column with the control steps (default: control_steps, global_step, "
    "timesteps, steps or step; wandb-csv: the first column)",
    "return_column": "csv: column with the returns (default: episode_return, episodic_return, "
    "return or reward); wandb-csv: the metric",
    "seed_column": "csv: column with the seed, instead of --seed-from (default: seed)",
    "returns": "kind of the returns: training or evaluation (default: evaluation if the column or "
    "tag begins with eval, else training)",
}


def _field(name: str, title: str | None = None) -> Any:
    return Field(title=title, description=_DESCRIPTIONS[name])


@dataclass(frozen=True)
class ImportRequest:
    """What to import."""

    format: Annotated[ImportFormat, _field("format", title="from")]
    task: str
    algo: Annotated[str, _field("algo")]
    seed_from: Annotated[str | None, _field("seed_from")] = None
    representation: Annotated[str, _field("representation")] = FULL
    tag: Annotated[str | None, _field("tag")] = None
    steps_column: Annotated[str | None, _field("steps_column")] = None
    return_column: Annotated[str | None, _field("return_column")] = None
    seed_column: Annotated[str | None, _field("seed_column")] = None
    returns: Annotated[ReturnsName | None, _field("returns")] = None

    def __post_init__(self) -> None:
        for name, formats in _USED_BY.items():
            if getattr(self, name) is not None and self.format not in formats:
                option = f"--{name.replace('_', '-')}"
                raise RequestError(
                    f"{option} is for {in_prose(formats)}; leave it out with --from {self.format}."
                )
        given = [self.seed_from, self.seed_column]
        if None not in given or (given == [None, None] and self.format != "csv"):
            raise self.no_seed()
        try:
            re.compile(self.seed_from or "")
        except re.error as error:
            raise RequestError(
                f"--seed-from {self.seed_from}: {error}; type a regular expression such as "
                r"'seed(\d+)'."
            ) from None

    def no_seed(self) -> RequestError:
        """Returns the error for a seed that is given in two places, or in none."""
        more = " or --seed-column NAME" if self.format == "csv" else ""
        return RequestError(
            f"The number of the seed must come from one place: type --seed-from REGEX{more}, "
            r"such as --seed-from 'seed(\d+)'."
        )

    def seed_in(self, text: str, what: str) -> int:
        """Returns the seed that `seed_from` finds in a text, which messages call `what`."""
        match = re.search(self.seed_from or "", text)
        if match is None:
            column = ", or type --seed-column NAME instead" if self.format == "csv" else ""
            raise RequestError(
                f"--seed-from {self.seed_from} finds nothing in {what} {text}; type an expression "
                rf"that matches its seed, such as 'seed(\d+)', or add the seed to the name{column}."
            )
        digits = match[1] if match.re.groups else match[0]
        return parse_seed(digits or "", f"--seed-from {self.seed_from} finds in {what} {text}")

    def returns_kind(self, column: str) -> ReturnsName:
        """Returns the kind of the returns in a column or tag."""
        return self.returns or ("evaluation" if column.startswith("eval") else "training")


def parse_seed(text: str, where: str) -> int:
    """Returns the seed in a text, a whole number; an error begins with `where`."""
    digits = text.lstrip("0") or text[:1]
    if not (digits.isascii() and digits.isdigit() and int(digits[:20]) <= MAX_SEED):
        raise RequestError(
            f"{where} {text[:40]!r}; a seed is a whole number from 0 up to {MAX_SEED}."
        )
    return int(digits)


class ImportedFile(NamedTuple):
    """A file to import, read at once."""

    path: Path
    content: bytes
    sha256: str


class Series(NamedTuple):
    """The learning curve of a seed, or a part of it, in one file; columns are those that were read.

    Points are control_steps and episode_return, and if known episode, length and wall_time; of
    several episodes in one evaluation with the column point. Messages call a row by the name of the
    index and its value, such as `line 3`.
    """

    file: ImportedFile
    seed: int
    returns: ReturnsName
    points: "pd.DataFrame"
    columns: Mapping[str, str] = {}


def open_file(path: Path) -> ImportedFile:
    """Returns a file with its content, which must not be empty."""
    try:
        content = path.read_bytes()
    except IsADirectoryError:
        raise RequestError(f"{path} is a directory; name the files in it.") from None
    except OSError as error:
        raise RequestError(f"{path} can't be read ({error.strerror}).") from None
    if not content.removeprefix(BOM_UTF8).strip():
        raise RequestError(f"{path} is empty; leave the file out.")
    return ImportedFile(path, content, hashlib.sha256(content).hexdigest())
