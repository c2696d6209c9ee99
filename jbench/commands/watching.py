"""Watches results directories until Ctrl-C, for `jbench report --watch`."""

import contextlib
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from jbench.report.request import Request
from jbench.store.database import Results
from jbench.store.follow import LOOK_EVERY
from jbench.store.manifest import MANIFEST


@dataclass
class Interrupt:
    """Whether Ctrl-C was received.

    A threading.Event could deadlock, since the signal handler would take its lock.
    """

    received: bool = False


@contextlib.contextmanager
def remembered_interrupt() -> Iterator[Interrupt]:
    """Records Ctrl-C, which still raises KeyboardInterrupt.

    Libraries sometimes swallow the exception, if it is raised while their C code calls Python.
    """
    interrupt = Interrupt()

    def remember(number: int, frame: FrameType | None) -> None:
        interrupt.received = True
        raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler:  # the parent process has set another handler
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
    """Yields at once, and again whenever a record has been committed.

    Between two results it waits at least as long as the caller worked on the first one, so that the
    caller works at most half of the time.

    Args:
        request: if it compares results directories, these are watched as well.
        look_every: minimum seconds between two looks.
    """
    directories = [
        results.path,
        *(Path(text) for text in request.compare or () if Path(text).is_dir()),
    ]
    seen = None
    while not interrupt.received:
        now = fingerprint(directories)
        if now == seen:
            time.sleep(look_every)
            continue
        seen = now
        began = time.monotonic()
        yield
        time.sleep(max(look_every, time.monotonic() - began))


def fingerprint(directories: list[Path]) -> set[tuple[Path, int, int]]:
    """Returns path, time and size of the manifests below these directories."""
    seen = set()
    for directory in directories:
        for kind in ("runs", "encoders", "evaluations", "imports"):
            for path in (directory / kind).rglob(MANIFEST):
                with contextlib.suppress(OSError):  # it was removed meanwhile
                    stat = path.stat()
                    seen.add((path, stat.st_mtime_ns, stat.st_size))
    return seen
