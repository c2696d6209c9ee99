"""Tables of shares from 0 to 1 whose cells are colored, with a percentage in each."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colors
from matplotlib.axes import Axes

_COLORS = colors.LinearSegmentedColormap.from_list("share", ["#e08214", "#f3f1ee", "#4d8fc4"])
_DARK = "#1a1f27"  # text on these light colors, in both themes


def draw_cells(
    axes: Axes,
    shares: pd.DataFrame,
    rows: Sequence[str],
    columns: Sequence[str],
    rotation: float = 0,
) -> None:
    """Draws colored cells, the first row above, and names of rows and columns.

    Args:
        axes: those of a panel.
        shares: a share for each cell, from 0 to 1.
        rows: a name for each row of `shares`.
        columns: likewise.
        rotation: of the names of columns, in degrees.
    """
    axes.pcolormesh(shares.to_numpy(), cmap=_COLORS, vmin=0, vmax=1, clip_on=False)
    axes.set_yticks(np.arange(len(rows)) + 0.5, rows)
    axes.set_xticks(np.arange(len(columns)) + 0.5, columns, rotation=rotation)
    axes.set_ylim(len(rows), 0)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)


def write_cell(axes: Axes, shares: pd.DataFrame, row: Any, column: Any, **font: Any) -> None:
    """Writes the percentage of a cell, whose row and column are labels of `shares`."""
    across: Any = shares.columns.get_loc(column)
    down: Any = shares.index.get_loc(row)
    share: Any = shares.at[row, column]
    text = percentage(float(share))
    axes.text(across + 0.5, down + 0.5, text, ha="center", va="center", color=_DARK, **font)


def percentage(share: float) -> str:
    """Returns a share as the text of its cell."""
    return f"{100 * share:.0f}"
