"""Watches results directories until Ctrl-C, for `jbench report --watch`."""

import hashlib
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
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


@contextmanager
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
    seen: str | None = None
    while not interrupt.received:
        now = fingerprint(directories)
        if now == seen:
            time.sleep(look_every)
            continue
        seen = now
        began = time.monotonic()
        yield
        time.sleep(max(look_every, time.monotonic() - began))


def fingerprint(directories: list[Path]) -> str:
    """Returns a hash that changes whenever a manifest below these directories does."""
    digest = hashlib.sha256()
    for directory in directories:
        for kind in ("runs", "encoders", "evaluations", "imports"):
            for path in sorted((directory / kind).rglob(MANIFEST)):
                try:
                    stat = path.stat()
                except OSError:
                    continue  # it was removed meanwhile
                digest.update(f"{path} {stat.st_mtime_ns} {stat.st_size}\n".encode())
    return digest.hexdigest()
