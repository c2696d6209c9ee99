"""Tables of a page, sortable if scripts are enabled."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jbench.report.data.cells import OURS
from jbench.report.data.published import PUBLISHED
from jbench.report.document import Value
from jbench.report.page.text import classes, html

_TAGS = {
    "task": "task",
    "algorithm": "algorithm",
    "observation": "representation",
    "runs": "source",
    "entry": "source",
}
"""Names of the attributes by which a page filters rows, by column."""

_WORDY = 36  # characters from which a cell is wrapped
_WORDY_NAME = 44  # the same in the first column, whose names should stay whole
_NAME = 12  # characters from which a heading has two words per line
_LONG = 200  # characters from which a cell scrolls
_PAGE = 132  # characters of a line on paper
_COLUMN = 16  # characters of a line of wrapped text


def table(frame: pd.DataFrame, label: str, tags: Sequence[Mapping[str, str]] | None = None) -> str:
    """Returns a table as HTML, in a box that scrolls if the page is too narrow.

    The attribute `data-sort` of a cell is its sort key, if that is not its text; a missing cell has
    `data-missing` and is sorted last.

    Args:
        frame: as in `document.TableItem`.
        label: name of the box for screen readers.
        tags: what the page filters each row by; None: what its columns say.
    """
    columns = [frame.iloc[:, i].tolist() for i in range(frame.shape[1])]
    numeric = [_is_numeric(column) for column in columns]
    heads = [
        f'<th scope="col"{classes(number=right, named=len(str(name)) > _NAME)}>{html(name)}</th>'
        for name, right in zip(frame.columns, numeric, strict=True)
    ]
    tags = _tags(frame) if tags is None else tags
    rows = [
        f"<tr{_attributes(of_row)}>"
        + "".join(
            _cell(cell, right, i == 0)
            for i, (cell, right) in enumerate(zip(row, numeric, strict=True))
        )
        + "</tr>"
        for row, of_row in zip(zip(*columns, strict=True), tags, strict=True)
    ]
    return "\n".join(
        [
            f'<div class="scroll" role="region" aria-label="{html(label)}" tabindex="0">',
            '<table class="sortable">',
            f"<thead><tr>{''.join(heads)}</tr></thead>",
            "<tbody>",
            *rows,
            "</tbody>",
            "</table>",
            "</div>",
        ]
    )


def _tags(frame: pd.DataFrame) -> list[dict[str, str]]:
    """Returns what a page filters each row by, from columns of that name."""
    tags: list[dict[str, str]] = [{} for _ in range(len(frame))]
    for i, name in enumerate(frame.columns):
        for of_row, cell in zip(tags, frame.iloc[:, i].tolist(), strict=True):
            if name in _TAGS and isinstance(cell, str):
                of_row[_TAGS[name]] = _tag(_TAGS[name], cell)
    return tags


def _tag(name: str, cell: str) -> str:
    """Returns the value of a tag for a cell."""
    if name == "representation":
        return cell.partition(",")[0]  # the settings of its variant follow: "full, bfloat16"
    if name == "source" and cell.startswith(("Figure", PUBLISHED)):
        return PUBLISHED  # a claim names the figure, the leaderboard the kind of return
    return OURS if (name, cell) == ("source", "runs") else cell


def _attributes(tags: Mapping[str, str]) -> str:
    given = "".join(f' data-{tag}="{html(text)}"' for tag, text in tags.items())
    return f" data-tags{given}" if given else ""


def is_wide(frame: pd.DataFrame) -> bool:
    """Returns whether a table is printed in landscape format."""
    width = 0
    for i, name in enumerate(frame.columns):
        cells = frame.iloc[:, i].tolist()
        texts = ["" if _is_missing(cell) else _shown(cell)[0] for cell in cells]
        # Headings and texts wrap between words; numbers don't.
        words = max(map(len, str(name).split()), default=0)
        longest = max(map(len, texts), default=0)
        width += max(words, longest if _is_numeric(cells) else min(_COLUMN, longest)) + 2
    return width > _PAGE


def number_text(value: Any) -> str:
    """Formats a number; the data to download contain more digits."""
    if isinstance(value, int | np.integer) or (value == round(value) and abs(value) < 1e15):
        return f"{int(value):,}"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"


def _cell(cell: Any, right: bool, first: bool) -> str:
    tag, scope = ("th", ' scope="row"') if first else ("td", "")
    if _is_missing(cell):
        return f"<{tag}{scope}{classes(number=right)} data-missing></{tag}>"
    text, sort = _shown(cell)
    best = isinstance(cell, Value) and cell.best
    wordy = not right and len(text) > (_WORDY_NAME if first else _WORDY)
    inner = f"<strong>{html(text)}</strong>" if best else html(text)
    if len(text) > _LONG:
        inner = f'<div class="long" tabindex="0">{inner}</div>'
    missing = sort is not None and not isinstance(sort, str) and math.isnan(sort)
    sorting = " data-missing" if missing else ""
    if sort is not None and not missing:
        sorting = f' data-sort="{html(sort)}"'
    names = classes(number=right, best=best, wordy=wordy)
    return f"<{tag}{scope}{names}{sorting}>{inner}</{tag}>"


def _shown(cell: Any) -> tuple[str, float | str | None]:
    """Returns a cell's text, and its sort key if that is not the text."""
    if isinstance(cell, Value):
        return cell.text, cell.sort if isinstance(cell.sort, str) else float(cell.sort)
    if isinstance(cell, bool | np.bool_):
        return ("yes" if cell else "no"), None
    if isinstance(cell, int | float | np.integer | np.floating):
        value = float(cell)
        return (number_text(cell) if math.isfinite(value) else str(value)), value
    return str(cell), None


def _is_missing(cell: Any) -> bool:
    if isinstance(cell, Value | str | list | tuple | dict):
        return False
    return bool(pd.isna(cell))


def _is_numeric(column: Sequence[Any]) -> bool:
    """Returns whether all present values of a column are sorted as numbers."""
    present = [cell for cell in column if not _is_missing(cell)]
    sorts = [_shown(cell)[1] for cell in present]
    return bool(sorts) and all(isinstance(sort, float) for sort in sorts)
