r"""Tables for LaTeX's booktabs and tabularx.

The table of final returns fits a column of a two-column paper: it is in the size of footnotes, a
task stands once above its rows, and a long name such as dae12-whitened-epochs-800 has several
lines, which end after a hyphen or another sign.

A table with long texts is as wide as the line where it stands, and these texts have what the other
columns leave of it. If they leave too little even in a paper of one column, the texts have a fixed
width, and the table needs a wider page.

All numbers of a column have as many decimals, and stand below each other: their intervals are a
column of their own under the same heading.
"""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import pandas as pd

from jbench.numbers import SIGNS, Form, decimals, texts
from jbench.report.latex_characters import escaped
from jbench.report.table import TASK, Column, FrameRow, Table

_LONG_NAME = 16  # characters; a column with a longer text has lines
_NAME_WIDTH = "7em"  # of them
_NAME_CHARACTERS = 14  # that fit into such a line
_SENTENCE = 40  # characters; a column with a longer text has sentences
_SENTENCE_WIDTH = "14em"
_LINE = 90  # characters of a line of an article (345 pt), in the size of footnotes
_DIGITS = 4  # of the largest number of a column with decimals


@dataclass(frozen=True)
class _Made:
    """A column of a table as LaTeX has it.

    Attributes:
        sides: the alignment of its cells; that of texts with several lines is not used where the
            table fills the line.
        heading: in LaTeX.
        cells: of each row, in LaTeX.
        characters: of its longest cell, or of a line of it; about as many as it is wide.
        has_lines: whether its texts have several lines.
        width: 2 for numbers with intervals, else 1.
    """

    sides: str
    heading: str
    cells: Sequence[str]
    characters: int
    has_lines: bool = False
    width: int = 1


def to_latex(table: Table) -> str:
    """Returns a table whose caption explains its words."""
    every, _ = table.shown
    rows = table.frame.to_dict("records")
    has_tasks = len(every) > 1 and every[0].key == TASK.key
    groups = _groups(every[0], rows) if has_tasks else [""] * len(rows)
    columns = every[1:] if any(groups) else every
    made = [_numbers(c, rows) if c.numeric else _texts(c, rows) for c in columns]
    # After \raggedright of a last cell, \\ would end a line of that.
    end = r"\tabularnewline" if made and made[-1].has_lines else r"\\"
    title = table.title if table.title.endswith("?") else f"{table.title}."
    if _fills_line(made):
        packages = "booktabs,tabularx"
        environment = "tabularx"
        width = r"{\linewidth}"
        sides = "".join("X" if column.has_lines else column.sides for column in made)
    else:
        packages = "booktabs"
        environment = "tabular"
        width = ""
        sides = "".join(column.sides for column in made)

    lines = [
        rf"% \usepackage{{{packages}}}",
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{escaped(f'{title} {table.explained(every)}')}}}",
        rf"\label{{tab:{table.name.replace('_', '-')}}}",
        r"\footnotesize",
        r"\setlength{\tabcolsep}{3pt}",
        rf"\begin{{{environment}}}{width}{{@{{}}{sides}@{{}}}}",
        r"\toprule",
        f"{' & '.join(column.heading for column in made)} {end}",
        *([] if any(groups) else [r"\midrule"]),
        *_body(groups, made, end),
        r"\bottomrule",
        rf"\end{{{environment}}}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _body(groups: Sequence[str], made: Sequence[_Made], end: str) -> list[str]:
    """Returns the lines of the rows, and a line with the task above those of each task.

    Args:
        groups: the task where its rows begin, else an empty text.
        made: the columns.
        end: command at the end of a row.
    """
    width = sum(column.width for column in made)
    lines = []
    for group, *cells in zip(groups, *(column.cells for column in made), strict=True):
        if group:
            lines += [
                r"\midrule",
                rf"\multicolumn{{{width}}}{{@{{}}l}}{{\emph{{{escaped(group)}}}}} {end}",
            ]
        lines.append(f"{' & '.join(cells)} {end}")

    return lines


def _fills_line(made: Sequence[_Made]) -> bool:
    """Returns whether a table fills a line: it has long texts, and columns that leave them room."""
    needed = sum(column.characters + 1 for column in made)
    return any(column.has_lines for column in made) and needed <= _LINE


def _groups(column: Column, rows: Sequence[FrameRow]) -> list[str]:
    """Returns the text of a column where a new one begins, else an empty one.

    There is none if rows with one text are not together.
    """
    shown = [column.text(row) for row in rows]
    begins = [text if i == 0 or shown[i - 1] != text else "" for i, text in enumerate(shown)]
    return begins if len({*shown}) == sum(map(bool, begins)) else [""] * len(shown)


def _texts(column: Column, rows: Sequence[FrameRow]) -> _Made:
    """Returns a column of texts; long ones have several lines."""
    shown = [column.text(row) for row in rows]
    longest = _longest(shown)
    heading = escaped(column.title)
    if longest <= _LONG_NAME:
        return _Made("l", heading, [*map(escaped, shown)], _longest([column.title, *shown]))

    width = _NAME_WIDTH if longest <= _SENTENCE else _SENTENCE_WIDTH
    cells = [_breakable(text) if len(text) > _LONG_NAME else escaped(text) for text in shown]
    return _Made(f"p{{{width}}}", heading, cells, _NAME_CHARACTERS, has_lines=True)


def _numbers(column: Column, rows: Sequence[FrameRow]) -> _Made:
    """Returns a column of numbers, whose intervals are beside them."""
    heading = escaped(column.title)
    form = column.one
    if form is None:
        cells = [column.text(row) for row in rows]
        return _Made("r", heading, [*map(escaped, cells)], _longest([column.title, *cells]))

    places = _decimals(column, form, rows)
    shown = [("", "")] * len(rows)
    for i, row in enumerate(rows):
        if column.text(row):
            shown[i] = texts(form, row[column.key], column.interval(row), places)

    characters = _longest([column.title, *map(" ".join, shown)])
    if not any(interval for _, interval in shown):
        return _Made("r", heading, [escaped(number) for number, _ in shown], characters)

    cells = [f"{escaped(number)} & {escaped(interval)}" for number, interval in shown]
    heading = rf"\multicolumn{{2}}{{c}}{{{heading}}}"
    return _Made(r"r@{ }l", heading, cells, characters, width=2)


def _longest(shown: Iterable[str]) -> int:
    """Returns the characters of the longest text."""
    return max(map(len, shown), default=0)


def _decimals(column: Column, form: Form, rows: Sequence[FrameRow]) -> int | None:
    """Returns the decimals of all numbers of a column; None if their form has equally many.

    They are those of the row that needs most, up to four digits of the largest number, and at least
    one if any row needs some. Numbers below 1e-5 of the largest need none.
    """
    if form not in SIGNS:
        return None

    cells = [(row[column.key], *column.interval(row)) for row in rows]
    numbers = [abs(value) for cell in cells for value in cell if pd.notna(value)]
    largest = max(filter(math.isfinite, numbers), default=0.0)
    known = [[value for value in cell if pd.notna(value)] for cell in cells]
    shown = [cell for cell in known if any(abs(value) > 1e-5 * largest for value in cell)]
    places = max((decimals(form, cell) for cell in shown), default=0)
    _, _, exponent = f"{largest:.0e}".partition("e")  # of 0.003 it is -3
    return min(places, max(1, _DIGITS - 1 - int(exponent)))


def _breakable(text: str) -> str:
    """Returns a text in LaTeX that may break after signs within its words, not only at hyphens."""
    parts = re.split(r"(?<=[_=/:.,])(?=[^ ])", text)
    return r"\raggedright " + r"\allowbreak{}".join(map(escaped, parts))
