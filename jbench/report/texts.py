"""How recorded texts read: in one line, without characters that control a terminal."""

from collections.abc import Callable

import pandas as pd

from jbench.wording import printable


def clean(text: str) -> str:
    """Returns a text in one line, without characters that control a terminal or the direction."""
    return printable(" ".join(text.split()))


def map_texts(frame: pd.DataFrame, change: Callable[[str], str] = str) -> pd.DataFrame:
    """Returns a frame in which each text is clean, and changed by a function."""
    changed = frame.copy(deep=False)
    for name in changed.select_dtypes(["object", "str", "category"]):
        if len(frame) and isinstance(frame[name].iloc[0], dict):
            continue  # of texts by name

        texts = [text for text in frame[name].unique() if isinstance(text, str)]
        new = {text: change(clean(text)) for text in texts}
        if any(text != new[text] for text in texts):
            changed[name] = frame[name].map(lambda value, new=new: new.get(value, value))

    return changed
