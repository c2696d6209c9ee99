"""Request for a report."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from jbench.errors import RequestError
from jbench.names import FIGURE_FORMATS, ORDERS, RETURNS, Order, ReturnsName, known

WINDOW = 100
"""Episodes in a moving average (paper, Figures 8 and 9)."""

_EXCLUSIVE = (
    ("compare", "baseline"),
    ("curves", "compare", "baseline", "since", "claims", "reference"),
)

_HEADINGS = {"algorithm": "algo", "observation": "representation"}
"""Settings by what tables call them."""


def setting(typed: str) -> tuple[str, str]:
    """Returns the name and value of a setting, typed as it, tables or `--encoder` call it."""
    name, _, value = (piece.strip() for piece in typed.partition("="))
    if name == "encoder" and "/" not in value:  # no id
        return "representation", "full" if value == "none" else value
    return _HEADINGS.get(name, name), value


@dataclass(frozen=True)
class Request:
    """Contents of a report.

    Attributes:
        order: `quantile-first` (Figure 9) or `smooth-first` (Figure 8).
        window: episodes in a moving average; fewer for short runs, see `curves.fitting_window`.
        task: report only this task.
        algo: report only this algorithm.
        since: report only runs begun at this time or later (ISO 8601, UTC by default).
        returns: kind of return that figures and statistics show first.
        claims: whether to give verdicts on the paper's claims.
        each_seed: whether to draw every seed as a thin line as well.
        formats: of the figures, from `names.FIGURE_FORMATS`.
        columns: width of the figures in columns of a paper, 1 or 2; None for a screen.
        reference: whether to add the runs shipped with jbench.
        baseline: algorithm whose imported curves are drawn as published ones, or None.
        compare: two results directories, or two selections of settings; see `sources.side`.
        curves: file with the curves of any environment, which is reported instead of results.
        watched: whether the report is rewritten regularly: its page reloads itself, and figures
            have no files of their own.
        command: the command line, which is written into the page.

    Raises:
        RequestError: if the order, window, date, a format or the columns are invalid.
    """

    order: Order = "quantile-first"
    window: int = WINDOW
    task: str | None = None
    algo: str | None = None
    since: str | None = None
    returns: ReturnsName = "evaluation"
    claims: bool = False
    each_seed: bool = False
    formats: tuple[str, ...] = ("png", "svg")
    columns: int | None = None
    reference: bool = False
    baseline: str | None = None
    compare: tuple[str, str] | None = None
    curves: Path | None = None
    watched: bool = False
    command: str = "jbench report"

    def __post_init__(self) -> None:
        """Checks the fields."""
        known("order", self.order, ORDERS)
        known("kind of return", self.returns, RETURNS)
        if not isinstance(self.window, int) or self.window < 1:
            raise RequestError(f"A window of {self.window} episodes is invalid; type 1 or more.")
        if self.columns not in (None, 1, 2):
            raise RequestError(f"--columns {self.columns}: type 1 or 2.")
        for name in self.formats:
            known("format", name, FIGURE_FORMATS)
        if not self.formats:
            raise RequestError(f"Figures need a format; choose {', '.join(FIGURE_FORMATS)}.")
        for first, *others in _EXCLUSIVE:
            typed = [name for name in others if getattr(self, name) not in (None, False)]
            if typed and getattr(self, first) is not None:
                raise RequestError(
                    f"--{typed[0]} and --{first} exclude each other; type one of them."
                )
        if self.compare is not None and self.compare[0] == self.compare[1]:
            raise RequestError(f"--compare {' '.join(self.compare)}: type two different ones.")
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
