"""Command-line entry point. Heavy imports are deferred to the command bodies."""

import contextlib
import os
import signal
import sys
from collections.abc import Sequence

import typer

from jbench import __version__
from jbench.commands import output, streams
from jbench.commands.refusals import refusal
from jbench.commands.verbs import Verb, Verbs
from jbench.errors import RequestError, WorkError, warning_by

_LISTS = "Lists"  # heading of the verbs that only print

_VERBS = {
    verb.name: verb
    for verb in (
        Verb("demo --results demo-results", "demo:demo", "Experiment"),
        Verb("collect --steps 100k", "collect:collect", "Experiment"),
        Verb(
            "train-dae --task face_direction --latent 12",
            "encoders:train_encoder",
            "Experiment",
            summary="Train the paper's denoising autoencoder on a dataset.",
        ),
        Verb("train-encoder --kind pca --latent 12", "encoders:train_encoder", "Experiment"),
        Verb(
            "train --algo td3 --encoder dae12 --seeds 0-4 --steps 1M", "train:train", "Experiment"
        ),
        Verb(
            "train-agent --algo td3 --encoder dae12 --seeds 0-4 --steps 1M",
            "train:train",
            "Experiment",
            hidden=True,  # an older name
        ),
        Verb("sweep question --dry-run", "sweep:sweep", "Experiment"),
        Verb("report --results reference --claims", "report:report", "Experiment"),
        Verb("evaluate reference/face_direction/ddpg/full", "policies:evaluate", "Policies"),
        Verb("render heuristic --task move_to_pose --out pose.gif", "policies:render", "Policies"),
        Verb("view heuristic --task move_to_pose", "policies:view", "Policies"),
        Verb(
            "export reference/face_direction/ddpg/full --out policy.onnx",
            "export:export",
            "Policies",
        ),
        Verb("algorithms td3", "catalog:algorithms", _LISTS),
        Verb("tasks dmc:cheetah-run", "catalog:tasks", _LISTS),
        Verb("datasets", "catalog:datasets", _LISTS),
        Verb("runs --algo td3 --status finished", "runs:runs", _LISTS),
        Verb("tail --algo td3 --last 10", "tail:tail", _LISTS),
        Verb("query 'SELECT run, count(*) FROM episodes GROUP BY run'", "results:query", _LISTS),
        Verb("leaderboard reference", "leaderboard:leaderboard", _LISTS),
        Verb(
            "import --from csv --seed-column seed --task face_direction --algo ppo FILE",
            "results:import_",
            "Database",
        ),
        Verb("merge other-results", "results:merge", "Database"),
        Verb("archive --out results.zip --blind", "archive:archive", "Database"),
        Verb(
            "reproduce reference/face_direction/td3/dae12/s00 --episodes 1",
            "checking:reproduce",
            "Database",
        ),
        Verb("verify --results reference", "checking:verify", "Database"),
        Verb("repair --dry-run", "results:repair", "Database"),
        Verb("doctor", "diagnosis:doctor", "Help"),
        Verb("check random_search:RandomSearch", "diagnosis:check", "Help"),
        Verb("schema train", "schemas:schema", "Help"),
    )
}
"""Each verb by an example, in the order of the help."""


class _Root(Verbs):
    """The group of all verbs."""

    verbs = _VERBS


app = typer.Typer(
    name="jbench",
    cls=_Root,
    help="The Jitterbug problem: one motor, five tasks, full or reduced-order observations, "
    "and the tasks of other robots.",
    epilog="The commands collect, train-dae, train, train --encoder dae12 and report, in this "
    "order, are the paper's experiment on one task; --steps and --seeds make it shorter.",
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


def _version(wanted: bool) -> None:
    """Prints the version, with the git revision of a clone, and exits."""
    if wanted:
        from jbench.revision import git_revision

        text = f"jbench {__version__}"
        revision = git_revision()
        if revision:
            text += f" ({revision})"

        print(text)
        raise typer.Exit


@app.callback()
def _root(
    context: typer.Context,
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Show the version and exit."
    ),
) -> None:
    """Shows the help if no command is typed."""
    if context.invoked_subcommand is None:
        context.get_help()


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line.

    Returns the exit code: 0 done, 1 work failed, 2 wrong request, 3 another process does the work,
    130 stopped by Ctrl-C. Without arguments, those of the process are run, and Ctrl-C ends it as a
    signal does, so that a loop of a shell ends too.
    """
    code = _run(sys.argv[1:] if arguments is None else arguments)
    if code == _INTERRUPTED and arguments is None and os.name == "posix":
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)
    return code


_INTERRUPTED = 128 + signal.SIGINT  # as shells call it


def _run(arguments: Sequence[str]) -> int:
    """Runs a verb; returns its exit code without raising."""
    # Most commands render nothing; without this, a machine without a display gets a warning.
    os.environ.setdefault("MUJOCO_GL", "disable")
    streams.begin(outlives_reader=_is_work(arguments))
    output.begin(arguments)
    try:
        with output.documents_alone(), warning_by(output.warn_once):
            answer = app(arguments, prog_name="jbench", standalone_mode=False)
        if answer == _INTERRUPTED:  # as typer answers Ctrl-C
            raise KeyboardInterrupt
        with streams.writing():
            sys.stdout.flush()
        if isinstance(answer, int):
            return answer
        return 0

    except typer.TyperException as error:
        return _failed(refusal(error, arguments, _VERBS), 2)
    except (RequestError, WorkError) as error:
        return _failed(str(error), error.exit_code)

    except (KeyboardInterrupt, typer.Abort):
        with contextlib.suppress(OSError):
            output.say_stopped()
        return _INTERRUPTED

    except (BrokenPipeError, SystemExit) as end:
        if not streams.reader_has_gone(end):
            raise
        if _is_work(arguments):  # which code of others has ended by printing
            return _failed("The output can't be written (Broken pipe).", 1)
        return 0

    except OSError as error:
        problem = f"the system reports: {error.strerror or error}"
        if error.filename:
            problem += f" ({error.filename})"
        return _failed(f"{problem}.", 1)

    finally:
        output.is_json = False
        streams.throw_away_unread()


def _is_work(arguments: Sequence[str]) -> bool:
    """Returns whether a command does work, and not only prints a list or a help."""
    verb = _VERBS.get(next(iter(arguments), ""))
    return verb is not None and verb.heading != _LISTS and "--help" not in arguments


def _failed(sentence: str, exit_code: int) -> int:
    """Prints an error, also as the JSON document if none was printed; returns the exit code."""
    with contextlib.suppress(OSError, WorkError):
        if not output.has_document:
            output.document({"error": sentence})
    with contextlib.suppress(OSError):
        print(output.printable(f"Error: {sentence}"), file=sys.stderr, flush=True)
    return exit_code
