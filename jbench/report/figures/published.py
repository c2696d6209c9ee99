"""The paper's curves, and imported ones that are drawn like them, beside those of a panel."""

import pandas as pd
from matplotlib.axes import Axes

from jbench.report import style
from jbench.report.data.curves import beside_which
from jbench.report.data.source_names import IMPORTED
from jbench.report.figures import marks
from jbench.report.style import Look, Looks


def beside_curves(published: pd.DataFrame, rows: pd.DataFrame, name: str) -> pd.DataFrame:
    """Returns the published points beside curves, up to their end, and at least some."""
    asked = published["algo"].isin(rows["algo"]) | (published["source"] == IMPORTED)  # --baseline
    old: pd.DataFrame = published[(published["task"] == rows["task"].iloc[0]) & asked]
    if name == "representations":
        # The paper has one reduced observation; it is drawn beside the one of its size.
        old = old.assign(series=beside_which(old, {*rows["series"]}))
        old = old[old["series"].isin(rows["series"])]
    if old.empty:
        return old

    # Of several of the paper's figures, the first has representations, the last all algorithms.
    figure = old.groupby("algo")["figure"].transform("min" if name == "representations" else "max")
    old = old[old["figure"] == figure]
    end = max(float(rows["steps"].max()), 2 * float(old["steps"].min()))
    return old[old["steps"] <= end]


def draw_published(axes: Axes, published: pd.DataFrame, looks: Looks) -> None:
    """Draws the paper's curves as dots, in the color of the series that they are compared with."""
    entry = Look(style.SOFT, (), "", len(looks))
    for (name, source), curve in published.groupby(["series", "source"], sort=False):
        look = looks.get(str(name), entry)._replace(number=entry.number)
        called = " ".join(curve[["algo", "representation"]].iloc[0])
        curve = curve.iloc[marks.thinned(len(curve), 40)]
        at = curve["steps"].to_numpy()
        median = curve["median"].to_numpy()
        axes.plot(at, median, linestyle=(0, style.PUBLISHED_DASH), **look.ink)
        shown = marks.thinned(len(at), 6)
        tips = [f"{called}, {source}, at {at[i]:,.0f}: {median[i]:.0f}" for i in shown]
        marks.add_points(axes, at[shown], median[shown], tips, look, **marks.UNSEEN)
