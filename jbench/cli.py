"""Command-line entry point. Heavy imports are deferred to the command bodies."""

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Annotated

import typer

from jbench import __version__
from jbench.commands import (
    data,
    encoders,
    export,
    imports,
    policies,
    report,
    results,
    sweep,
    tail,
    train,
)
from jbench.commands.output import printable
from jbench.errors import RequestError, WorkError

app = typer.Typer(
    name="jbench",
    help="The Jitterbug problem: one motor, five tasks, full or reduced-order observations.",
    epilog="Typed in this order with nothing else, collect, train-dae, train --encoder 12 and "
    "report are the paper's experiment on one task; --steps and --seeds ask for less.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"jbench {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Global options."""


command: Callable[..., None]
for command in (data.collect, data.datasets, export.export):
    app.command()(command)
app.command("train-dae")(encoders.train_dae)
app.command("train-encoder")(encoders.train_encoder)
app.command("train")(train.train)
app.command("train-agent", help="The same as train.")(train.train)
for command in (sweep.sweep, policies.evaluate, policies.render, policies.view):
    app.command()(command)
app.command("import")(imports.import_)
app.command()(report.report)
for command in (*results.COMMANDS, tail.tail):
    app.command()(command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code: 0 done, 1 work failed, 2 wrong request."""
    # Most commands render nothing; without this, a machine without a display gets a warning.
    os.environ.setdefault("MUJOCO_GL", "disable")
    try:
        answer = app(arguments, prog_name="jbench", standalone_mode=False)
        # typer returns this on Ctrl-C.
        if answer == 128 + signal.SIGINT:
            raise KeyboardInterrupt
        sys.stdout.flush()
        return answer if isinstance(answer, int) else 0
    except typer.TyperException as error:
        message = error.format_message().rstrip(".")
        return _ended(f"Error: {message}; jbench --help shows what there is.", 2)
    except (RequestError, WorkError) as error:
        return _ended(f"Error: {error}", error.exit_code)
    except (KeyboardInterrupt, typer.Abort):
        return _ended("Stopped. What was committed is kept; type the same command again.", 1)
    except BrokenPipeError:
        return 0
    except SystemExit as end:
        # typer and rich exit with 1 when the reader closes the pipe, as `head` does.
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        return 0
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        return _ended(f"Error: the system reports: {error.strerror or error}{where}.", 1)
    finally:
        _discard_unwritten()


def _ended(sentence: str, exit_code: int) -> int:
    """Prints the last sentence, if stderr is writable; returns the exit code."""
    with contextlib.suppress(OSError):
        print(printable(sentence), file=sys.stderr, flush=True)
    return exit_code


def _discard_unwritten() -> None:
    """Discards output that can't be written; otherwise Python fails when it exits."""
    for stream in filter(None, (sys.__stdout__, sys.__stderr__)):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


if __name__ == "__main__":
    sys.exit(main())
