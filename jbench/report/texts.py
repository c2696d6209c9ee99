"""How recorded texts read: in one line, without characters that control a terminal."""

from collections.abc import Callable

import pandas as pd


def clean(text: str) -> str:
    """Returns a text in one line, without characters that control a terminal or the direction."""
    line = " ".join(text.split())
    if line.isprintable():
        return line
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in line)


def map_texts(frame: pd.DataFrame, change: Callable[[str], str] = str) -> pd.DataFrame:
    """Returns a frame in which each text is clean, and changed by a function."""
    changed = frame.copy(deep=False)
    for name in changed.select_dtypes(["object", "str", "category"]):
        if len(frame) and isinstance(frame[name].iloc[0], dict):
            continue  # of texts by name
        texts = [text for text in frame[name].unique() if isinstance(text, str)]
        if known := {text: new for text in texts if (new := change(clean(text))) != text}:
            changed[name] = frame[name].map(lambda value, known=known: known.get(value, value))
    return changed
