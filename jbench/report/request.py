"""What a report is asked to hold."""

from dataclasses import dataclass
from datetime import UTC, datetime

from jbench.errors import RequestError
from jbench.names import FIGURE_FORMATS, ORDERS, RETURNS, Order, ReturnsName
from jbench.report.data.curves import WINDOW


@dataclass(frozen=True)
class Request:
    """What a report is asked to hold.

    Attributes:
        order: of quantiles and smoothing: `quantile-first` (Figure 9) or `smooth-first` (Figure 8).
        window: episodes in a moving average; short runs get less, see `curves.fitting_window`.
        task: report this task only.
        algo: report this algorithm only.
        since: report runs only that were begun then or later: ISO 8601, UTC unless it says else.
        returns: the kind of return that figures and statistics lead with; the other follows.
        claims: whether to give verdicts on the paper's claims.
        each_seed: whether to draw every seed as a thin line, too.
        formats: of the figures' files, of `names.FIGURE_FORMATS`.
        columns: of a paper that the figures are made for, 1 or 2; None for a screen.
        reference: whether to show the runs that are shipped with jbench, too.
        compare: two results directories, or two choices of settings, see `sources.side`.
        watched: whether the report is made again and again, and its page reloads itself.
        command: that asks for this; it is written into the page.

    Raises:
        RequestError: if the order, the window, the date, a format or the columns can't be.
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
    compare: tuple[str, str] | None = None
    watched: bool = False
    command: str = "jbench report"

    def __post_init__(self) -> None:
        """Checks what was asked."""
        if self.order not in ORDERS:
            raise RequestError(f"There is no order {self.order!r}; choose {' or '.join(ORDERS)}.")
        if self.returns not in RETURNS:
            raise RequestError(
                f"There are no returns {self.returns!r}; choose {' or '.join(RETURNS)}."
            )
        if self.window < 1:
            raise RequestError(f"A window of {self.window} episodes is none; choose 1 or more.")
        if self.columns not in (None, 1, 2):
            raise RequestError(f"--columns {self.columns}: type 1 or 2, those of a paper.")
        offered = ", ".join(FIGURE_FORMATS)
        for name in self.formats:
            if name not in FIGURE_FORMATS:
                raise RequestError(f"There is no format {name!r}; choose {offered}.")
        if not self.formats:
            raise RequestError(f"Figures need a format; choose {offered}.")
        if self.compare is not None and self.compare[0] == self.compare[1]:
            raise RequestError(f"--compare {' '.join(self.compare)}: type two that differ.")
        self.begun_since()

    def begun_since(self) -> datetime | None:
        """Returns the time from which on runs are reported, or None for all."""
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
