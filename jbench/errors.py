"""Exceptions, each with its exit code."""

import sysconfig
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO


class RequestError(ValueError):
    """A wrong request: one sentence that says what is wrong and what to type instead."""

    exit_code = 2


class NothingYetError(RequestError):
    """There is nothing to report yet; more results may change that."""


class WorkError(RuntimeError):
    """Work that failed although the request was right: one sentence that says what failed."""

    exit_code = 1

    @property
    def reason(self) -> str:
        """What failed, as a clause without what to do."""
        return str(self).rstrip(".")


class ElsewhereError(WorkError):
    """Work that another process is doing, so that it is not done yet."""

    exit_code = 3


class WorkWarning(UserWarning):
    """Something wrong that does not end the work: one sentence."""


@contextmanager
def warning_by(show: Callable[[str], object]) -> Iterator[None]:
    """Shows the sentence of each `WorkWarning` in the block by a function; others as before."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", WorkWarning)
        as_before = warnings.showwarning

        def show_sentence(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if issubclass(category, WorkWarning):
                show(str(message))
            else:
                as_before(message, category, filename, lineno, file, line)

        warnings.showwarning = show_sentence
        yield


ERRORS_OF_OTHERS = (Exception, SystemExit)
"""What code of others may raise where it is called. Also `sys.exit` in an environment, an agent or
a policy fails their work with a message, and does not end jbench."""


def without_exit(error: BaseException) -> Exception:
    """Returns an error that can be raised again: of a `SystemExit`, a WorkError says the same.

    So it does of a `KeyboardInterrupt`, where that is not Ctrl-C.
    """
    if isinstance(error, Exception):
        return error
    made = WorkError(f"Code that jbench called ended the process ({sentence_of_failure(error)}).")
    made.__cause__ = error
    return made


def sentence_of_failure(error: BaseException) -> str:
    """Returns the sentence of a `RequestError` or `WorkError`; of others, type, text and line.

    The line is that of the user's file. The text may have several lines, and is put in one.
    """
    if isinstance(error, RequestError | WorkError):
        return str(error)
    said = type(error).__name__
    text = " ".join(str(error).split())
    if text:
        said += f": {text}"
    return f"{said}{_line_of_user(error)}"


def _line_of_user(error: BaseException) -> str:
    """Returns the last line of a user's own file that led to an error; empty if there is none.

    Files of jbench, of the standard library and of installed packages are not the user's own. The
    text of a `SyntaxError` has its line.
    """
    if isinstance(error, SyntaxError):
        return ""

    ours = (Path(__file__).parent, Path(sysconfig.get_path("stdlib")))
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        file = Path(frame.filename)
        is_installed = "site-packages" in file.parts or "dist-packages" in file.parts
        if file.is_absolute() and not is_installed and not any(map(file.is_relative_to, ours)):
            return f", line {frame.lineno} of {file.name}"

    return ""
