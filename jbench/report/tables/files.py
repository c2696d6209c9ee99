"""Files of a document's tables: Markdown, LaTeX and CSV."""

import math
import re
from collections.abc import Callable
from typing import Any

import pandas as pd

from jbench.report.document import TableItem, Value, data_frame
from jbench.store import query

_LATEX = str.maketrans(
    {
        **{character: f"\\{character}" for character in "&%$#_{}"},
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "\\": r"\textbackslash{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
        '"': "''",
        "\N{EN DASH}": "--",
        "\N{HORIZONTAL ELLIPSIS}": r"\dots{}",
        "\N{CHECK MARK}": r"$\surd$",
        "\N{BALLOT X}": r"$\times$",
    }
)
_MARKDOWN = re.compile(r"([\\|*`<]|(?<=\])\()")


def to_markdown(item: TableItem) -> str:
    """Returns a table in GitHub's Markdown with its caption above; the best values are bold."""
    frame = item.frame
    rows = [
        [_markdown(str(name)) for name in frame],
        ["---:" if _is_numeric(frame[name]) else "---" for name in frame],
        *_texts(frame, _markdown, "**{}**"),
    ]
    lines = [f"| {' | '.join(texts)} |" for texts in rows]
    return "\n".join([f"{_markdown(item.title)}. {_markdown(item.caption)}", "", *lines, ""])


def to_latex(item: TableItem) -> str:
    """Returns a table for LaTeX's booktabs with its caption above; the best values are bold."""
    frame = item.frame
    columns = "".join("r" if _is_numeric(frame[name]) else "l" for name in frame)
    return "\n".join(
        [
            r"% Needs \usepackage{booktabs}.",
            r"\begin{table}",
            r"\centering",
            rf"\caption{{{_latex(f'{item.title}. {item.caption}')}}}",
            rf"\label{{tab:{re.sub('[^A-Za-z0-9-]', '-', item.name)}}}",
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            _latex_row([_latex(str(name)) for name in frame]),
            r"\midrule",
            *map(_latex_row, _texts(frame, _latex, r"\textbf{{{}}}")),
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
            "",
        ]
    )


def to_csv(item: TableItem) -> str:
    """Returns a table as CSV with one number per column."""
    return query.to_csv(data_frame(item.frame))


FORMATS = {"md": to_markdown, "tex": to_latex, "csv": to_csv}
"""Writers of table files by suffix."""


def text_of(cell: Any) -> str:
    """Formats a cell; a missing value is an empty text."""
    if isinstance(cell, Value):
        return cell.text
    if cell is None or cell is pd.NA or (isinstance(cell, float) and math.isnan(cell)):
        return ""
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)


def _is_numeric(column: "pd.Series[Any]") -> bool:
    """Returns whether a column is right-aligned: numbers, and values sorted by numbers."""
    cells = [cell for cell in column if text_of(cell)]
    kinds = [cell.sort if isinstance(cell, Value) else cell for cell in cells]
    return bool(cells) and all(not isinstance(kind, str) for kind in kinds)


def _texts(frame: pd.DataFrame, escape: Callable[[str], str], bold: str) -> list[list[str]]:
    """Returns the escaped texts of each row; `bold` formats the best ones."""

    def text(cell: Any) -> str:
        form = bold if isinstance(cell, Value) and cell.best else "{}"
        return form.format(escape(text_of(cell)))

    return [[text(cell) for cell in row] for row in frame.itertuples(index=False)]


def _markdown(text: str) -> str:
    return _MARKDOWN.sub(r"\\\1", " ".join(text.split())).replace("&", "&amp;")


def _latex(text: str) -> str:
    return " ".join(text.split()).translate(_LATEX)


def _latex_row(texts: list[str]) -> str:
    line = " & ".join(texts)
    # LaTeX would take a bracket or star after the end of a row for an option of the row.
    return rf"{'{}' if line.startswith(('[', '*')) else ''}{line} \\"
