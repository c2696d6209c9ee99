"""Tables: frames with the columns that people read, as text, Markdown and CSV.

Below are the columns that several tables have.
"""

import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import csv

from jbench.errors import RequestError
from jbench.numbers import steps, whole, with_interval
from jbench.report.texts import clean, map_texts
from jbench.wording import not_formula

FrameRow = Mapping[Any, Any]
Form = Callable[[Any], str]

INTERVAL = "In brackets: 95% interval."
"""What the captions of tables with intervals say."""

_MARKDOWN = str.maketrans(
    {**{c: f"\\{c}" for c in "\\|`*~"}, "<": "&lt;", "&": "&amp;", "$": "&#36;"}
)
_MARKDOWN_WORDS = re.compile(r"(?<![^\W_])_|_(?![^\W_])|(?<=\])\(")
"""Underscores that are not within a word, and what makes a link of brackets."""


class Column(NamedTuple):
    """A column that people read: its heading, the key by whose values it is sorted, its texts."""

    title: str
    key: str
    form: Callable[[FrameRow], str]
    numeric: bool = False  # aligned to the right
    note: str = ""  # a sentence on what its heading means
    one: Form | None = None  # the text of a single number, if it has numbers
    ends: Sequence[str] = ()  # keys of the ends of their intervals

    def text(self, row: FrameRow) -> str:
        """Returns the text of a row in one line; empty if the value is unknown."""
        return "" if pd.isna(row[self.key]) else clean(self.form(row))

    def interval(self, row: FrameRow) -> list[Any]:
        """Returns the ends of the interval of a number; [] if there is none, or it is unknown."""
        ends = [row[end] for end in self.ends]
        known = ends and pd.notna(ends).all() and np.isfinite(ends[0])
        return ends if known else []


@dataclass(frozen=True)
class Table:
    """A frame, and how people read it."""

    name: str  # of its files
    title: str
    caption: str
    frame: pd.DataFrame  # exact numbers, which its CSV file has
    columns: Sequence[Column]
    spare: Sequence[str] = ()
    """Headings that a narrow terminal may leave out, the least important one first.

    A table keeps its seeds longest: without them, a number says more than it may. The order of the
    rows shows ranks.
    """

    @cached_property
    def shown(self) -> tuple[list[Column], list[list[tuple[Any, str]]]]:
        """The columns with any text, and the value that sorts and the text of each cell."""
        rows = [
            [(row[column.key], column.text(row)) for column in self.columns]
            for row in self.frame.to_dict("records")
        ]
        kept = [i for i in range(len(self.columns)) if any(row[i][1] for row in rows)]
        return [self.columns[i] for i in kept], [[row[i] for i in kept] for row in rows]

    def explained(self, columns: Sequence[Column]) -> str:
        """Returns the caption, with what the headings of some columns mean."""
        return " ".join(filter(None, (self.caption, *(column.note for column in columns))))

    def of(self, names: Sequence[str]) -> "Table":
        """Returns the table with the columns of these headings; a RequestError if one is none."""
        known = {column.title: column for column in self.columns}
        for name in names:
            if name not in known:
                raise RequestError(
                    f"--table-columns {name}: there is no such column; type all, or some of "
                    f"{', '.join(known)}."
                )
        return replace(self, columns=[known[name] for name in names])

    def texts(self) -> pd.DataFrame:
        """Returns the table as people read it, without the columns that are empty."""
        columns, rows = self.shown
        titles = [column.title for column in columns]
        return pd.DataFrame([[text for _, text in row] for row in rows], columns=titles)


def to_csv(frame: pd.DataFrame) -> str:
    """Returns exact numbers as CSV; no text of it is a formula of a spreadsheet."""
    rows = pa.Table.from_pandas(map_texts(frame, not_formula), preserve_index=False, nthreads=1)
    sink = io.BytesIO()
    # Of an empty chunk, as pandas leaves of an empty frame, pyarrow would write memory of its own.
    whole = rows.combine_chunks()
    # Ten times faster than pandas, which writes a curve of a million points in seconds.
    csv.write_csv(whole, sink, csv.WriteOptions(include_header=False, quoting_style="needed"))
    return f"{','.join(map(str, frame))}\n{sink.getvalue().decode()}"


def to_markdown(table: Table) -> str:
    """Returns a table in GitHub's Markdown, with its title and caption above."""
    columns, rows = table.shown
    lines = [
        [column.title for column in columns],
        ["---:" if column.numeric else "---" for column in columns],
        *([_markdown(text) for _, text in row] for row in rows),
    ]
    body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    title = table.title if table.title.endswith("?") else f"{table.title}."
    return f"{_markdown(f'{title} {table.explained(columns)}')}\n\n{body}\n"


def _markdown(text: str) -> str:
    """Returns a text in which no character is one of GitHub's Markdown: no emphasis, no formula."""
    return _MARKDOWN_WORDS.sub(r"\\\g<0>", text.translate(_MARKDOWN))


def plain(title: str, key: str | None = None) -> Column:
    """Returns a column of texts."""
    name = key or title
    return Column(title, name, lambda row: str(row[name]))


def number(
    title: str, key: str, form: Form = whole, ends: Sequence[str] = (), note: str = ""
) -> Column:
    """Returns a column of numbers, with the intervals of these ends: `668 [640, 690]`."""

    def text(row: FrameRow) -> str:
        return with_interval(form, row[key], column.interval(row))

    column = Column(title, key, text, numeric=True, note=note, one=form, ends=ends)
    return column


def with_ends(title: str, key: str, form: Form = whole, note: str = "") -> Column:
    """Returns a column of numbers with their intervals, whose ends are …_low and …_high."""
    return number(title, key, form, (f"{key}_low", f"{key}_high"), note)


def _range(row: FrameRow) -> str:
    """Returns the control steps of the shortest and the longest run, once if they are equal."""
    return "\N{EN DASH}".join(dict.fromkeys((steps(row["steps_min"]), steps(row["steps"]))))


TASK = plain("task")
ALGO = plain("algorithm", "algo")
OBSERVED = Column(
    "representation",
    "representation",
    lambda row: ", ".join(filter(None, (row["representation"], row["words"]))),
)
SEEDS = number("seeds", "seeds", str)
RANGE = Column("steps", "steps", _range, numeric=True)
