"""Waiting for results to change."""

import hashlib
import time
from collections.abc import Iterator
from pathlib import Path

from jbench.report.request import Request
from jbench.store import Results
from jbench.store.manifest import MANIFEST

LOOK_EVERY = 2.0
"""Seconds between two looks at the results."""


def watch(results: Results, request: Request, look_every: float = LOOK_EVERY) -> Iterator[None]:
    """Gives control at once, and again whenever a record was committed meanwhile; never ends.

    What is done in between takes half of the time at most: after it, as long is waited as it took.

    Args:
        results: to look at.
        request: whose results directories are looked at, too.
        look_every: seconds between two looks, at least.
    """
    places = [results.path, *(Path(text) for text in request.compare or () if Path(text).is_dir())]
    seen: str | None = None
    while True:
        now = fingerprint(places)
        if now == seen:
            time.sleep(look_every)
            continue
        seen = now
        began = time.monotonic()
        yield
        time.sleep(max(look_every, time.monotonic() - began))


def fingerprint(places: list[Path]) -> str:
    """Returns what changes whenever a manifest below these directories does."""
    digest = hashlib.sha256()
    for place in places:
        for kind in ("runs", "encoders", "evaluations"):
            for path in sorted((place / kind).rglob(MANIFEST)):
                try:
                    found = path.stat()
                except OSError:
                    continue  # it was removed meanwhile
                digest.update(f"{path} {found.st_mtime_ns} {found.st_size}\n".encode())
    return digest.hexdigest()
