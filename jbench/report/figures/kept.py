"""What encoders keep: the share of each feature of the observation in the span of the latents."""

import matplotlib as mpl
import pandas as pd
from matplotlib.axes import Axes

from jbench.report.figures import cells, marks
from jbench.report.figures.chart import ROWS, Chart, by_task
from jbench.report.frames import Frames


def kept(frames: Frames) -> Chart:
    """Returns the share of each feature that encoders of one layer keep, one row per encoder."""
    note = "percentage of each feature that is left in the latents (blank: 100); median over draws"
    panels = by_task(frames.kept, _draw_kept, _size)
    return Chart("kept", "What the encoder keeps", note, panels, **ROWS)


def _size(rows: pd.DataFrame) -> tuple[float, float]:
    """Returns width and height of a panel, in inches, with a row for each representation."""
    return 5.2, 2.1 + 0.24 * rows["representation"].nunique()


def _draw_kept(rows: pd.DataFrame, axes: Axes) -> None:
    """Draws a cell for each representation and feature, with its percentage below 100."""
    features = list(dict.fromkeys(rows["feature"]))
    names = list(dict.fromkeys(rows["representation"]))
    shares = rows.pivot_table(index="representation", columns="feature", values="kept")
    shares = shares.reindex(index=names, columns=features)

    words = [feature.replace("_", " ") for feature in features]
    cells.draw_cells(axes, shares, marks.shortened(names), words, rotation=90)
    size = mpl.rcParams["font.size"] * min(0.9, 13 / len(features))  # two digits fit into a cell
    for row in rows.to_dict("records"):
        if cells.percentage(row["kept"]) != "100":
            cells.write_cell(axes, shares, row["representation"], row["feature"], size=size)
