"""Waiting for results to change."""

import hashlib
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from jbench.report import output_directory, page
from jbench.report.request import Request
from jbench.store import Results
from jbench.store.manifest import MANIFEST

LOOK_EVERY = 2.0
"""Seconds between two looks at the results."""


@dataclass
class Interrupt:
    """Whether Ctrl-C came.

    No event of threading: its lock, taken by a signal's handler, would wait for who is interrupted.
    """

    came: bool = False


@contextmanager
def remembered_interrupt() -> Iterator[Interrupt]:
    """Remembers Ctrl-C, which raises KeyboardInterrupt as ever.

    Libraries swallow the exception now and then, if it comes while C code of theirs calls Python.
    """
    interrupt = Interrupt()

    def remember(number: int, frame: FrameType | None) -> None:
        interrupt.came = True
        raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler:  # who started this process wants it otherwise
        yield interrupt
        return
    signal.signal(signal.SIGINT, remember)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, before)


def watch(
    results: Results, request: Request, interrupt: Interrupt, look_every: float = LOOK_EVERY
) -> Iterator[None]:
    """Gives control at once, and again whenever a record was committed meanwhile.

    What is done in between takes half of the time at most: after it, as long is waited as it took.

    Args:
        results: to look at.
        request: whose results directories are looked at, too.
        interrupt: ends it once it came.
        look_every: seconds between two looks, at least.
    """
    places = [results.path, *(Path(text) for text in request.compare or () if Path(text).is_dir())]
    seen: str | None = None
    while not interrupt.came:
        now = fingerprint(places)
        if now == seen:
            time.sleep(look_every)
            continue
        seen = now
        began = time.monotonic()
        yield
        time.sleep(max(look_every, time.monotonic() - began))


def end(out: Path) -> None:
    """Lets the page of the last report stay as it is, in browsers that show it, too."""
    output_directory.change(out, "index.html", page.still)


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
