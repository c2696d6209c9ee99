"""What a report says, before it is a page or a file of tables.

`contents.py` builds a `Document`, and `page.render_document` makes the HTML page of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd
from matplotlib.figure import Figure


@dataclass(frozen=True)
class Value:
    """A cell of a table that reads differently from what it is sorted by.

    Attributes:
        text: as shown, such as "668 [659, 676]".
        sort: what the column is sorted by: a number (NaN comes last) or a text.
        best: whether it is shown as the best of its kind.
    """

    text: str
    sort: float | str
    best: bool = False


@dataclass(frozen=True)
class FigureItem:
    """A figure of the report.

    Attributes:
        name: of its files, without an ending, unique in the document: "figure9".
        title: a heading.
        caption: what is shown and how to read it, a sentence or more of plain text.
        figure: the page shows the values of its lines and heat maps under the pointer. A line is
            named by its label, and one without a label, or with one that begins with "_", has
            none but fills the gaps of one of its colour and x before it; areas of a line's colour
            that were drawn since the line before are its bands.
        data: the numbers drawn, to download; None if there is nothing to download.
    """

    name: str
    title: str
    caption: str
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
