"""What encoders keep: the share of each feature of the observation in the span of the latents."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import colors
from matplotlib.axes import Axes

from jbench.report.figures import marks
from jbench.report.figures.chart import ROWS, Chart, by_task
from jbench.report.frames import Frames

_SHARES = colors.LinearSegmentedColormap.from_list("kept", ["#e08214", "#f3f1ee", "#4d8fc4"])
_DARK = "#1a1f27"  # text on these light colors, in both themes


def kept(frames: Frames) -> Chart:
    """Returns the share of each feature that encoders of one layer keep, one row per encoder."""
    note = "percentage of each feature that is left in the latents (blank: 100); median over draws"
    panels = by_task(frames.kept, _draw_kept, _size)
    return Chart("kept", "What the encoder keeps", note, panels, **ROWS)


def _size(rows: pd.DataFrame) -> tuple[float, float]:
    return 5.2, 2.1 + 0.24 * rows["representation"].nunique()


def _draw_kept(rows: pd.DataFrame, axes: Axes) -> None:
    features = list(dict.fromkeys(rows["feature"]))
    names = list(dict.fromkeys(rows["representation"]))
    share = rows.pivot_table(index="representation", columns="feature", values="kept")
    share = share.reindex(index=names, columns=features)
    axes.pcolormesh(share.to_numpy(), cmap=_SHARES, vmin=0, vmax=1, clip_on=False)

    size = mpl.rcParams["font.size"] * min(0.9, 13 / len(features))  # two digits fit into a cell
    for row in rows.to_dict("records"):
        text = f"{100 * row['kept']:.0f}"
        if text == "100":
            continue
        x = features.index(row["feature"]) + 0.5
        y = names.index(row["representation"]) + 0.5
        axes.text(x, y, text, ha="center", va="center", color=_DARK, size=size)

    axes.set_yticks(np.arange(len(names)) + 0.5, marks.shortened(names))
    words = [feature.replace("_", " ") for feature in features]
    axes.set_xticks(np.arange(len(features)) + 0.5, words, rotation=90)
    axes.set_ylim(len(names), 0)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
