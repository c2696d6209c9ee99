"""Request for a report."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

from pydantic import Field

from jbench.errors import RequestError
from jbench.names import FIGURE_FORMATS, ORDERS, RETURNS, Order, ReturnsName, known

WINDOW = 100  # episodes in a moving average (paper, Figures 8 and 9)
_EXCLUSIVE = (
    ("compare", "baseline"),
    ("curves", "compare", "baseline", "since", "claims", "reference"),
)


def setting(typed: str) -> tuple[str, str]:
    """Returns the name and value of a setting, typed as it, tables or `--encoder` call it."""
    name, _, value = (piece.strip() for piece in typed.partition("="))
    if name == "encoder" and "/" not in value:  # no id
        return "representation", "full" if value == "none" else value
    by_heading = {"algorithm": "algo", "observation": "representation"}
    return by_heading.get(name, name), value


@dataclass(frozen=True)
class Request:
    """Contents of a report.

    Attributes:
        compare: two results directories, or two selections of settings; see `sources.side`.
        curves: file with the curves of any environment, which is reported instead of results.
        watched: whether the report is rewritten regularly: its page reloads itself, and figures
            have no files of their own.
        command: the command line, which is written into the page.

    A RequestError if a field is invalid.
    """

    task: str | None = None
    algo: str | None = None
    since: Annotated[
        str | None,
        Field(description="only runs that began at this date or later, in UTC, such as 2026-11-21"),
    ] = None
    returns: Annotated[
        ReturnsName,
        Field(
            description="returns that figures and statistics show first: evaluation (deterministic "
            "policy) or training (exploration included)"
        ),
    ] = "evaluation"
    order: Annotated[
        Order,
        Field(
            description="order of smoothing: quantile-first (as Figure 9) or smooth-first (as "
            "Figure 8)"
        ),
    ] = "quantile-first"
    window: Annotated[
        int, Field(description="number of episodes in a moving average; fewer for short runs")
    ] = WINDOW
    claims: Annotated[bool, Field(description="add verdicts on the paper's claims")] = False
    each_seed: Annotated[bool, Field(description="draw every seed as a thin line as well")] = False
    formats: tuple[str, ...] = ("png", "svg")
    columns: Annotated[
        int | None,
        Field(description="draw figures for 1 or 2 columns of a paper (default: for a screen)"),
    ] = None
    reference: Annotated[bool, Field(description="add the runs shipped with jbench")] = False
    baseline: Annotated[
        str | None,
        Field(
            description="draw the imported curves of this algorithm dotted, as published curves are"
        ),
    ] = None
    compare: tuple[str, str] | None = None
    curves: Path | None = None
    watched: bool = False
    command: str = "jbench report"

    def __post_init__(self) -> None:
        known("order", self.order, ORDERS)
        known("kind of return", self.returns, RETURNS)
        if not isinstance(self.window, int) or self.window < 1:
            raise RequestError(f"A window of {self.window} episodes is invalid; type 1 or more.")
        if self.columns not in (None, 1, 2):
            raise RequestError(f"--columns {self.columns}: type 1 or 2.")
        for name in self.formats:
            known("format", name, FIGURE_FORMATS)
        for first, *others in _EXCLUSIVE:
            typed = [name for name in others if getattr(self, name) not in (None, False)]
            if typed and getattr(self, first) is not None:
                raise RequestError(
                    f"--{typed[0]} and --{first} exclude each other; type one of them."
                )
        # An option is read as the second side if that is missing.
        if self.compare and (len({*self.compare}) < 2 or self.compare[1].startswith("--")):
            raise RequestError(
                f"--compare {self.compare[0]}: type two results directories, or two settings such "
                "as engine=sb3 engine=batched."
            )
        self.begun_since()

    @property
    def names_compared(self) -> set[str]:
        """Names of the settings on both sides of a comparison; directories have none."""
        return {
            setting(part)[0]
            for side in self.compare or ()
            if not Path(side).is_dir()
            for part in side.split(",")
        }

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
