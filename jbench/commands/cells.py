"""Cells of tables on a terminal: what of them stays in one line, and how they are shortened."""

import re

from rich.cells import cell_len

_NUMBER = re.compile(r"[-+]?[\d,.]+(e[-+]?\d+)?[%kM]?|nan|[-+]?inf|")
INTERVAL = re.compile(rf"(?:{_NUMBER.pattern})(?: \[[^\]]*\])?")
_PIECE = re.compile(r"(?:\[[^\[\]]*\]|\S)+")
"""A word, with all that brackets in it enclose: `hidden_layers=[128, 128]`, or `[+5, +51]`."""
_DIGITS = "0123456789.,"

_UNBROKEN = 14  # characters of the longest text that is never wrapped: ? undecided
_UNBROKEN_NUMBERS = 24  # one that begins with a number: 1,000,192 of 1,000,000


def unbroken(cell: str) -> list[str]:
    """Returns the parts of a cell that stay in one line."""
    longest = _UNBROKEN_NUMBERS if cell[:1].isdigit() else _UNBROKEN
    is_whole = len(cell) <= longest or INTERVAL.fullmatch(cell)
    if is_whole:
        return cell.splitlines()
    return _PIECE.findall(cell)


def wrapped(cell: str, width: int) -> str:
    """Returns a cell with a line for as many of its pieces as have room, which stay unbroken.

    Only a piece that is wider than the column is broken between its words.
    """
    lines = []
    for text in cell.splitlines():
        if cell_len(text) <= width:
            lines.append(text)
            continue

        line = ""
        for piece in _PIECE.findall(text):
            longer = f"{line} {piece}" if line else piece
            if line and cell_len(longer) > width:
                lines.append(line)
                longer = piece
            line = longer

        lines.append(line)

    return "\n".join(lines)


def without_middles(cell: str, limit: int) -> str:
    """Returns a cell whose long words lack their middle; numbers stay whole."""

    def shorten(match: re.Match[str]) -> str:
        word = match[0]
        if _NUMBER.fullmatch(word.strip("[](),")):
            return word
        return shortened(word, limit)

    return re.sub(r"\S+", shorten, cell)


def shortened(word: str, limit: int) -> str:
    """Returns a text of at most `limit` characters, whose ends are whole.

    Of an id, the task is shortened first: what tells runs apart comes after it.
    """
    if cell_len(word) <= limit:
        return word

    task, _, rest = word.partition("/")
    if "/" not in rest:
        return _without_middle(word, limit)

    room = limit - cell_len(rest) - 2
    if room < 0:
        return f"…/{_without_middle(rest, limit - 2)}"
    return f"{task[:room]}…/{rest}"


def _without_middle(word: str, limit: int) -> str:
    """Returns a text of at most `limit` characters: both ends, none of them within a number."""
    head = limit // 2
    tail = len(word) - (limit - 1 - limit // 2)
    while head and word[head - 1] in _DIGITS and word[head] in _DIGITS:
        head -= 1

    while tail < len(word) and word[tail - 1] in _DIGITS and word[tail] in _DIGITS:
        tail += 1

    short = f"{word[:head]}…{word[tail:]}"
    if cell_len(short) > limit:  # wide characters take two places
        return _without_middle(word, limit - 1)
    return short
