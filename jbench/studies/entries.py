"""The comparisons that the file of a study lists."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from jbench.errors import RequestError
from jbench.names import SettingsBase
from jbench.settings.base import Count, Seed, Settings, validated, whole
from jbench.statistics.sequential import BLOCK
from jbench.statistics.verdicts import ERROR_RATE
from jbench.studies.file import read_file, refusals_named, tables
from jbench.studies.matrix import COMPARISON, encoder_seed

Claim = Literal["a", "c"]
"""What is compared: `FINAL_RETURN` (a) or `SPEED` (c), by the letters of their claims."""

_Count = Annotated[Count, BeforeValidator(whole)]


class SideEncoder(Settings):
    """The table encoder of a side."""

    seed: Annotated[Seed | Literal["each"], BeforeValidator(encoder_seed)]


class Side(Settings):
    """A side of an entry, if it is a table; `docs/deciding.md` explains the keys."""

    representation: str
    settings: SettingsBase | None = None
    hyperparameters: dict[str, Any] = Field(default_factory=dict)
    encoder: SideEncoder | None = None


def _as_side(value: Any) -> Any:
    """Returns a side of a comparison as a table; a text is its representation."""
    return {"representation": value} if isinstance(value, str) else value


_Side = Annotated[Side, BeforeValidator(_as_side, json_schema_input_type=str | Side)]


class Entry(Settings):
    """An entry of the key `comparison` of a file; `docs/deciding.md` explains the keys."""

    task: str
    algo: str
    first: _Side
    second: _Side
    settings: SettingsBase | None = None
    hyperparameters: dict[str, Any] = Field(default_factory=dict)
    steps: _Count | None = None
    claim: Claim = "a"
    share: Annotated[float, Field(gt=0)] = 0.0  # of the error rate; 0 until the rest is divided
    max_seeds: Annotated[_Count, Field(multiple_of=BLOCK)] = 0  # 0 for the usual number
    margin: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.0  # 0 for that of the task


def read_entries(name: str) -> dict[str, Entry]:
    """Returns the comparisons that a file lists, by their names in errors.

    Those without a share of the error rate get equal shares of the rest. Raises a RequestError if
    an entry is invalid, or the shares add up to more than the error rate.
    """
    entries = {}
    for where, table in tables(name, read_file(name), COMPARISON).items():
        with refusals_named(where):
            entries[where] = validated(Entry, f"[[{COMPARISON}]]", **table)

    given = sum(entry.share for entry in entries.values())
    rest = sum(not entry.share for entry in entries.values())
    if given > ERROR_RATE + 1e-9 or (rest and given > ERROR_RATE - 1e-9):
        left = f", and {rest} without a share need a rest" if rest else ""
        raise RequestError(
            f"{name}: the shares of the comparisons add up to {given:g}{left}; together they have "
            f"{ERROR_RATE:g}, so write smaller ones."
        )

    equal = (ERROR_RATE - given) / max(1, rest)
    return {
        where: entry.model_copy(update={"share": entry.share or equal})
        for where, entry in entries.items()
    }
