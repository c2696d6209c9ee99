"""Request for a report."""

import math
import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from jbench.errors import RequestError
from jbench.names import FIGURE_FORMATS, Order, ReturnsName, is_reference
from jbench.representation_names import FULL, NO_ENCODER, kind_in, shown_representation
from jbench.settings.base import Settings
from jbench.settings.code_words import CODE_WORDS
from jbench.typed_values import known

WINDOW = 100  # episodes in a moving average (paper, Figures 8 and 9)
_DATE = r"\d{4}-\d\d-\d\d( \d\d:\d\d)?"
"""When a version of users' code was first used; the time tells versions of one day apart."""

_CODE = re.compile(
    rf"(?P<word>{'|'.join(CODE_WORDS.values())})[ =]+(?P<checksum>[0-9a-f]+)( of {_DATE})?"
)
"""Users' code as names call it, or as a setting: `code 3f2a91 of 2026-11-28`, `code=3f2a91`."""

_DATED_CODE = re.compile(rf"code[ =]+(of )?(?P<date>{_DATE}( \(\d+\))?)")
"""Users' code of records without its checksum, as names call it: `code of 2026-11-28`."""

OF = "of "
"""In place of a checksum of users' code, the beginning of the date of its first record."""

_EXCLUSIVE = (
    ("compare", "baseline", "reference"),
    ("curves", "compare", "baseline", "since", "claims", "reference", "study"),
)
"""An option, and those that have no effect beside it."""


_INSTEAD = {
    ("reference", "compare"): "type --compare results reference to compare your runs with the "
    "shipped ones, or `jbench merge reference` first to compare two settings of both",
}
"""What to type in place of two options that exclude each other."""


def setting(typed: str) -> tuple[str, str]:
    """Returns the name and value of a setting, typed as it, tables or `--encoder` call it.

    Of users' code, the value is the beginning of a checksum, after which a date is not needed; or
    `OF` and the date alone, in names of records without a checksum.
    """
    if match := _DATED_CODE.fullmatch(typed.strip()):
        return "sources", f"{OF}{match['date']}"
    if match := _CODE.fullmatch(typed.strip()):
        (name,) = (field for field, word in CODE_WORDS.items() if word == match["word"])
        return name, match["checksum"]

    typed_name, _, value = (piece.strip() for piece in typed.partition("="))
    name = {"algorithm": "algo", "observation": "representation"}.get(typed_name, typed_name)
    if name == "encoder" and "/" not in value:  # no id
        name = "representation"
    if name == "representation" and value in NO_ENCODER:
        value = FULL
    return name, value


def representations_meant(typed: str, recorded: Iterable[str]) -> list[str]:
    """Returns which of the recorded representations a user means by a name.

    They are those of this whole name, such as planar12, and those that reports show by it, such as
    planar. The name of a kind that is the whole name of none, such as dae, means each
    representation of this kind. `none` is the full observation.
    """
    wanted = FULL if typed.lower() in NO_ENCODER else typed
    named = [name for name in recorded if wanted in (name, shown_representation(name))]
    return named or [name for name in recorded if kind_in(name) == wanted]


def is_directory(side: str) -> bool:
    """Returns whether a side of a comparison is a results directory, or the shipped results."""
    path = Path(side)
    return path.is_dir() or is_reference(path)


def settings_typed(side: str) -> list[str]:
    """Returns the settings of a side of a comparison; a comma in brackets separates none."""
    return [part.strip() for part in re.split(r",(?![^\[]*\])", side)]


def typed_settings(side: str) -> set[tuple[str, str]]:
    """Returns the names and values of the settings of a side; a directory has none."""
    return set() if is_directory(side) else {setting(part) for part in settings_typed(side)}


def names_typed(typed: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Returns the pairs of `--names six-rows=ours`.

    Raises a RequestError if one is none, or if a name of the report is typed twice.
    """
    pairs: dict[str, str] = {}
    for text in typed:
        old, equals, new = (piece.strip() for piece in text.partition("="))
        if not (old and equals and new and new.isprintable()):
            raise RequestError(
                f"--names {text}: type a name of the report and the one to show, such as "
                "--names six-rows=ours."
            )
        if match := re.search(r",([^\s,=]+=.*)", new):
            raise RequestError(
                f"--names {text}: type --names for each name, as in --names "
                f"{text[: -len(match[0])]} --names {match[1]}."
            )

        if old in pairs:
            raise RequestError(
                f"--names {text}: {old} is called {pairs[old]} already; type one name for it."
            )

        pairs[old] = new

    return tuple(pairs.items())


def bounds_typed(typed: Sequence[str]) -> tuple[tuple[str, float, float], ...]:
    """Returns task, lower and higher return of each `--normalize gym:Hopper-v5=0,3000`.

    Names of tasks may have commas and equals signs. Raises a RequestError if a text is none of
    this form, or a task is typed twice.
    """
    bounds: dict[str, tuple[str, float, float]] = {}
    for text in typed:
        task, _, ends = text.rpartition("=")
        try:
            low, high = map(float, ends.split(","))
        except ValueError:
            low = high = math.nan

        if not (task and low < high and math.isfinite(high - low)):
            raise RequestError(
                f"--normalize {text}: type a task and two returns, the lower one first, such as "
                "--normalize gym:Hopper-v5=0,3000."
            )
        if task in bounds:
            raise RequestError(f"--normalize {text}: {task} is typed twice; type it once.")

        bounds[task] = task, low, high

    return tuple(bounds.values())


class Request(Settings):
    """Contents of a report.

    Attributes:
        algo: only these algorithms; all if it is empty.
        compare: two results directories, or two selections of settings; see `sources.side`.
        curves: file or folder with the curves of any environment, reported instead of results.
        normalize: tasks, each with the returns that are 0 and 1 where returns of several tasks are
            normalized; of others they are the lowest and highest that are possible or recorded.
        names: names that a page, figures and tables show, by representation, kind or method.
        table_columns: columns of the LaTeX table of final returns; None: those that fit a column
            of a paper.
        study: matrix files whose comparisons the sequential test decides, too.
        watched: whether the report is rewritten regularly: its page reloads itself, and figures
            have no files of their own.
        command: the command line, which is written into the page.
    """

    task: str | None = None
    algo: tuple[str, ...] = ()
    since: str | None = Field(
        default=None,
        description="only runs that began at this date or later, in UTC, such as 2026-11-21",
    )
    returns: ReturnsName = Field(
        default="evaluation",
        description="returns that figures and statistics show first: evaluation (deterministic "
        "policy) or training (exploration included)",
    )
    order: Order = Field(
        default="quantile-first",
        description="order of smoothing: quantile-first (as Figure 9) or smooth-first (as "
        "Figure 8)",
    )
    window: int = Field(
        default=WINDOW, description="number of episodes in a moving average; fewer for short runs"
    )
    claims: bool = Field(default=False, description="add verdicts on the paper's claims")
    each_seed: bool = Field(default=False, description="draw every seed as a thin line as well")
    formats: tuple[str, ...] = ("png", "svg")
    columns: int | None = Field(
        default=None,
        description="draw figures for 1 or 2 columns of a paper (default: for a screen)",
    )
    reference: bool = Field(default=False, description="add the runs shipped with jbench")
    baseline: str | None = Field(
        default=None,
        description="draw the imported curves of this algorithm dotted, as published curves are",
    )
    published: Literal["yes", "no"] = Field(
        default="yes", description="draw the paper's curves beside yours: yes or no"
    )
    margin: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="difference of final returns that is similar, on tasks whose largest return "
        "is unknown (default: none is)",
    )
    normalize: tuple[tuple[str, float, float], ...] = ()
    names: tuple[tuple[str, str], ...] = ()
    table_columns: tuple[str, ...] | None = None
    compare: tuple[str, str] | None = None
    curves: Path | None = None
    study: tuple[str, ...] = ()
    watched: bool = False
    command: str = "jbench report"

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        """Raises a RequestError if options exclude each other or have impossible values."""
        if self.window < 1:
            raise RequestError(f"A window of {self.window} episodes is invalid; type 1 or more.")
        if self.columns not in (None, 1, 2):
            raise RequestError(f"--columns {self.columns}: type 1 or 2.")

        for name in self.formats:
            known("format", name, FIGURE_FORMATS)

        for first, *others in _EXCLUSIVE:
            typed = [name for name in others if getattr(self, name) not in (None, False, ())]
            if typed and getattr(self, first) is not None:
                instead = _INSTEAD.get((typed[0], first), "type one of them")
                raise RequestError(f"--{typed[0]} and --{first} exclude each other; {instead}.")

        # An option is read as the second side if that is missing.
        if self.compare and (len({*self.compare}) < 2 or self.compare[1].startswith("--")):
            raise RequestError(
                f"--compare {self.compare[0]}: type two results directories, or two settings such "
                "as engine=sb3 engine=batched."
            )

        self.begun_since()
        return self

    @property
    def names_compared(self) -> set[str]:
        """Names of the settings in which two sides differ; directories have none.

        A setting that is typed for both, with the same value, chooses runs of both.
        """
        if self.compare is None:
            return set()

        sides = [typed_settings(side) for side in self.compare]
        return {name for name, _ in sides[0] ^ sides[1]}

    @property
    def filters(self) -> dict[str, Sequence[str]]:
        """The values that runs may have, by the name of a setting; others may have any."""
        filters: dict[str, Sequence[str]] = {}
        if self.task is not None:
            filters["task"] = (self.task,)
        if self.algo:
            filters["algo"] = self.algo

        return filters

    def begun_since(self) -> datetime | None:
        """Returns the earliest beginning of reported runs, or None for all runs."""
        if self.since is None:
            return None

        try:
            time = datetime.fromisoformat(self.since)
        except ValueError:
            raise RequestError(
                f"--since {self.since}: type a date such as 2026-11-21, or a time such as "
                "2026-11-21T18:30."
            ) from None

        return time if time.tzinfo else time.replace(tzinfo=UTC)
