"""What a report says, before it is a page or a file of tables.

`contents.py` builds a `Document`, and `page.render_document` makes the HTML page of it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from jbench.report.figure import Figure


@dataclass(frozen=True)
class Value:
    """A cell of a table that reads differently from what it is sorted by.

    Attributes:
        text: as shown, such as "668 [659, 676]".
        sort: what the column is sorted by: a number (NaN comes last) or a text.
        best: whether it is shown as the best of its kind.
        numbers: its columns in a file of data, by what is added to the name of the column: `""`,
            `"low"` and `"high"` of an interval. None: `sort` if that is a number, else the text.
    """

    text: str
    sort: float | str
    best: bool = False
    numbers: Mapping[str, float | None] | None = None

    @property
    def data(self) -> Mapping[str, float | str | None]:
        """Its columns in a file of data, by what is added to the name of the column."""
        if self.numbers is not None:
            return self.numbers
        return {"": self.text if isinstance(self.sort, str) else self.sort}


@dataclass(frozen=True)
class FigureItem:
    """A figure of the report.

    Attributes:
        name: of its files, without an ending, unique in the document: "figure9".
        title: a heading.
        figure: panels and notes, from which files and the page are made.
        data: the numbers drawn, to download; None if there is nothing to download.
    """

    name: str
    title: str
    figure: Figure
    data: pd.DataFrame | None = None


@dataclass(frozen=True)
class TableItem:
    """A table of the report.

    Attributes:
        name: of its files, without an ending, unique in the document: "final_returns".
        title: a heading.
        caption: what is shown and how to read it, a sentence or more of plain text.
        frame: a column's name is its heading; cells are texts, numbers, `Value` objects, or
            missing (None or NaN). The index is not shown.
    """

    name: str
    title: str
    caption: str
    frame: pd.DataFrame


Item = FigureItem | TableItem


@dataclass(frozen=True)
class Section:
    """A part of the report under a heading.

    Attributes:
        title: the heading.
        text: paragraphs of plain text.
        items: figures and tables, in their order.
    """

    title: str
    text: Sequence[str]
    items: Sequence[Item]


@dataclass(frozen=True)
class Document:
    """A whole report.

    Attributes:
        title: the heading of the page.
        summary: sentences that come first: what was run, what is solved, what follows.
        problems: sentences on what can't be read.
        notes: sentences that a reader of the figures should know.
        sections: in their order.
        provenance: a row for each run: its id, versions, processor, time, command.
        command: the command line that made the report.
    """

    title: str
    summary: Sequence[str]
    problems: Sequence[str]
    notes: Sequence[str]
    sections: Sequence[Section]
    provenance: pd.DataFrame
    command: str


def data_frame(frame: pd.DataFrame) -> pd.DataFrame:
    """Returns a table as data: every number in a column of its own, and no formatted text.

    A column of `Value` cells gives a column for each of their numbers: `median`, `median low`,
    `median high`.
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
    # As objects: pandas' own texts can't hold all that a stranger's settings can.
    made = pd.DataFrame(dict(enumerate(columns)))
    return made.set_axis(pd.Index(names, dtype=object), axis=1)


def _data_columns(column: "pd.Series[Any]") -> "list[tuple[str, pd.Series[Any]]]":
    """Returns the columns of data that a column of a table gives, by what is added to its name."""
    cells = column.tolist()
    if not any(isinstance(cell, Value) for cell in cells):
        return [("", column)]
    data = [cell.data if isinstance(cell, Value) else {"": cell} for cell in cells]
    endings = dict.fromkeys(ending for cell in data for ending in cell)
    found = {ending: [cell.get(ending) for cell in data] for ending in endings}
    # A missing cell names no number; its first column is then empty.
    if "" in found and all(pd.api.types.is_scalar(c) and pd.isna(c) for c in found[""]):
        found = {ending: values for ending, values in found.items() if ending} or found
    return [(ending, _series(values)) for ending, values in found.items()]


def _series(values: list[Any]) -> "pd.Series[Any]":
    """Returns numbers as numbers, missing ones as NaN; anything else as it is."""
    present = [value for value in values if value is not None]
    if present and all(isinstance(value, int) for value in present):
        return pd.Series(values, dtype="Int64")
    if all(isinstance(value, int | float) for value in present):
        return pd.Series(values, dtype=float)
    return pd.Series(values, dtype=object)
