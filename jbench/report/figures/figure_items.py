"""Figures of a report, with their titles and numbers."""

import math
from collections.abc import Iterator, Mapping, Sequence

import pandas as pd

from jbench.names import FULL
from jbench.report.analysis import reduction, scores
from jbench.report.data.cells import Cell, LearnedCurve, file_name
from jbench.report.data.published import PublishedCurve
from jbench.report.data.returns import TRAINING
from jbench.report.document import FigureItem
from jbench.report.figure import Figure
from jbench.report.figures import (
    behavior,
    encoders,
    forest,
    heat_map,
    learning_curves,
    predictions,
    processor,
    profiles,
    reduction_figure,
    sequences,
)
from jbench.report.figures.behavior import Behavior
from jbench.report.formatting import display_name
from jbench.report.request import Request
from jbench.report.views import View


def of_tasks(
    view: View, published: Sequence[PublishedCurve], aggregate: pd.DataFrame, request: Request
) -> Iterator[FigureItem]:
    """Yields the learning curves of all tasks."""
    kind, learned = view.kind, _on_one_robot(view.drawn)
    if not learned:
        return
    figure = learning_curves.grid_figure(learned, [*published, *view.baselines], request)
    name = "figure9" if kind is TRAINING else "evaluations"
    data = aggregate[aggregate["returns"] == kind.name]
    where = " on the full observation" if _encoded_are_elsewhere(learned) else ""
    yield FigureItem(name, f"Learning curves{where}: {kind.plural}", figure, data)


def _encoded_are_elsewhere(learned: Sequence[LearnedCurve]) -> bool:
    """Returns whether the figure of all tasks shows the full observation, and others are left."""
    tasks = {cell.task for cell, _ in learned}
    shown = [cell for task in tasks for cell, _ in learning_curves.shown_in_grid(learned, task)]
    return len(shown) < len(learned) and all(cell.representation == FULL for cell in shown)


def of_uncertainty(
    view: View, trained: Sequence[Cell], published: Sequence[PublishedCurve]
) -> Iterator[FigureItem]:
    """Yields the final returns with their uncertainty, of at least one cell."""
    found = [one for one in view.statistics if _has_final(one)]
    if found:
        figure = forest.forest_figure(found, trained, published)
        frame = scores.statistics_frame(found)
        frame = frame[frame["measure"] == "final_return"]
        yield FigureItem("forest", figure.title, figure, frame)


def _has_final(summary: scores.Summary) -> bool:
    one = summary.get("final_return", "interquartile_mean")
    return one is not None and math.isfinite(one.estimate.value)


def of_curves(
    view: View, published: Sequence[PublishedCurve], aggregate: pd.DataFrame, request: Request
) -> Iterator[FigureItem]:
    """Yields further learning curves: full against encoded, and sequences of robots."""
    training = view.kind is TRAINING
    if not view.leads:
        yield from of_tasks(view, published, aggregate, request)
    data = aggregate[aggregate["returns"] == view.kind.name]
    drawn = _on_one_robot(view.drawn)
    compared = learning_curves.comparison_figures(drawn, published, request)
    title = f"Full against encoded observations, {view.kind.plural}"
    name = "comparison" if training else "evaluations"
    yield from _of_learners(compared, name, title, _points(data, drawn))
    if training:
        several = [item for item in view.learned if item.cell.robots > 1]
        figures = sequences.sequence_figures(several, published, request)
        yield from _of_learners(figures, "robots", "Sequence of robots", _points(data, several))


def _points(aggregate: pd.DataFrame, items: Sequence[LearnedCurve]) -> pd.DataFrame:
    """Returns the points of these curves."""
    return aggregate[aggregate["variant"].isin([item.cell.variant for item in items])]


def _of_learners(
    figures: Mapping[tuple[str, str], Figure], name: str, title: str, points: pd.DataFrame
) -> Iterator[FigureItem]:
    """Yields figures by task and algorithm with their numbers."""
    for (task, algo), figure in figures.items():
        data = points[(points["task"] == task) & (points["algo"] == algo)]
        named = f"{title}: {task}, {display_name(algo)}"
        yield FigureItem(file_name(name, task, algo), named, figure, data)


def of_returns(view: View) -> Iterator[FigureItem]:
    """Yields the matrix of cells and the performance profiles, of at least one cell."""
    title = f"Overview of all cells: final {view.kind.plural}"
    data = heat_map.matrix_frame(view.cells)
    yield FigureItem("matrix", title, heat_map.matrix_figure(view.cells), data)
    one_robot = [item.cell for item in _on_one_robot(view.learned)]
    figure = profiles.profiles_figure(one_robot)
    if figure is not None:
        yield FigureItem("profiles", figure.title, figure, profiles.profiles_frame(one_robot))


def of_reduction(view: View, encoder_table: pd.DataFrame) -> Iterator[FigureItem]:
    """Yields the final returns of representations, by size and by what their latents predict."""
    if view.groups:
        figure = reduction_figure.reduction_figure(view.groups)
        title = f"Final {view.kind.plural} of each representation"
        data = reduction.frame(view.groups)
        yield FigureItem(view.file("reduction"), title, figure, data)
        against = predictions.returns_figure(view.groups, encoder_table)
        if view.leads and against is not None:
            yield FigureItem("prediction_returns", against.title, against, data)


def of_time(view: View, provenance: pd.DataFrame) -> Iterator[FigureItem]:
    """Yields the returns against processor time; `provenance` has a row for each run."""
    one_robot = _on_one_robot(view.learned)
    processors = sorted({*provenance.get("processor", ())} - {""})
    figure = processor.processor_time_figure(one_robot, processors)
    if figure is not None:
        data = processor.processor_time_frame(one_robot)
        yield FigureItem("processor_time", figure.title, figure, data)


def _on_one_robot(items: Sequence[LearnedCurve]) -> list[LearnedCurve]:
    """Returns the curves of runs that were trained on one robot, and not on a sequence of them."""
    return [item for item in items if item.cell.robots <= 1]


def of_encoders(table: pd.DataFrame) -> Iterator[FigureItem]:
    """Yields the errors and predictions of encoders, of at least one, against their latents."""
    title = "Error of encoders against number of latents"
    yield FigureItem("encoders", title, encoders.error_figure(table), table)
    predicted = predictions.prediction_figure(table)
    if predicted is not None:
        title = "Prediction of the next control step from latents"
        yield FigureItem("encoder_predictions", title, predicted, table)


def of_behavior(behaviors: Sequence[Behavior]) -> Iterator[FigureItem]:
    """Yields the motor velocities and positions of policies."""
    for name, figure in behavior.figures(behaviors).items():
        yield FigureItem(name, figure.title, figure)
