"""Ids of results: what one looks like. Its hash is that of the settings (`settings/base.py`)."""

import re

from jbench.errors import RequestError

# One part of an id: it becomes a directory, so no dots alone, no separators, nothing hidden.
_PART = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")


def check_id(text: str) -> str:
    """Returns the id if it can name a place inside the results directory.

    Raises:
        RequestError: if it could lead out of it, or is not an id at all.
    """
    if not text or not all(_PART.fullmatch(part) for part in text.split("/")):
        raise RequestError(
            f"{text!r} is not an id; an id looks like face_direction/dae12/s00-1f9a2c4e."
        )
    return text
