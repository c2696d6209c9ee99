"""A result is identified by what produced it: canonical JSON of its settings, hashed."""

import hashlib
import json
import re
from collections.abc import Mapping
from typing import Any

from jbench.errors import RequestError

# One part of an id: it becomes a directory, so no dots alone, no separators, nothing hidden.
_PART = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")


def canonical_json(settings: Mapping[str, Any]) -> str:
    """Returns the one JSON text of these settings: sorted keys, no spaces, ASCII.

    Raises:
        ValueError: if a value is not a number (NaN) or infinite.
    """
    return json.dumps(settings, sort_keys=True, separators=(",", ":"), allow_nan=False)


def settings_hash(settings: Mapping[str, Any]) -> str:
    """Returns the first 8 hexadecimal digits of the SHA-256 of the canonical JSON."""
    return hashlib.sha256(canonical_json(settings).encode()).hexdigest()[:8]


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
