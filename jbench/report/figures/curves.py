"""Learning curves: by representation, by algorithm, on augmented robots, by processor time."""

from collections.abc import Mapping
from functools import partial

import numpy as np
import pandas as pd

from jbench.report import style
from jbench.report.data.configuration import OWN
from jbench.report.figures.chart import Chart, Draw, Panel, numbers
from jbench.report.figures.lines import PUBLISHED, draw_curves
from jbench.report.frames import Frames
from jbench.report.style import Look

_ENOUGH = 5  # evaluations of a curve that is shown instead of training returns
_UNEQUAL = 3  # ratio of lengths from which the axis is logarithmic
_GROUP = ["task", "algo", "words", "source"]
_UNITS = ((7200, 3600, "hours"), (120, 60, "minutes"), (0, 1, "seconds"))


def by_representation(frames: Frames) -> Chart | None:
    """Returns the curves of each task and algorithm with several representations."""
    curves = frames.curves.assign(series=frames.curves["representation"])
    curves = curves[_is_compared(frames)]
    published = frames.published.assign(series=frames.published["representation"])
    looks = style.representation_looks(_pairs(curves, "representation", "kind"))
    return _chart(
        frames,
        "representations",
        "Learning curves by representation",
        curves,
        published,
        looks,
        _GROUP,
    )


def by_algorithm(frames: Frames) -> Chart | None:
    """Returns the curves of each task on the full observation, and those that no figure has."""
    compared = _is_compared(frames)
    curves = frames.curves[(frames.curves["kind"] == "full") | ~compared]
    curves = curves.assign(series=curves["label"].str.replace(" full", "", regex=False))
    # A single curve that the first figure has as well is not drawn again.
    single = curves.groupby("task")["configuration"].transform("nunique") < 2
    curves = curves[~(single & compared.loc[curves.index])]
    published = frames.published[frames.published["kind"] == "full"]
    first = dict(zip(curves["algo"][::-1], curves["series"][::-1], strict=True))
    names = [first.get(algo, algo) for algo in published["algo"]]
    published = published.assign(series=names)
    looks = style.algorithm_looks(_pairs(curves, "series", "algo"))
    title = "Learning curves by algorithm" if curves["series"].nunique() > 1 else "Learning curves"
    return _chart(frames, "algorithms", title, curves, published, looks, ["task"])


def augmented_sequences(frames: Frames) -> Chart | None:
    """Returns the curves of agents that are trained on augmented robots in sequence."""
    rows = frames.sequences
    rows = rows[rows["returns"] == "training"] if not rows.empty else rows
    if rows.empty:
        return None
    own = rows[rows["source"] != PUBLISHED]
    own = own.assign(series=own["algo"] + " " + own["representation"])
    published = rows[rows["source"] == PUBLISHED]
    published = published.assign(series=published["algo"] + " " + published["representation"])
    looks = style.algorithm_looks(_pairs(own, "series", "algo"))
    panels = []
    for task, group in own.groupby("task", sort=False):
        old = published[published["task"] == task]
        draw = partial(
            draw_curves, group, looks=looks, order=numbers(looks), published=old, scale="linear"
        )
        panels.append(Panel(str(task), {"": draw}))
    return Chart(
        "sequences",
        "Augmented robots in sequence",
        "median and 10 to 90% band of training returns; dotted: the paper's",
        panels,
        "sequences",
        looks,
    )


def by_processor_time(frames: Frames) -> Chart | None:
    """Returns the median return against the processor time of a seed."""
    rows = frames.processor
    if rows.empty or rows["configuration"].nunique() < 2:
        return None
    longest = float(rows["seconds"].max())
    size, unit = next((size, unit) for least, size, unit in _UNITS if longest >= least)
    rows = rows.assign(series=rows["label"], steps=rows["seconds"] / size, q10=np.nan, q90=np.nan)
    looks = _configuration_looks(rows)
    panels = [
        Panel(
            str(task),
            {
                "": partial(
                    draw_curves,
                    group,
                    looks=looks,
                    order=numbers(looks),
                    scale="linear" if longest / size < 100 else "log",
                    x=f"{unit} of processor time of a seed",
                )
            },
            (5.2, 2.8),
        )
        for task, group in rows.groupby("task", sort=False)
    ]
    note = "median over seeds; evaluations included"
    return Chart("processor", "Return against processor time", note, panels, "processor", looks)


def _configuration_looks(rows: pd.DataFrame) -> dict[str, Look]:
    """Returns a look for each label: the color is the representation's, the dash the variant's."""
    return style.representation_looks(_pairs(rows, "label", "kind"))


def _pairs(rows: pd.DataFrame, name: str, group: str) -> list[tuple[str, str]]:
    return list(rows[[name, group]].drop_duplicates().itertuples(index=False, name=None))


def _is_compared(frames: Frames) -> pd.Series:
    """Returns whether the configuration of each curve is one of several representations."""
    groups = frames.curves.groupby(_GROUP)["representation"]
    return groups.transform("nunique") > 1


def _chart(
    frames: Frames,
    name: str,
    title: str,
    curves: pd.DataFrame,
    published: pd.DataFrame,
    looks: Mapping[str, Look],
    by: list[str],
) -> Chart | None:
    """Returns curves with a panel for each group; evaluations first if there are enough."""
    if curves.empty:
        return None
    kinds = _kinds(curves, frames.returns)
    ends = curves.groupby(["task", "configuration"])["steps"].max().groupby("task")
    scales = ["linear", "log"]
    nearest = published["steps"].min() / curves["steps"].max() if len(published) else 0
    if (ends.max() / ends.min()).max() > _UNEQUAL or nearest > 1:
        scales.reverse()
    panels = []
    seen_published = False
    groups = curves.groupby(by, sort=False)
    size = (5.6, 2.9) if groups.ngroups < 3 else (4.2, 2.5)
    for key, rows in groups:
        task, algo = rows[["task", "algo"]].iloc[0]
        old = published[published["task"] == task]
        if name == "representations":
            old = old[(old["algo"] == algo) & old["kind"].isin(rows["kind"])]
            # The paper has one reduced observation; it is drawn beside the one of its size.
            old = old[old["series"].isin(rows["series"])]
            old = _one_figure(old, last=False)
        else:
            old = _one_figure(old[old["algo"].isin(rows["algo"])], last=True)
        old = _near(old, rows)
        seen_published |= not old.empty
        common = {
            "looks": looks,
            "order": numbers(looks),
            "published": old,
            "baselines": frames.baselines[frames.baselines["task"] == task],
            "each": frames.run_curves if not frames.run_curves.empty else None,
            "each_seed": frames.request.each_seed,
        }
        panels.append(Panel(_panel_title(key), _versions(rows, kinds, scales, common), size))
    legend = dict(looks)
    if seen_published:
        legend[PUBLISHED] = Look(style.SOFT, style.PUBLISHED_DASH, "")
    band = "10 to 90% band" if curves["q10"].notna().any() else "each seed"
    note = f"median and {band}" + ("; dotted: the paper's" if seen_published else "")
    switches = [(scales[0], scales[1])]
    if len(kinds) > 1:
        switches.insert(0, (kinds[0], kinds[1]))
    return Chart(name, title, note, panels, "curves", legend, switches)


def _panel_title(key: object) -> str:
    words = [str(word) for word in key] if isinstance(key, tuple) else [str(key)]
    return ", ".join(word for word in words if word and word != OWN)


def _kinds(curves: pd.DataFrame, leading: str) -> list[str]:
    """Returns the kinds of return, the one that is shown first in front."""
    points = curves.groupby(["returns", "configuration"])["steps"].size().groupby("returns").max()
    kinds = [kind for kind in (leading, "evaluation", "training") if kind in points.index]
    kinds = list(dict.fromkeys(kinds))
    if kinds[0] == "evaluation" and points["evaluation"] < _ENOUGH:
        kinds.reverse()
    return kinds


def _one_figure(published: pd.DataFrame, *, last: bool) -> pd.DataFrame:
    """Returns the curves of the first or last of the paper's figures that has the algorithm."""
    if published.empty:
        return published
    chosen = published.groupby("algo")["figure"].transform("max" if last else "min")
    return published[published["figure"] == chosen]


def _near(published: pd.DataFrame, rows: pd.DataFrame) -> pd.DataFrame:
    """Returns the published points up to the end of our curves, and at least some."""
    if published.empty:
        return published
    end = max(float(rows["steps"].max()), 2 * float(published["steps"].min()))
    return published[published["steps"] <= end]


def _versions(
    rows: pd.DataFrame, kinds: list[str], scales: list[str], common: Mapping[str, object]
) -> dict[str, Draw]:
    """Returns the drawings of a panel by kind of return and scale of the axis."""
    present = [kind for kind in kinds if (rows["returns"] == kind).any()]
    drawn: dict[str, Draw] = {}
    for kind in present:
        of_kind = rows[rows["returns"] == kind]
        for scale in scales:
            names = f"{kind} {scale}" if len(present) > 1 else scale
            y = f"{kind} return"
            drawn[names] = partial(draw_curves, of_kind, scale=scale, y=y, **common)  # type: ignore[arg-type]
    return drawn
