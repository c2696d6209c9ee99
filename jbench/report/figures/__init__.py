"""The figures of a report: each function draws one frame."""

from jbench.report.figures import curves, kept, returns, shares
from jbench.report.figures.chart import Chart
from jbench.report.frames import Frames

_MAKERS = (
    curves.by_representation,
    curves.by_algorithm,
    returns.forest,
    returns.comparisons,
    shares.pairs,
    shares.profiles,
    returns.predictions,
    kept.kept,
    returns.errors,
    curves.by_processor_time,
    shares.motor,
    shares.positions,
    curves.augmented_sequences,
)  # in the order of the page; they return None or no panels without enough data


def charts(frames: Frames) -> list[Chart]:
    """Returns the figures that there are data for."""
    made = [make(frames) for make in _MAKERS]
    return [chart for chart in made if chart is not None and chart.panels]
