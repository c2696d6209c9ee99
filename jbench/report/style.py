"""How series look: a color by kind of representation or by algorithm, dash and mark by variant.

The color-blind tell the first nine kinds apart, and all algorithms (after Okabe and Ito, 2008, and
Tol, 2021). Each color has a contrast of 3 or more with the background of files and of both themes
of the page (WCAG 2.2, 1.4.11), for which some are darker than in those palettes. Representations
and algorithms share no color, so that a color means one thing.
"""

import io
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any, NamedTuple

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure

Dash = tuple[float, ...]  # lengths of dashes and gaps, in widths of the line; solid if empty
_KINDS = {
    "full": "#7a7f87",
    "scaled": "#0072b2",
    "planar": "#009e73",
    "forward": "#1a73e8",
    "random": "#8e5f24",
    "pca": "#d55e00",
    "dae": "#cc79a7",
    "heading": "#8f7be0",
    "raw": "#706a41",
    "ae": "#9c4f96",
    "ddae": "#e7298a",
    "vae": "#7f9a00",
    "lld-vae": "#b15928",
    "dmd": "#b08d57",
    "contrastive": "#c0392b",
    "random-features": "#a38f00",
    "ofe": "#1f8a85",
    "inverse": "#c61d5f",
    "predictive": "#3f7fbf",
}
_OTHER_KINDS = ("#d057ae", "#2e8fd0", "#6b8e23", "#a0522d", "#c71585", "#5f9ea0")
_ALGORITHMS = {"DDPG": "#4477aa", "PPO": "#93980a", "SAC": "#228833", "TD3": "#ee6677"}
_OTHER_ALGORITHMS = ("#845d76", "#4581d3", "#72694d", "#9d69fa", "#ba3f1d", "#08a578", "#808ea7")
_MARKERS = "os^vPXDph<>*d8H"  # of the first series of the colors, in their order
_DASHES: tuple[Dash, ...] = (  # of the other series of a color, the first of which is solid
    (4, 1.6),
    (6, 1.6, 1.2, 1.6),
    (2, 1.2),
    (8, 2),
    (6, 1.4, 1.2, 1.4, 1.2, 1.4),
    (3, 1, 1, 1),
    (10, 2, 3, 2),
)
PUBLISHED_DASH: Dash = (1, 1.6)  # dots, which only the paper's curves have

# Of marks without a color, of texts and axes, and of the grid; a page replaces them.
INK = "#000000"
SOFT = "#6f7a88"
LINE = "#e1e5ea"

_BASE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "text.parse_math": False,
    "pdf.fonttype": 42,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # else all ticks are measured, in case some are above
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": LINE,
    "grid.linewidth": 0.8,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": SOFT,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "legend.frameon": False,
    "svg.hashsalt": "jbench",
}
PAGE: dict[Any, Any] = {  # parameters of matplotlib for a panel of the page; PAPER: for files
    **_BASE,
    "font.size": 9,
    "axes.labelsize": 9,
    "lines.linewidth": 1.8,
    "lines.markersize": 4.5,
    "svg.fonttype": "none",  # the reader's font
}
PAPER: dict[Any, Any] = {
    **_BASE,
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "legend.fontsize": 7.5,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "svg.fonttype": "path",
    "lines.linewidth": 1.2,
    "lines.markersize": 2.8,
}


class Look(NamedTuple):
    """How a series looks; no two of a figure are equal in color and dash."""

    color: str
    dash: Dash = ()
    marker: str = "o"  # another one for each of the first series of a color
    number: int = 0  # of its entry in the legend, by which the page hides it
    hollow: bool = False  # whether its marks are

    @property
    def line(self) -> Any:
        """The dash for matplotlib."""
        return (0, self.dash) if self.dash else "-"

    @property
    def ink(self) -> dict[str, Any]:
        """The color of its lines, and the id of its lines and marks."""
        return {"color": self.color, "gid": f"series-{self.number}"}


Looks = Mapping[str, Look]


def looks(rows: pd.DataFrame, name: str, by: str | None = None) -> dict[str, Look]:
    """Returns the look of each series of rows.

    Series of the same color get different dashes, and other markers than the first. `name` and `by`
    are columns: of the names of series, and of what has a color each, `kind` or one of algorithms.
    """
    by = by or ("kind" if rows["kind"].nunique() > 1 else "algo")
    groups = dict(zip(rows[name], rows[by], strict=True))
    if by == "kind":
        groups = {series: _family(kind) for series, kind in groups.items()}

    colors = _colors([*groups.values()], by)
    places = [*colors]
    order = [*groups]
    if by == "kind":  # the shortest name, such as `dae12` beside `dae12-whitened`, is solid
        order.sort(key=lambda series: (places.index(groups[series]), len(series), series))

    count = Counter[str]()
    chosen = {}
    for number, series in enumerate(order):
        color = colors[groups[series]]
        before = count[color]
        place = places.index(groups[series]) + 4 * before  # neighbors look similar
        marker = _MARKERS[place % len(_MARKERS)]
        chosen[series] = Look(color, _dash(before), marker, number)
        count[color] += 1

    return chosen


def _family(kind: str) -> str:
    """Returns the longest known kind with which a kind begins: `planar` for `planar-mirror`."""
    families = [family for family in _KINDS if f"{kind}-".startswith(f"{family}-")]
    return max(families, key=len, default=kind)


def _colors(groups: Sequence[str], by: str) -> dict[str, str]:
    """Returns the colors of all known kinds or algorithms, and of the new ones among these."""
    known = _KINDS if by == "kind" else _ALGORITHMS
    others = _OTHER_KINDS if by == "kind" else _OTHER_ALGORITHMS
    new = sorted({*groups} - {*known})
    return known | dict(zip(new, cycle(others), strict=False))


def _dash(before: int) -> Dash:
    """Returns the dash of a series, of whose color there are some before; the first is solid."""
    if not before:
        return ()

    # After all dashes were used they are stretched, so that no two are equal.
    turns, index = divmod(before - 1, len(_DASHES))
    return tuple(length * (1 + 0.7 * turns) for length in _DASHES[index])


def image(figure: Figure, ending: str) -> bytes:
    """Returns a figure as a png, svg or pdf file; the same figure gives the same bytes."""
    dates = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": None}
    sink = io.BytesIO()
    with mpl.rc_context(PAPER):
        figure.savefig(sink, format=ending, dpi=200, metadata=dates[ending])
    return sink.getvalue()
