"""Learning curves: by representation, by algorithm, on augmented robots, by processor time."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from jbench.report import style
from jbench.report.data.source_names import (
    FILE,
    IMPORTED,
    OWN,
    PUBLISHED,
    begins_with_source,
)
from jbench.report.figures import marks
from jbench.report.figures.chart import Chart, Draw, Panel, by_task
from jbench.report.figures.published import beside_curves, draw_published
from jbench.report.frames import Frames
from jbench.report.style import Look, Looks
from jbench.returns import EVALUATION, TRAINING

_DOTTED = {PUBLISHED: "published, training", IMPORTED: "imported"}  # curves of dots in legends
_UNEQUAL = 3  # ratio of lengths from which the axis is logarithmic
_GROUP = ["task", "algo", "words", "source"]
_CURVE = ["configuration", "returns"]  # columns that name a curve, and the seeds that it is of
_LONGER = 1.02  # ratio of the ends of a seed and of a curve from which the seed is drawn on
_UNITS = ((7200, 3600, "hours"), (120, 60, "minutes"), (0, 1, "seconds"))


@dataclass(frozen=True)
class _Beside:
    """What is drawn beside the medians of a panel.

    Attributes:
        published: points of the paper's curves, with a column `series`; drawn as dots.
        seeds: points of single seeds by `_CURVE`, drawn as thin lines.
        policies: returns of policies without training, drawn as levels.
    """

    published: pd.DataFrame | None = None
    seeds: Mapping[Any, pd.DataFrame] = field(default_factory=dict)
    policies: pd.DataFrame | None = None


_NOTHING = _Beside()


def drawn_points(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns the points of curves that are drawn, at most `MOST_POINTS` of each."""
    curves = rows.groupby(_CURVE).indices.values()
    kept = [places[marks.thinned(len(places))] for places in curves]
    return rows.iloc[np.sort(np.concatenate(kept))] if kept else rows


def by_representation(frames: Frames) -> Chart | None:
    """Returns the curves of each task and algorithm with several representations."""
    points = _without_sides(drawn_points(frames.curves))
    curves = points.assign(series=points["representation"])[_is_compared(points)]
    published = frames.published.assign(series=frames.published["representation"])
    looks = style.looks(curves, "series", "kind")
    title = "Learning curves by representation"
    return _chart(frames, "representations", title, curves, published, looks, _GROUP)


def by_algorithm(frames: Frames) -> Chart | None:
    """Returns the curves of each task on the full observation, and those that no figure has."""
    points = _without_sides(drawn_points(frames.curves))
    compared = _is_compared(points)
    curves = points[(points["kind"] == "full") | ~compared]
    short = curves["label"].str.replace(" full", "", regex=False)
    curves = curves.assign(series=short.where(curves["kind"] == "full", curves["label"]))
    # A single curve that the first figure has as well is not drawn again.
    single = curves.groupby("task")["configuration"].transform("nunique") < 2
    curves = curves[~(single & compared.loc[curves.index])]
    published = frames.published[frames.published["kind"] == "full"]
    first = dict(zip(curves["algo"][::-1], curves["series"][::-1], strict=True))
    published = published.assign(series=[first.get(algo, algo) for algo in published["algo"]])
    looks = style.looks(curves, "series", "algo")
    title = "Learning curves by algorithm" if curves["series"].nunique() > 1 else "Learning curves"
    return _chart(frames, "algorithms", title, curves, published, looks, ["task"])


def augmented_sequences(frames: Frames) -> Chart:
    """Returns the curves of agents that are trained on augmented robots in sequence."""
    points = drawn_points(frames.sequences)
    rows = points[points["returns"] == TRAINING]
    rows = rows.assign(series=rows["algo"] + " " + rows["representation"])
    theirs = rows["source"] == PUBLISHED
    looks = style.looks(rows[~theirs], "series", "algo")
    beside = _Beside(published=rows[theirs])
    panels = by_task(rows[~theirs], partial(_draw_curves, looks=looks, beside=beside))
    note = "training returns: median and 10 to 90% of seeds; dotted: the paper's"
    return Chart("sequences", "Augmented robots in sequence", note, panels, looks)


def by_processor_time(frames: Frames) -> Chart | None:
    """Returns the median return against the processor time of a seed."""
    rows = drawn_points(frames.processor)
    if rows["configuration"].nunique() < 2:
        return None

    longest = float(rows["seconds"].max())
    size, unit = next((size, unit) for least, size, unit in _UNITS if longest >= least)
    rows = rows.assign(series=rows["label"], steps=rows["seconds"] / size, q10=np.nan, q90=np.nan)
    looks = style.looks(rows, "series", "kind")
    x = f"{unit} of processor time of a seed"
    y = f"{frames.returns} return"
    scale = "linear" if longest / size < 100 else "log"
    panels = by_task(rows, partial(_draw_curves, looks=looks, x=x, y=y, scale=scale), (5.2, 2.8))
    note = "median over seeds, where all runs recorded their processor time"
    return Chart("processor", "Return against processor time", note, panels, looks)


def _without_sides(points: pd.DataFrame) -> pd.DataFrame:
    """Returns points of one source, where names do not say from which side of a comparison."""
    sources = points["source"]
    is_apart = [
        source == FILE or begins_with_source(label, source)
        for label, source in zip(points["label"], sources, strict=True)
    ]
    return points.assign(source=sources.where(np.array(is_apart, bool), OWN))


def _is_compared(curves: pd.DataFrame) -> pd.Series:
    """Returns for each row whether its panel shows several representations."""
    compared: pd.Series = curves.groupby(_GROUP)["representation"].transform("nunique") > 1
    return compared


def _chart(
    frames: Frames,
    name: str,
    title: str,
    curves: pd.DataFrame,
    published: pd.DataFrame,
    looks: Looks,
    by: list[str],
) -> Chart | None:
    """Returns a chart with a panel for each group of curves, over linear and logarithmic steps."""
    if curves.empty:
        return None

    kinds = _kinds(curves, frames.returns)
    ends = curves.groupby(["task", "configuration"])["steps"].max().groupby("task")
    scales = ["linear", "log"]
    nearest = published["steps"].min() / curves["steps"].max() if len(published) else 0
    if (ends.max() / ends.min()).max() > _UNEQUAL or nearest > 1:
        scales.reverse()

    panels = []
    sources = set[str]()
    is_longer = _have_longer_seeds(frames.run_curves, curves)
    seeds = _thin_lines(frames, curves, is_longer)
    groups = curves.groupby(by, sort=False)
    # A single panel has the width of the page.
    size = {1: (9.6, 3.0), 2: (5.6, 2.9)}.get(groups.ngroups, (4.2, 2.5))
    for key, rows in groups:
        old = beside_curves(published, rows, name)
        sources.update(old["source"])
        beside = _Beside(old, seeds, frames.baselines)
        draw = partial(_draw_curves, looks=looks, beside=beside)
        versions: dict[str, Draw] = {}
        shown = [kind for kind in kinds if (rows["returns"] == kind).any()]
        for kind in shown:
            # Of which kind the returns of a file are is not known.
            what = "return" if FILE in {*rows["source"]} else f"{kind} return"
            mine = rows[rows["returns"] == kind]
            first, other = (f"{kind} {scale}" if len(shown) > 1 else scale for scale in scales)
            versions[first] = partial(draw, mine, scale=scales[0], y=what)
            versions[other] = partial(marks.set_axes, rows=mine, scale=scales[1])

        words = [str(word) for word in key if word and word != OWN]
        panels.append(Panel(", ".join(words), versions, size))

    dots = " and ".join(name for source, name in _DOTTED.items() if source in sources)
    dotted = Look(style.SOFT, style.PUBLISHED_DASH, "", len(looks))
    legend = {**looks, **({dots: dotted} if dots else {})}
    band = "10 to 90% of seeds" if curves["q10"].notna().any() else "each seed"
    note = f"median and {band}"
    if frames.interpolated:
        is_all = frames.interpolated.issuperset(kinds)
        which = "" if is_all else f" {' and '.join(frames.interpolated)} returns of"
        note += f";{which} seeds logged at different steps are interpolated"
    if any(is_longer.values()):
        note += "; thin: single seeds after the last step that every seed has reached"

    switches = [pair for pair in (kinds, scales) if len(pair) > 1]
    return Chart(name, title, note, panels, legend, switches, data="curves")


def _have_longer_seeds(seeds: pd.DataFrame, curves: pd.DataFrame) -> dict[Any, bool]:
    """Returns whether a seed of a curve is clearly longer than the curve, by `_CURVE`."""
    ends = curves.groupby(_CURVE, sort=False)["steps"].max()
    last = seeds.groupby(_CURVE, sort=False)["steps"].max().reindex(ends.index)
    return (last > _LONGER * ends).to_dict()


def _thin_lines(
    frames: Frames, curves: pd.DataFrame, is_longer: Mapping[Any, bool]
) -> dict[Any, pd.DataFrame]:
    """Returns the points of single seeds that are drawn as thin lines, by `_CURVE`.

    All are, where there are too few seeds for a band or a reader asks for them. Else they are drawn
    where they go on after the end of their curve, which is that of the shortest seed.
    """
    seeds = dict(iter(frames.run_curves.groupby(_CURVE, sort=False)))
    lines: dict[Any, pd.DataFrame] = {}
    for key, curve in curves.groupby(_CURVE, sort=False):
        if key not in seeds or curve["seeds"].iloc[0] < 2:
            continue
        if frames.request.each_seed or curve["q10"].isna().all():
            lines[key] = seeds[key]
        elif is_longer[key]:
            lines[key] = _after(seeds[key], float(curve["steps"].max()))

    return lines


def _after(seeds: pd.DataFrame, end: float) -> pd.DataFrame:
    """Returns the points after the end of a curve, of the single seeds that are clearly longer."""
    last = seeds.groupby("run")["steps"].transform("max")
    return seeds[(last > _LONGER * end) & (seeds["steps"] >= end)]


def _kinds(curves: pd.DataFrame, leading: str) -> list[str]:
    """Returns the kinds of return that there are, that of the tables first."""
    kinds = dict.fromkeys((leading, EVALUATION, TRAINING))
    return [kind for kind in kinds if (curves["returns"] == kind).any()]


def _draw_curves(
    rows: pd.DataFrame,
    axes: Axes,
    *,
    looks: Looks,
    beside: _Beside = _NOTHING,
    scale: str = "linear",
    x: str = "control steps",
    y: str = "return",
) -> None:
    """Draws the curves of a panel, of one kind of return; their points have a column `series`."""
    if axes.has_data():  # of another kind of return
        axes.clear()

    alpha = 0.16 if rows["series"].nunique() < 5 else 0.1
    for (name, _), curve in rows.groupby(["series", "configuration"], sort=False):
        look = looks[str(name)]
        line = curve[["steps", "median", "q10", "q90"]]
        marks.add_line(axes, line, _tips(str(name), curve), look, alpha)
        thin = {"alpha": 0.5, "linewidth": mpl.rcParams["lines.linewidth"] / 2} | look.ink
        seeds = beside.seeds.get(tuple(curve[_CURVE].iloc[0]))
        if seeds is not None:
            for _, seed in seeds.groupby("run", sort=False):
                axes.plot(seed["steps"], seed["value"], **thin)

    if beside.published is not None:
        draw_published(axes, beside.published[beside.published["task"].isin(rows["task"])], looks)

    policies = beside.policies
    levels = () if policies is None else policies["mean"][policies["task"].isin(rows["task"])]
    marks.set_axes(axes, rows, scale, [*levels])
    axes.set(xlabel=x, ylabel=y)
    marks.add_levels(axes, rows, policies)


def _tips(name: str, curve: pd.DataFrame) -> list[str]:
    """Returns the text that the page shows at each point of a curve."""
    numbers = curve.reindex(columns=["steps", "median", "q10", "q90", "seeds"]).to_numpy(float)
    return [
        f"{name} at {f'{at:,.0f}' if at >= 100 else f'{at:.3g}'}: "
        + marks.interval_text(median, low, high)
        + ("" if np.isnan(count) else f", n = {count:.0f}")
        for at, median, low, high, count in numbers.tolist()
    ]
