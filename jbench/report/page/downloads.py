"""Data to download from a page, contained in data URLs."""

import base64
import gzip
from urllib.parse import quote

import numpy as np
import pandas as pd

from jbench.report.data.curves import FloatArray
from jbench.report.document import data_frame
from jbench.report.page.text import html
from jbench.store import query

CELLS = 600_000
"""Maximum cells of all tables in one page, each of 2 to 6 bytes when compressed."""

PACKED = 50_000
"""Bytes from which CSV is compressed; the script decompresses it, else it is a .gz file."""

_DIGITS = 9  # significant digits
_LEVEL = 5  # of compression: 9 takes 2.5 times as long and saves 2%


def link(name: str, frame: pd.DataFrame, cells: int) -> str:
    """Returns a link to a table as CSV, as HTML.

    Args:
        name: stem of the file.
        frame: the rows; may contain `Value` cells.
        cells: maximum number of cells. A larger table is reduced to every k-th row, with a note.
    """
    if frame.empty:
        return ""
    step = -(-frame.size // cells)
    # Lone surrogates can't be encoded.
    content = query.to_csv(flat(frame.iloc[::step])).encode(errors="backslashreplace")
    note = f"CSV, {_size(len(content))}"
    if step > 1:
        note += f"; one of every {step} of {len(frame):,} rows, to keep the page small"
    if len(content) >= PACKED:
        ending = ".csv.gz"
        packed = base64.b64encode(gzip.compress(content, _LEVEL, mtime=0)).decode()
        address = f"data:application/gzip;base64,{packed}"
    else:
        ending = ".csv"
        safe = quote(content, safe=" ,.;:()[]{}*!$@=+/?'")
        address = f"data:text/csv;charset=utf-8,{safe}"
    return (
        f'<a class="download" download="{html(name)}{ending}" href="{html(address)}">'
        f'Download data</a> <span class="soft">({note})</span>'
    )


def flat(frame: pd.DataFrame) -> pd.DataFrame:
    """Returns a table as data, with rounded numbers."""
    data = data_frame(frame)
    floats = data.columns[[dtype.kind == "f" for dtype in data.dtypes]]
    data[floats] = _rounded(data[floats].to_numpy(float))
    return data


def _rounded(values: FloatArray) -> FloatArray:
    """Rounds numbers to `_DIGITS`, which take half the space of all 17."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        digits = _DIGITS - 1 - np.floor(np.log10(np.abs(values)))
        scale = 10.0 ** np.abs(digits)
        up = digits >= 0
        rounded = np.where(up, np.round(values * scale) / scale, np.round(values / scale) * scale)
    return np.where(np.isfinite(rounded), rounded, values)


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(1, round(count / 1e3))} KB"
