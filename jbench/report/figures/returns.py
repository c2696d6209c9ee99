"""Final returns and other numbers in rows: forest plots, differences, errors of encoders."""

from functools import partial

import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes

from jbench.numbers import ratio, whole, with_error
from jbench.report import style
from jbench.report.data.source_names import has_solved_return
from jbench.report.figures import marks
from jbench.report.figures.chart import ROWS, Chart, Panel, by_task
from jbench.report.frames import Frames
from jbench.report.sides import named_sides
from jbench.report.style import Look, Looks
from jbench.statistics.verdicts import DECIDING_SEEDS
from jbench.task_specs import SOLVED_RETURN, highest_return

_FLOOR = 1e-3  # smaller fractions of unexplained variance are drawn here
_POLICIES = {"random": "random actions", "hand-written": "hand-written policy"}
_MOST = 21  # comparisons of methods in a figure: of seven on a task
_ENOUGH = 3  # rows of R², or of s from enough seeds, that have a panel; fewer are in tables


def forest(frames: Frames) -> Chart | None:
    """Returns the final returns of each configuration, and beside them their variability."""
    rows = frames.lead(frames.configurations).query("seeds > 0")
    if len(rows) < 2:
        return None

    # The paper has only training returns.
    published = frames.configurations.groupby("configuration")["published"].max()
    rows = rows.assign(published=rows["configuration"].map(published), name=rows["label"])
    seeds = frames.lead(frames.seeds)
    by = "kind" if rows["kind"].nunique() > 1 else "algo"
    looks = style.looks(rows, by)
    many = rows["s"].notna() & (rows["seeds"] >= DECIDING_SEEDS)
    rows = rows.assign(look=rows[by], beside=many.groupby(rows["task"]).transform("sum") >= _ENOUGH)
    rows = rows.sort_values("beside", ascending=False, kind="stable")  # so that panels are pairs
    panels = []
    for task, group in rows.groupby("task", sort=False):
        policies = frames.baselines[frames.baselines["task"] == task]
        row = marks.row_height(group["name"])
        height = 0.55 + row * (len(group) + len(policies))
        draw = partial(_draw_forest, group, looks=looks, seeds=seeds, policies=policies)
        panels.append(Panel(f"{task}: final return", {"": draw}, (5.2, height)))
        if group["beside"].all():
            known = group[group["s"].notna()]
            draw = partial(_draw_variability, known, looks=looks)
            height = 0.7 + row * len(known)
            panels.append(Panel(f"{task}: variability", {"": draw}, (5.2, height)))

    note = "large mark: interquartile mean with 95% interval; dots: seeds"
    if seeds["episode_sd"].notna().any():
        note += " ± 2 standard errors"
    if rows["published"].notna().any():
        note += "; |: published training return"
    if len(frames.baselines):
        note += "; hollow diamond: mean of a policy's episodes with 95% interval"
    if any(has_solved_return([task], rows["source"]) for task in rows["task"].unique()):
        note += f"; vertical line: the return of a solved task ({SOLVED_RETURN})"
    if rows["beside"].any():
        note += "; hollow mark of variability: its interval begins at 0"
        note += "; a line to the right edge extends beyond it"

    return Chart("returns", "Final returns", note, panels, looks, data="configurations", **ROWS)


def _draw_forest(
    rows: pd.DataFrame, axes: Axes, *, looks: Looks, seeds: pd.DataFrame, policies: pd.DataFrame
) -> None:
    """Draws a row for each configuration: its interval, and the final returns of its seeds."""
    seeds = seeds[seeds["configuration"].isin(rows["configuration"]) & seeds["final"].notna()]
    of_each = dict(iter(seeds.groupby("configuration", sort=False)))
    for place, row in enumerate(rows.to_dict("records")):
        look = looks[row["look"]]
        mine = of_each.get(row["configuration"], seeds.iloc[:0])
        final = mine["final"]
        below = np.full(len(mine), place + 0.27)
        error = 2 * mine["episode_sd"] / np.sqrt(mine["episodes"])
        axes.hlines(below, final - error, final + error, alpha=0.35, linewidth=0.8, **look.ink)
        tips = [
            f"seed {seed}: {with_error(value, twice)}"
            for seed, value, twice in zip(mine["seed"], final, error, strict=True)
        ]
        marks.add_points(axes, final, below, tips, look._replace(marker="o"), 3.2, alpha=0.6)
        if np.isfinite(row["published"]):
            tip = f"{row['name']}, the paper's training return: {row['published']:.0f}"
            look = look._replace(marker="|")
            marks.add_points(axes, [row["published"]], [place], [tip], look, 11)

    marks.add_rows(axes, rows, looks, "iqm")
    names = [_POLICIES.get(name, name) for name in policies["policy"]]
    apart = Look(style.SOFT, (), "D", len(looks), hollow=True)
    for place, row in enumerate(policies.to_dict("records"), len(rows)):
        mean = row["mean"]
        low = row["mean_low"]
        high = row["mean_high"]
        axes.plot([low, high], [place, place], color=style.SOFT, linewidth=1)
        tip = f"{names[place - len(rows)]}: mean {marks.interval_text(mean, low, high)}"
        marks.add_points(axes, [mean], [place], [tip], apart, 5.5, clip_on=False)

    marks.add_solved(axes, rows)
    marks.name_rows(axes, [*rows["name"], *names])
    errors = 2 * seeds["episode_sd"].fillna(0) / np.sqrt(seeds["episodes"])
    highest = seeds["task"].map(highest_return).astype(float)
    reached = np.minimum(seeds["final"] + errors, highest)
    untrained = policies[["mean", "mean_low", "mean_high"]].to_numpy(float)
    untrained = untrained[np.isfinite(untrained)]
    ends = [*seeds["final"], *reached, *untrained, *rows["published"].dropna()]
    marks.set_returns(axes, rows, min(ends, default=0.0), max(ends, default=0.0), "x")


def _draw_variability(rows: pd.DataFrame, axes: Axes, *, looks: Looks) -> None:
    """Draws the standard deviation s between agents' expected returns; hollow if it may be 0."""
    marks.add_rows(axes, rows.assign(hollow=~(rows["s_low"] > 0)), looks, "s")
    # A few configurations with few seeds have intervals that would hide all others.
    ends = rows["s_high"][np.isfinite(rows["s_high"])]
    widest = min(float(ends.max()), 3 * float(ends.median()))
    highest = max(1.0, 1.2 * float(rows["s"].max()), widest)
    axes.set(xlim=(-0.02 * highest, highest), xlabel="s, standard deviation\nbetween agents")


def comparisons(frames: Frames) -> Chart | None:
    """Returns the differences between the two sides of `--compare`."""
    rows = frames.lead(frames.comparisons)
    if len(rows) < 2 or (frames.request.curves and rows["task"].value_counts().max() > _MOST):
        return None

    words = [f", {words}" if words else "" for words in rows["words"]]
    names = rows["algo"] + " " + rows["representation"] + words
    # Where one configuration is compared with several, a row names both.
    is_repeated = names.groupby([rows["task"], names]).transform("size") > 1
    rows = rows.assign(name=names.where(~is_repeated, names + " against " + rows["against"]))
    note = "difference of the interquartile means of final returns; 95% interval"
    if frames.request.compare is not None:
        sides = named_sides(frames.request.compare)
        note = f"final return with {sides.first} minus that with {sides.second}{sides.in_brackets}"
        note += "; 95% interval"
    if frames.request.curves is not None:
        rows = rows.assign(name=rows["a"] + " minus " + rows["b"], algo=rows["a"])

    rows = rows.assign(look=rows["algo"], difference_low=rows["low"], difference_high=rows["high"])
    looks = style.looks(rows, "algo", "algo")

    def draw(group: pd.DataFrame, axes: Axes) -> None:
        marks.add_rows(axes, group, looks, "difference")
        axes.axvline(0, color=style.SOFT, linewidth=0.7)

    row = marks.row_height(rows["name"])
    panels = by_task(rows, draw, (5.2, 0.6 + row * rows.groupby("task").size().max()))
    return Chart("comparisons", "Differences", note, panels, looks, columns=2, minimum=440)


def errors(frames: Frames) -> Chart | None:
    """Returns the errors of encoders: a row each, or by number of latents if sizes differ."""
    rows = frames.encoders
    if len(rows) < 2:
        return None

    names = (rows["representation"] + " " + rows["settings"].fillna("")).str.strip()
    unsized = names.str.replace(r"^([^ ]*?[a-z])\d+", r"\1", n=1, regex=True)
    rows = rows.assign(series=unsized, name=names)
    sizes = rows.groupby(["task", "series"])["latents"].transform("nunique")
    rows["by_size"] = sizes.groupby(rows["task"]).transform("max") > 1
    looks = style.looks(rows, "series", "kind")

    def size(group: pd.DataFrame) -> tuple[float, float]:
        row = marks.row_height(group["name"])
        return (4.2, 2.6) if group["by_size"].all() else (5.2, 0.7 + row * len(group))

    panels = by_task(rows, partial(_draw_errors, looks=looks), size)
    note = (
        "filled: held-out episodes; hollow: those of the hand-written policy; planar and ddae "
        "encode other features"
    )
    return Chart("encoders", "Reconstruction error by encoder", note, panels, looks, **ROWS)


def _draw_errors(rows: pd.DataFrame, axes: Axes, *, looks: Looks) -> None:
    """Draws the unexplained variance of encoders, in rows or against the number of latents."""
    by_size = rows["by_size"].all()
    if by_size:
        rows = rows.sort_values("latents")

    places = dict(zip(rows["name"], range(len(rows)), strict=False))
    # The filled mark is the smaller one, so that both are seen where errors are equal.
    for column, hollow in (("heuristic", True), ("test", False)):
        for name, group in rows[rows[column].notna()].groupby("series", sort=False):
            look = looks[str(name)]._replace(hollow=hollow)
            errors = group[column].clip(lower=_FLOOR)
            pairs = zip(group["name"], group[column], strict=True)
            tips = [f"{name}: {value:.3g} not explained" for name, value in pairs]
            x = errors
            y = group["name"].map(places)
            size = 8 if hollow else 5
            if by_size:
                x = group["latents"]
                y = errors
                size = 5
                width = 0.8 if hollow else 1.6
                axes.plot(x, y, linestyle=look.line, linewidth=width, **look.ink)

            marks.add_points(axes, x, y, tips, look, size)

    if by_size:
        axes.set(xlabel="latents", ylabel="variance not explained")
        axes.xaxis.set_major_locator(ticker.MaxNLocator(integer=True))
    else:
        marks.name_rows(axes, rows["name"])
        axes.set(xlabel="fraction of the variance not explained")

    marks.set_logarithmic(axes, "y" if by_size else "x")


def predictions(frames: Frames) -> Chart:
    """Returns final returns against what latents predict of the next control step."""
    rows = frames.predictions
    looks = style.looks(rows, "representation", "kind")
    counts = rows.groupby(["task", "algo"])["configuration"].transform("nunique")

    def draw(rows: pd.DataFrame, axes: Axes) -> None:
        for row in rows.to_dict("records"):
            look = looks[row["representation"]]
            at = max(row["r2"], 0.0)
            if np.isfinite(row["low"]):
                axes.plot([at, at], [row["low"], row["high"]], **look.ink)
            tip = f"{row['label']}: {whole(row['iqm'])}, R² {ratio(row['r2'])}"
            marks.add_points(axes, [at], [row["iqm"]], [tip], look, 6, clip_on=False)

        axes.set(xlabel=f"R² of the {rows['quantity'].iloc[0]}", ylabel="final return")
        axes.set_xlim(-0.03, 1.03)
        marks.set_returns(axes, rows, 0.0, float(np.nanmax(rows[["iqm", "high"]].to_numpy(float))))
        if marks.narrow(axes):
            axes.xaxis.set_major_locator(ticker.MaxNLocator(3))

    rows = rows.assign(panel=rows["task"] + ", " + rows["algo"])[counts >= _ENOUGH]
    rows = rows.sort_values("panel", key=lambda names: pd.factorize(names)[0], kind="stable")
    panels = by_task(rows, draw, (3.2, 2.3), by=["quantity", "panel"])
    note = "interquartile mean with 95% interval against R² one step ahead; correlation only"

    return Chart(
        "predictions",
        "Return against what latents predict",
        note,
        panels,
        looks,
        columns=4,
        alike=False,
        minimum=260,
    )
