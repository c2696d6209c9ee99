"""Encoders: errors, what latents predict, and the returns of agents that observe them."""

from collections.abc import Mapping
from functools import partial

import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes

from jbench.report import style
from jbench.report.figures.chart import Chart, Panel, add_points, numbers, series, shortened
from jbench.report.frames import Frames
from jbench.report.style import Look

_FLOOR = 1e-3
"""Smaller fractions of unexplained variance are drawn here."""

_QUANTITIES = {
    "yaw_rate": "yaw rate",
    "forward_speed": "forward speed",
    "tilt_rate": "tilt rate",
    "reward": "reward",
}
_ROW = 0.25  # inches


def errors(frames: Frames) -> Chart | None:
    """Returns the errors: against the number of latents if sizes differ, else a row an encoder."""
    rows = frames.encoders
    if len(rows) < 2:
        return None
    rows = _named(rows)
    looks = _looks(rows)
    panels = []
    for task, group in rows.groupby("task", sort=False):
        sizes = group.groupby("series")["latents"].nunique().max()
        if sizes > 1:
            draw, size = partial(draw_errors, group, looks=looks), (4.2, 2.6)
        else:
            draw = partial(draw_error_rows, group, looks=looks)
            size = (5.2, 0.7 + _ROW * len(group))
        panels.append(Panel(str(task), {"": draw}, size))
    note = "filled: held-out episodes of the dataset; hollow: episodes of the hand-written policy"
    return Chart(
        "encoders", "Reconstruction error by encoder", note, panels, "encoders", looks, columns=2,
        alike=False, minimum=400,
    )  # fmt: skip


def _named(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns the rows with a column `series`: kind and variant, without the number of latents."""
    return rows.assign(series=(rows["kind"] + " " + rows["settings"].fillna("")).str.strip())


def _looks(rows: pd.DataFrame) -> dict[str, Look]:
    named = rows[["series", "kind"]].drop_duplicates()
    return style.representation_looks(list(named.itertuples(index=False, name=None)))


def draw_errors(rows: pd.DataFrame, axes: Axes, *, looks: Mapping[str, Look]) -> None:
    """Draws the unexplained variance against the number of latents.

    Args:
        rows: rows of `frames.encoders` of one task, with a column `series`.
    """
    order = numbers(looks)
    for name, group in rows.groupby("series", sort=False):
        look, number = looks[str(name)], order[str(name)]
        for column, hollow in (("test", False), ("heuristic", True)):
            group = group.sort_values("latents")
            y = group[column].clip(lower=_FLOOR)
            axes.plot(
                group["latents"], y, color=look.color, linestyle=look.linestyle,
                linewidth=0.8 if hollow else 1.6, gid=series(number),
            )  # fmt: skip
            tips = [
                f"{name}, {latents} latents: {value:.3g}"
                for latents, value in zip(group["latents"], group[column], strict=True)
            ]
            add_points(axes, group["latents"], y, tips, look, number, size=5, hollow=hollow)
    axes.set(xlabel="latents", ylabel="variance not explained", yscale="log")
    axes.xaxis.set_major_locator(ticker.MaxNLocator(integer=True))


def draw_error_rows(rows: pd.DataFrame, axes: Axes, *, looks: Mapping[str, Look]) -> None:
    """Draws the unexplained variance of each encoder, if all sizes are alike.

    Args:
        rows: rows of `frames.encoders` of one task, with a column `series`.
    """
    order = numbers(looks)
    names = (rows["representation"] + " " + rows["settings"].fillna("")).str.strip().tolist()
    for column, hollow in (("test", False), ("heuristic", True)):
        for place, row in enumerate(rows.to_dict("records")):
            if np.isfinite(row[column]):
                look, value = looks[row["series"]], row[column]
                tip = f"{names[place]}: {value:.3g} not explained"
                at, number = [max(value, _FLOOR)], order[row["series"]]
                add_points(axes, at, [place], [tip], look, number, size=6.5, hollow=hollow)
    axes.set_xscale("log")
    axes.set_yticks(range(len(names)), [shortened(name) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("fraction of the variance not explained")
    axes.xaxis.set_major_formatter(ticker.StrMethodFormatter("{x:g}"))


def predictions(frames: Frames) -> Chart | None:
    """Returns final returns against what latents predict of the next control step."""
    rows = frames.predictions
    if rows.empty:
        return None
    rows = rows.assign(series=rows["representation"])
    named = rows[["series", "kind"]].drop_duplicates()
    looks = style.representation_looks(list(named.itertuples(index=False, name=None)))
    panels = []
    for (task, algo), group in rows.groupby(["task", "algo"], sort=False):
        if group["configuration"].nunique() < 3:
            continue
        for quantity, points in group.groupby("quantity", sort=False):
            draw = partial(draw_predictions, points, looks=looks, x=f"R² of the {quantity}")
            panels.append(Panel(f"{task}, {algo}", {"": draw}, (3.2, 2.3)))
    if not panels:
        return None
    note = "interquartile mean with 95% interval against R² one step ahead; correlation only"
    return Chart(
        "predictions", "Return against what latents predict", note, panels, "predictions", looks,
        columns=4, alike=False, minimum=260,
    )  # fmt: skip


def draw_predictions(
    rows: pd.DataFrame, axes: Axes, *, looks: Mapping[str, Look], x: str = "R²"
) -> None:
    """Draws final returns against an R².

    Args:
        rows: rows of `frames.predictions` of one task, algorithm and quantity.
    """
    order = numbers(looks)
    for row in rows.to_dict("records"):
        look, number = looks[row["series"]], order[row["series"]]
        at = max(row["r2"], 0.0)
        if np.isfinite(row["low"]):
            axes.plot(
                [at, at], [row["low"], row["high"]], color=look.color, linestyle="-",
                gid=series(number),
            )  # fmt: skip
        tip = f"{row['label']}: {row['iqm']:.0f}, R² {row['r2']:.2f}"
        add_points(axes, [at], [row["iqm"]], [tip], look, number, size=6)
    axes.set(xlabel=x, ylabel="final return", xlim=(-0.03, 1.03), ylim=(0, 1000))
