"""Frames that are made when they are first asked for, with texts that may stand on a page."""

from collections.abc import Callable
from functools import cached_property
from typing import TypeVar

import pandas as pd

from jbench.report.texts import map_texts

_Owner = TypeVar("_Owner")


def cleaned_frame(
    make: Callable[[_Owner], pd.DataFrame],
) -> "cached_property[pd.DataFrame]":
    """Returns a property that makes a frame when it is first asked for.

    Each text of it is one line, without control characters, however it was recorded.
    """

    def made(owner: _Owner) -> pd.DataFrame:
        return map_texts(make(owner))

    made.__doc__ = make.__doc__
    return cached_property(made)
