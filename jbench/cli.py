"""Command-line entry point. Heavy imports are deferred to the command bodies."""

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import typer
from typer.core import TyperCommand

from jbench import __version__, names
from jbench.commands import (
    archive,
    catalog,
    checking,
    demo,
    diagnosis,
    encoders,
    export,
    output,
    policies,
    report,
    results,
    runs,
    schemas,
    train,
)
from jbench.errors import RequestError, WorkError
from jbench.settings.algorithms import SETTINGS

app = typer.Typer(
    name="jbench",
    help="The Jitterbug problem: one motor, five tasks, full or reduced-order observations, "
    "and the tasks of other robots.",
    epilog="The commands collect, train-dae, train --encoder dae12 and report, in this order, are "
    "the paper's experiment on one task; --steps and --seeds make it shorter.",
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


def _version(wanted: bool) -> None:
    if wanted:
        from jbench.revision import git_revision

        revision = git_revision()
        print(f"jbench {__version__}" + (f" ({revision})" if revision else ""))
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


class _Command(TyperCommand):
    """A command whose help has placeholders such as SEEDS instead of types."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        for parameter in self.params:
            if getattr(parameter, "is_flag", False):
                parameter.metavar = ""
            elif parameter.metavar is None:
                parameter.metavar = parameter.opts[0].rpartition("-")[2].upper()


_DAE = "Train the paper's denoising autoencoder on a dataset."

_COMMANDS: dict[str, dict[str, Callable[..., None]]] = {
    "Experiment": {
        "demo --results demo-results": demo.demo,
        "collect --steps 100k": catalog.collect,
        "train-dae --task face_direction --latent 12": encoders.train_encoder,
        "train-encoder --kind pca --latent 12": encoders.train_encoder,
        "train --algo td3 --encoder dae12 --seeds 0-4 --steps 1M": train.train,
        "sweep question --dry-run": train.sweep,
        "report --results reference --claims": report.report,
    },
    "Policies": {
        "evaluate reference/face_direction/ddpg/full": policies.evaluate,
        "render heuristic --task move_to_pose --out pose.gif": policies.render,
        "view heuristic --task move_to_pose": policies.view,
        "export reference/face_direction/ddpg/full --out policy.onnx": export.export,
    },
    "Lists": {
        "algorithms td3": catalog.algorithms,
        "tasks dmc:cheetah-run": catalog.tasks,
        "datasets": catalog.datasets,
        "runs --algo td3 --status finished": runs.runs,
        "tail --algo td3 --last 10": runs.tail,
        "query 'SELECT run, count(*) FROM episodes GROUP BY run'": results.query,
        "leaderboard reference": runs.leaderboard,
    },
    "Database": {
        "import --from csv --seed-column seed --task face_direction --algo ppo FILE": (
            results.import_
        ),
        "merge other-results": results.merge,
        "archive results --out results.zip --blind": archive.archive,
        "reproduce reference/face_direction/td3/dae12/s00 --episodes 1": checking.reproduce,
        "verify --results reference": checking.verify,
        "repair --dry-run": results.repair,
    },
    "Help": {
        "doctor": diagnosis.doctor,
        "check random_search:RandomSearch": diagnosis.check,
        "schema train": schemas.schema,
    },
}
"""Each command by an example, which begins with its name, by the headings of the help."""

for heading, commands in _COMMANDS.items():
    for example, command in commands.items():
        name, epilog = example.split()[0], f"Example: jbench {example}"
        add = partial(app.command, cls=_Command, epilog=epilog, rich_help_panel=heading)
        add(name, help=_DAE if name == "train-dae" else None)(command)
        if name == "train":
            add("train-agent", hidden=True)(command)  # as older versions called it


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code: 0 done, 1 work failed, 2 wrong request."""
    # Most commands render nothing; without this, a machine without a display gets a warning.
    os.environ.setdefault("MUJOCO_GL", "disable")
    arguments = sys.argv[1:] if arguments is None else arguments
    output.is_json, output.has_document = "--json" in arguments, False
    output.set_up_streams()
    try:
        answer = app(arguments, prog_name="jbench", standalone_mode=False)
        if answer == 128 + signal.SIGINT:  # as typer answers Ctrl-C
            raise KeyboardInterrupt
        sys.stdout.flush()
        return answer if isinstance(answer, int) else 0
    except typer.TyperException as error:
        return _failed(_refusal(error, arguments), 2)
    except (RequestError, WorkError) as error:
        return _failed(str(error), error.exit_code)
    except (KeyboardInterrupt, typer.Abort):
        with contextlib.suppress(OSError):
            sentence = "Stopped. The same command continues from the last commit, if any."
            print(sentence, file=sys.stderr, flush=True)
        return 1
    except (BrokenPipeError, SystemExit) as end:
        # typer and rich exit with 1 when the reader closes the pipe, as `head` does.
        if BrokenPipeError not in (type(end), type(end.__context__)):
            raise
        return 0
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        return _failed(f"the system reports: {error.strerror or error}{where}.", 1)
    finally:
        output.is_json = False
        for stream in filter(None, (sys.__stdout__, sys.__stderr__)):
            try:
                stream.flush()
            except OSError:  # else Python fails to write the rest when it exits
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


_ELSEWHERE = {
    **{"encoders": "query 'FROM encoders'", "list": "runs", "ls": "runs", "plot": "report"},
    **{f"train-{kind}": f"train-encoder --kind {kind}" for kind in names.ENCODER_KINDS},
    **{"--n-envs": "--environments", "--num-envs": "--environments", "--timesteps": "--steps"},
    **{"--env": "--task", "--total-timesteps": "--steps", "--lr": "--set learning_rate=VALUE"},
}
"""Commands and options that users may look for, and what to type instead."""


def _refusal(error: typer.TyperException, arguments: Sequence[str]) -> str:
    """Returns what is wrong with the arguments, and the help that lists the right ones."""
    message = " ".join(error.format_message().replace("Value error, ", "").split()).rstrip(".")
    context = getattr(error, "ctx", None)
    if context is None or context.parent is None:
        verb = next(iter(arguments), "")
        if verb in _ELSEWHERE:
            message = f"No such command '{verb}'; type jbench {_ELSEWHERE[verb]} instead"
    else:
        verb, option = context.info_name, getattr(error, "option_name", "")
        name = option.removeprefix("--").replace("-", "_")
        is_setting = any(name in settings.model_fields for settings in SETTINGS.values())
        instead = _ELSEWHERE.get(option, f"--set {name}=VALUE" if is_setting else "")
        if any(instead.partition(" ")[0] in p.opts for p in context.command.params):
            message = f"No such option: {option}; type {instead} instead"
        elif verb == "report" and "unexpected extra argument" in message:
            message += ": type --curves FILE, or --results DIR"
        typed = {word.partition("=")[0] for word in arguments}
        required = [p.opts for p in context.command.params if p.required and "-" in p.opts[0]]
        missing = [opts[0] for opts in required if typed.isdisjoint(opts)]
        if message.startswith("Missing option") and len(missing) > 1:
            message = f"Missing options {names.in_prose(missing, 'and')}"
    help_ = "jbench --help lists the commands."
    if any(verb == command.name for command in app.registered_commands):
        help_ = f"jbench {verb} --help lists the options and shows an example."
    return f"{message}{'' if message.endswith('?') else ';'} {help_}"


def _failed(sentence: str, exit_code: int) -> int:
    """Prints an error, also as the JSON document if none was printed; returns the exit code."""
    with contextlib.suppress(OSError, WorkError):
        if not output.has_document:
            output.document({"error": sentence})
    with contextlib.suppress(OSError):
        print(output.printable(f"Error: {sentence}"), file=sys.stderr, flush=True)
    return exit_code
