"""Ids of records and what they may look like. Their hashes are those of the settings."""

import re

from jbench.errors import RequestError

# A part of an id becomes a directory: no separators and no leading dot.
_PART = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")


def check_id(text: str) -> str:
    """Returns the id.

    Raises:
        RequestError: if it is invalid, for example leads out of the results directory.
    """
    if not text or not all(_PART.fullmatch(part) for part in text.split("/")):
        raise RequestError(
            f"{text!r} is not an id; an id looks like face_direction/dae12/s00-1f9a2c4e."
        )
    return text
