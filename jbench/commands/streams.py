"""The standard streams: those that the parent has closed, and those whose reader has gone.

A list ends if nobody reads it any more, as after `head`. Work continues without output.
"""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from jbench.errors import WorkError

_outlives_reader = False
"""Whether the command continues if nobody reads its output any more."""


def begin(*, outlives_reader: bool) -> None:
    """Sets up the streams of a command that begins.

    Every character can be written: what an encoding lacks is replaced. So it is where a terminal or
    a pipe is not UTF-8, and with names of files that are not.
    """
    global _outlives_reader
    _outlives_reader = outlives_reader
    _open_closed()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _open_closed() -> None:
    """Opens the streams that the parent has closed, as `>&-` does, to the null device.

    Else the next file that is opened gets the number of a standard stream, and what other programs
    and libraries print is written to this file.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is not None:
            continue

        mode = "w"
        if number == 0:
            mode = "r"

        stream = open(os.devnull, mode, encoding="utf-8")  # noqa: SIM115
        if stream.fileno() == number:
            os.set_inheritable(number, True)  # as standard streams are

        setattr(sys, name, stream)


@contextmanager
def writing() -> Iterator[None]:
    """Turns OS errors of the streams into a WorkError.

    If the reader of a pipe has gone, a list ends by the exception of the pipe, which is left to the
    caller. Work continues: whatever else it prints is thrown away.
    """
    try:
        yield
    except (BrokenPipeError, SystemExit) as end:
        if not (_outlives_reader and reader_has_gone(end)):
            raise
        throw_away_unread()
    except OSError as error:
        raise WorkError(f"The output can't be written ({error.strerror}).") from None


def reader_has_gone(end: BaseException) -> bool:
    """Returns whether an exception says that nobody reads a pipe any more.

    typer and rich then exit with 1.
    """
    return BrokenPipeError in (type(end), type(end.__context__))


def throw_away_unread() -> None:
    """Lets the null device take what can't be written, now and when Python exits."""
    for stream in filter(None, (sys.__stdout__, sys.__stderr__)):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
