"""What figures are drawn of: lines, points with tips, rows with names, levels and axes."""

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import takewhile
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.axis import Axis

from jbench.numbers import whole, with_interval
from jbench.report import style
from jbench.report.data.source_names import has_return_range, has_solved_return
from jbench.report.style import Look, Looks
from jbench.task_specs import SOLVED_RETURN

MOST_POINTS = 80  # of a curve that are drawn; a panel of a page is about 300 pixels wide
ROW = 0.24  # height of a row in inches
_NAME_LINE = 0.16  # height of a line of a name of several lines
_ROOM = 0.09  # of the height of a panel, between words beside it
_TIPS = 12  # points of a curve that have a tip, if it has too many for markers
# A mark that only has a tip: its corners, since a circle would take 200 bytes.
UNSEEN: Any = {"marker": [(-1, -1), (1, 1)], "facecolors": "none"}
_DIGITS = 6  # of a tick, beside as many others as matplotlib draws
_ALL_DIGITS = 32  # of the ticks of an axis, if one has more
_LONGEST = 36  # characters of a name in a table of shares, or in a line beside a row
_ALL_LINES = 3 * _LONGEST  # of a name beside a row
_BEFORE = 6
_AFTER = 3  # characters around what differs in long names


def add_points(
    axes: Axes, x: Any, y: Any, tips: Sequence[str], look: Look, size: float = 4.5, **drawn: Any
) -> None:
    """Draws marks of a diameter in points, each with a tip on the page; drawn is for `scatter`."""
    edges = None if look.marker == "|" else "none"
    colors = ("#ffffff", look.color) if look.hollow else (look.color, edges)
    usual = {"marker": look.marker, "facecolors": colors[0], "edgecolors": colors[1]}
    axes.scatter(x, y, s=size**2, urls=list(tips), gid=look.ink["gid"], zorder=3, **usual | drawn)


def add_line(
    axes: Axes, xy: Any, tips: list[str], look: Look, alpha: float = 0.14, step: Any = None
) -> None:
    """Draws a line with a band; if it has few points, with marks, else with some unseen tips.

    xy has columns x, y, and the lower and upper end of the band, if any. step is where a step is,
    as matplotlib's `pre`, `mid` or `post`; None for a line, and only this has marks.
    """
    x, y, *band = np.asarray(xy, float).T
    drawstyle = f"steps-{step}" if step else "default"
    axes.plot(x, y, linestyle=look.line, drawstyle=drawstyle, zorder=2.5, **look.ink)
    if band and np.isfinite(band[0]).any():
        axes.fill_between(x, band[0], band[1], step=step, alpha=alpha, linewidth=0, **look.ink)

    shown = thinned(len(x), _TIPS)
    drawn = UNSEEN if step or len(x) > _TIPS else {}
    texts = [tips[int(i)] for i in shown]
    size = mpl.rcParams["lines.markersize"]
    add_points(axes, x[shown], y[shown], texts, look, size, **drawn)


def named_rows(names: Iterable[str]) -> list[str]:
    """Returns names that stand beside rows, the long ones in several lines."""
    return [_in_lines(name) for name in shortened(names, _ALL_LINES)]


def row_height(names: Iterable[str]) -> float:
    """Returns the inches of a row, in which the longest of these names has room."""
    lines = max((name.count("\n") + 1 for name in named_rows(names)), default=1)
    return max(ROW, _NAME_LINE * lines)


def _in_lines(name: str) -> str:
    """Returns a name with line breaks after spaces, hyphens and points, or anywhere."""
    lines = [""]
    for part in re.findall(rf"[^ .-]{{0,{_LONGEST}}}[ .-]?", name):
        if len(lines[-1]) + len(part) > _LONGEST + 1:  # a space that follows is not seen
            lines.append("")
        lines[-1] += part
    return "\n".join(line.strip() for line in lines)


def add_rows(axes: Axes, rows: pd.DataFrame, looks: Looks, value: str) -> None:
    """Draws a row for each configuration: its name, a number and the interval of this number.

    value is the column of the number; those of its ends are …_low and …_high. The column
    hollow, if any, says which marks are.
    """
    for place, row in enumerate(rows.to_dict("records")):
        look = looks[row["look"]]
        low = row[f"{value}_low"]
        high = row[f"{value}_high"]
        if np.isfinite(low):  # an interval without an upper end reaches the edge
            line: Any = {"linewidth": 2.2, "solid_capstyle": "butt"} | look.ink
            end = high if np.isfinite(high) else 1e6
            axes.plot([low, end], [place, place], **line)

        tip = f"{row['name']}: {interval_text(row[value], low, high)}"
        if "seeds" in row:
            tip += f", n = {row['seeds']}"
        mark = look._replace(hollow=row.get("hollow", False))
        add_points(axes, [row[value]], [place], [tip], mark, 7.5, clip_on=False)

    name_rows(axes, rows["name"])


def interval_text(value: float, low: float, high: float) -> str:
    """Formats a number with its interval, if known."""
    return with_interval(whole, value, (low, high) if np.isfinite(low) else ())


def name_rows(axes: Axes, names: Sequence[str] | pd.Series) -> None:
    """Writes a name beside each row."""
    axes.set_yticks(range(len(names)), named_rows(names))
    axes.set_ylim(len(names) - 0.5, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)


def add_solved(axes: Axes, rows: pd.DataFrame) -> None:
    """Draws the return of a solved task as a vertical line, if the tasks of rows have one."""
    if has_solved_return(rows["task"], rows["source"]):
        axes.axvline(SOLVED_RETURN, color=style.SOFT, linewidth=0.7)


def set_returns(
    axes: Axes, rows: pd.DataFrame, low: float, high: float, name: Literal["x", "y"] = "y"
) -> None:
    """Sets the range of an axis of returns from 0, as far as they reach, or to a solved task's.

    The range of returns that may be anything, as of a file, is matplotlib's. Its ticks
    are written out: a factor such as 1e9 would stand over the title.
    """
    if not has_return_range(rows["task"], rows["source"]):
        axes.ticklabel_format(axis=name, style="plain", useOffset=False)
        digits = len(f"{max(abs(low), abs(high)):.0f}")
        if name == "x" and digits > _DIGITS:
            axes.xaxis.set_major_locator(ticker.MaxNLocator(max(1, _ALL_DIGITS // digits)))
        return

    usual = 1000.0 if has_solved_return(rows["task"], rows["source"]) else 0.0
    top = high * (1.05 if high > usual else 1.0)
    limits = min(0.0, low * 1.05), max(usual, top) or 1.0
    (axes.set_ylim if name == "y" else axes.set_xlim)(*limits)


def set_axes(axes: Axes, rows: pd.DataFrame, scale: str, levels: Sequence[float] = ()) -> None:
    """Sets the ranges and ticks of axes of returns over steps, linear or logarithmic.

    Levels are returns that will have a line, beside all that is drawn.
    """
    drawn = axes.dataLim.intervaly
    low, high = min([*drawn, *levels]), max([*drawn, *levels])
    set_returns(axes, rows, float(low), float(high))
    positive = rows["steps"][rows["steps"] > 0]
    scale = scale if len(positive) else "linear"
    axes.autoscale(axis="x")
    axes.set_xscale(scale)
    if scale == "log":
        axes.set_xlim(left=float(positive.min()) * 0.95)
        widest = 10 if narrow(axes) else 200  # ratio of the ends that leaves room for 1, 2 and 5
        subs = (1, 2, 5) if rows["steps"].max() < widest * positive.min() else (1,)
        axes.xaxis.set_major_locator(ticker.LogLocator(subs=subs, numticks=8))
        axes.xaxis.set_minor_locator(ticker.NullLocator())
    else:
        axes.set_xlim(left=0)
        axes.xaxis.set_major_locator(ticker.MaxNLocator(4 if narrow(axes) else 6))

    axes.xaxis.set_major_formatter(ticker.FuncFormatter(_tick))


def _tick(value: float, _: int | None = None) -> str:
    """Returns a number of steps, or of minutes or hours, beside its tick: `500`, `22.5k`, `0.5`.

    Engineers would write half an hour as 500m, which reads as minutes.
    """
    return f"{value:g}" if abs(value) < 1 else ticker.EngFormatter(sep="")(value)


def set_logarithmic(axes: Axes, name: str) -> None:
    """Makes the x or y axis logarithmic, with plain numbers: texts are not parsed as formulas."""
    (axes.set_xscale if name == "x" else axes.set_yscale)("log")
    axis: Axis = getattr(axes, f"{name}axis")
    axis.set_major_formatter(ticker.StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(ticker.LogFormatter())


def add_levels(axes: Axes, rows: pd.DataFrame, baselines: pd.DataFrame | None) -> None:
    """Draws the mean returns of policies without training and the return of a solved task."""
    solved = has_solved_return(rows["task"], rows["source"])
    levels = {"solved": float(SOLVED_RETURN)} if solved else {}
    if baselines is not None:
        mine = baselines[baselines["task"].isin(rows["task"])]
        levels |= dict(zip(mine["policy"], mine["mean"], strict=True))

    ordered = sorted(levels.items(), key=lambda item: item[1])
    for name, level in ordered:
        dash = "-" if name == "solved" else (0, (3, 2))
        axes.axhline(level, color=style.SOFT, linewidth=0.7, linestyle=dash, zorder=1)

    low, high = axes.get_ylim()  # with the levels: they extend a range that is not set
    place = -np.inf
    for name, level in ordered:
        place = max((level - low) / (high - low), place + _ROOM)
        if not narrow(axes, 1.5):
            size = mpl.rcParams["font.size"] * 0.9
            shown: Any = {"va": "center", "size": size, "color": style.SOFT}
            axes.text(1.02, place, str(name), transform=axes.transAxes, **shown)


def leave_out_empty(axes: Axes) -> None:
    """Fixes the places of labels without a text, which matplotlib would measure every tick for."""
    for axis in (axes.xaxis, axes.yaxis):
        if not axis.get_label_text():
            axis.set_label_coords(0, 0)


def shortened(names: Iterable[str], longest: int = _LONGEST) -> list[str]:
    """Returns names of about as many characters at most, of which different ones differ.

    Names are cut in the middle. Those that would be equal are cut where they are equal: they keep
    what follows their common beginning.
    """
    every = [*names]
    chosen = {name: _cut(name, longest) for name in every}
    for cut, group in _by_value(chosen).items():
        if len(group) > 1:
            start = _equal_characters(group)
            end = _equal_characters([n[::-1] for n in group])
            for name in group:
                kept = name[max(0, start - _BEFORE) : len(name) - max(0, end - _AFTER)]
                kept += "…" if end > _AFTER else ""
                chosen[name] = _cut(f"{cut[:_BEFORE]}…{kept}", longest)

    for cut, group in _by_value(chosen).items():
        if len(group) > 1:
            for i, name in enumerate(group, 1):
                chosen[name] = f"{i}. {cut}"

    return [chosen[name] for name in every]


def _cut(name: str, longest: int) -> str:
    """Returns a name that is cut in the middle if it is longer than this."""
    if len(name) <= longest:
        return name
    return f"{name[: longest * 5 // 9]}…{name[-longest * 5 // 18 :]}"


def _equal_characters(names: Sequence[str]) -> int:
    """Returns with how many equal characters names begin."""
    return sum(
        1 for _ in takewhile(lambda letters: len({*letters}) == 1, zip(*names, strict=False))
    )


def _by_value(names: Mapping[str, str]) -> dict[str, list[str]]:
    """Returns the names that were cut to each text."""
    groups: dict[str, list[str]] = {}
    for name, value in names.items():
        groups.setdefault(value, []).append(name)
    return groups


def narrow(axes: Axes, inches: float = 2.2) -> bool:
    """Returns whether a panel is narrower, as before its labels are placed."""
    return axes.bbox.width < inches * axes.figure.dpi


def thinned(count: int, most: int = MOST_POINTS) -> Any:
    """Returns indices of at most `most` points: half of them equally, half logarithmically."""
    if count <= most:
        return np.arange(count)
    half = most // 2
    equal = np.linspace(0, count - 1, most - half)
    logarithmic = np.geomspace(1, count, half) - 1
    return np.unique(np.concatenate([equal, logarithmic]).round().astype(int))
