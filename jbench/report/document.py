"""Content of a report, independent of its file formats.

`contents.py` builds a `Document`, and `page.render_document` renders it as HTML.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import pandas as pd

from jbench.report.data.curves import FloatArray
from jbench.report.data.paths import RunPath
from jbench.report.figure import Figure


@dataclass(frozen=True)
class Value:
    """A table cell whose text differs from its sort key.

    Attributes:
        text: as shown, such as "668 [659, 676]".
        sort: sort key: a number (NaN comes last) or a text.
        best: whether it is highlighted as the best of its kind.
        numbers: its columns in a data file, by the suffix of the column's name, such as `""`,
            `"low"` and `"high"` for an interval. None: `sort` if that is a number, else the text.
    """

    text: str
    sort: float | str
    best: bool = False
    numbers: Mapping[str, float | None] | None = None

    @property
    def data(self) -> Mapping[str, float | str | None]:
        """Its columns in a data file, by the suffix of the column's name."""
        if self.numbers is not None:
            return self.numbers
        return {"": self.text if isinstance(self.sort, str) else self.sort}


@dataclass(frozen=True)
class FigureItem:
    """A figure of the report.

    Attributes:
        name: stem of its files, unique in the document, such as "figure9".
        figure: panels and notes, from which files and the page are made.
        data: numbers in the figure, to download; None if there are none.
    """

    name: str
    title: str
    figure: Figure
    data: pd.DataFrame | None = None


@dataclass(frozen=True)
class TableItem:
    """A table of the report.

    Attributes:
        name: stem of its files, unique in the document, such as "final_returns".
        caption: plain text that explains how to read the table.
        frame: a column's name is its heading; cells are texts, numbers, `Value` objects, or
            missing (None or NaN). The index is not shown.
        folded: whether the page shows it only on request.
    """

    name: str
    title: str
    caption: str
    frame: pd.DataFrame
    folded: bool = False


Item = FigureItem | TableItem


@dataclass(frozen=True)
class Section:
    """A part of the report under a heading.

    Attributes:
        text: paragraphs of plain text.
        answers: sentences that are always shown, before the text.
    """

    title: str
    text: Sequence[str]
    items: Sequence[Item]
    answers: Sequence[str] = ()


class RunCurve(NamedTuple):
    """Learning curve of a run: its label, control steps (points,) and returns (points,)."""

    label: str
    control_steps: FloatArray
    returns: FloatArray


@dataclass(frozen=True)
class RunDetail:
    """A run, which the page shows on request.

    Attributes:
        name: its id, after the name of its source if there are several.
        cell: key that is equal for runs that differ only in seed and steps.
        settings: text of each setting by its name, such as "hyperparameters.tau".
        tags: what the page filters by; see `figure.Series`.
        paths: of its robot in its first and its last evaluation, or fewer.
    """

    name: str
    cell: tuple[str, str]
    settings: Mapping[str, str]
    curves: Sequence[RunCurve]
    tags: Mapping[str, str]
    paths: Sequence[RunPath] = ()


@dataclass(frozen=True)
class Document:
    """A whole report.

    Attributes:
        summary: first sentences: runs, solved tasks, conclusions.
        problems: sentences on unreadable records.
        notes: sentences for the reader of the figures.
        provenance: a row per run: id, versions, processor, time, command.
        command: command line that made the report.
        headline: main results, in a few sentences.
        overview: figures that are shown first.
        inventory: numbers on what was run, each with its name.
        runs: the run of each row of `provenance`; or none.
    """

    title: str
    summary: Sequence[str]
    problems: Sequence[str]
    notes: Sequence[str]
    sections: Sequence[Section]
    provenance: pd.DataFrame
    command: str
    headline: str = ""
    overview: Sequence[FigureItem] = ()
    inventory: Sequence[tuple[str, str]] = ()
    runs: Sequence[RunDetail] = ()

    @property
    def items(self) -> list[Item]:
        """All figures and tables in order."""
        return [*self.overview, *(item for section in self.sections for item in section.items)]


def data_frame(frame: pd.DataFrame) -> pd.DataFrame:
    """Returns a table as data: one number per column, and no formatted text.

    A column of `Value` cells becomes a column for each of their numbers, such as `median`,
    `median low` and `median high`.
    """
    names: list[str] = []
    columns: list[pd.Series[Any]] = []
    for i, name in enumerate(frame.columns):
        for ending, column in _data_columns(frame.iloc[:, i].reset_index(drop=True)):
            new = f"{name} {ending}".strip()
            while new in names:
                new += "'"
            names.append(new)
            columns.append(column)
    # Objects, because pandas' strings can't hold every text of untrusted settings.
    made = pd.DataFrame(dict(enumerate(columns)))
    return made.set_axis(pd.Index(names, dtype=object), axis=1)


def _data_columns(column: "pd.Series[Any]") -> "list[tuple[str, pd.Series[Any]]]":
    """Returns the data columns of a table's column, by the suffix of their names."""
    if column.dtype != object:
        return [("", column)]
    cells = column.tolist()
    if not any(isinstance(cell, Value) for cell in cells):
        return [("", column)]
    data = [cell.data if isinstance(cell, Value) else {"": cell} for cell in cells]
    endings = dict.fromkeys(ending for cell in data for ending in cell)
    columns = {ending: [cell.get(ending) for cell in data] for ending in endings}
    # Missing cells have no suffixes: drop the column that only they would fill.
    if "" in columns and all(pd.api.types.is_scalar(c) and pd.isna(c) for c in columns[""]):
        columns = {ending: values for ending, values in columns.items() if ending} or columns
    return [(ending, _series(values)) for ending, values in columns.items()]


def _series(values: list[Any]) -> "pd.Series[Any]":
    """Returns numbers as a numeric column (missing ones are NaN), anything else as objects."""
    present = [value for value in values if value is not None]
    if present and all(isinstance(value, int) for value in present):
        return pd.Series(values, dtype="Int64")
    if all(isinstance(value, int | float) for value in present):
        return pd.Series(values, dtype=float)
    return pd.Series(values, dtype=object)
