"""Watching results: when their records have changed, and the page in a browser."""

import signal
import sys
import time
import webbrowser
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from types import FrameType

from jbench.opengl import has_display


def changes(directories: Sequence[Path], poll_seconds: float = 2.0) -> Iterator[None]:
    """Yields at once, and whenever records of results directories have changed, until Ctrl-C.

    It waits at least as long as the caller works, who then works at most half of the time. Ctrl-C
    raises KeyboardInterrupt. It also ends this if a library swallows the exception, as happens if
    it is raised while C code calls Python.
    """
    from jbench.store.follow import stamp
    from jbench.store.manifest import MANIFEST

    interrupts = []
    seen = None

    def remember(number: int, frame: FrameType | None) -> None:
        interrupts.append(number)  # a threading.Event could deadlock here, as it has a lock
        raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # else the parent process has set another handler
        signal.signal(signal.SIGINT, remember)

    try:
        while not interrupts:
            began = time.monotonic()
            paths = (d.rglob(MANIFEST) for d in directories)
            now = {(path, stamp(path)) for path in chain.from_iterable(paths)}
            if now != seen:
                seen = now
                yield
            time.sleep(max(poll_seconds, time.monotonic() - began))
    finally:
        if signal.getsignal(signal.SIGINT) is remember:
            signal.signal(signal.SIGINT, before)


def open_page(page: Path) -> bool:
    """Opens a page in a browser, if there is a terminal and a display; returns whether it was."""
    shows = sys.stdout.isatty() and has_display() and page.exists()
    return shows and webbrowser.open(page.resolve().as_uri())
