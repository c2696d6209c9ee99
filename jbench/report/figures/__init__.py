"""The figures of a report: each function draws one frame."""

from copy import copy
from dataclasses import fields

import pandas as pd

from jbench.report.figures import curves, returns, shares
from jbench.report.figures.chart import Chart
from jbench.report.frames import Frames
from jbench.report.table import clean

MAKERS = (
    curves.by_representation,
    curves.by_algorithm,
    returns.forest,
    returns.comparisons,
    shares.pairs,
    shares.profiles,
    returns.predictions,
    returns.errors,
    curves.by_processor_time,
    shares.motor,
    shares.positions,
    curves.augmented_sequences,
)
"""Functions that make a figure of frames, in the order of the page; None or no panels without
enough data."""


def cleaned(frames: Frames) -> Frames:
    """Returns the frames with texts in one line, without control characters."""
    frames = copy(frames)
    for field in fields(frames):
        frame = getattr(frames, field.name)
        if isinstance(frame, pd.DataFrame):
            setattr(frames, field.name, _clean_texts(frame))
    return frames


def _clean_texts(frame: pd.DataFrame) -> pd.DataFrame:
    frame = frame.copy(deep=False)
    for name in frame.columns.difference(["settings", "provenance"]):
        if pd.api.types.is_numeric_dtype(frame[name]):
            continue
        texts = (text for text in frame[name].unique() if isinstance(text, str))
        if unclean := {text: clean(text) for text in texts if clean(text) != text}:
            frame[name] = frame[name].replace(unclean)
    return frame


def charts(frames: Frames) -> list[Chart]:
    """Returns the figures that there are data for; see `cleaned`."""
    frames = copy(frames)
    for name in ("curves", "processor", "sequences"):
        setattr(frames, name, curves.drawn_points(getattr(frames, name)))
    made = (make(frames) for make in MAKERS)
    return [chart for chart in made if chart is not None and chart.panels]
