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
    algorithms,
    checking,
    data,
    demo,
    encoders,
    export,
    imports,
    leaderboard,
    output,
    policies,
    report,
    results,
    sweep,
    tail,
    tasks,
    train,
)
from jbench.errors import RequestError, WorkError

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


_OLD_NAME = "train-agent"
"""How older versions called `train`."""

_COMMANDS: dict[str, dict[Callable[..., None], str]] = {
    "Experiment": {
        demo.demo: "demo --results demo-results",
        data.collect: "collect --steps 100k",
        encoders.train_dae: "train-dae --task face_direction --latent 12",
        encoders.train_encoder: "train-encoder --kind pca --latent 12",
        train.train: "train --algo td3 --encoder dae12 --seeds 0-4 --steps 1M",
        sweep.sweep: "sweep question --dry-run",
        report.report: "report --results reference --claims",
    },
    "Policies": {
        policies.evaluate: "evaluate reference/face_direction/ddpg/full",
        policies.render: "render heuristic --task move_to_pose --out pose.gif",
        policies.view: "view heuristic --task move_to_pose",
        export.export: "export reference/face_direction/ddpg/full --out policy.onnx",
    },
    "Lists": {
        algorithms.algorithms: "algorithms td3",
        tasks.tasks: "tasks dmc:cheetah-run",
        data.datasets: "datasets",
        results.runs: "runs --algo td3 --status finished",
        tail.tail: "tail --algo td3 --last 10",
        results.query: "query 'SELECT run, count(*) FROM episodes GROUP BY run'",
        leaderboard.leaderboard: "leaderboard reference",
    },
    "Database": {
        imports.import_: "import --from csv --seed-column seed --task face_direction --algo ppo "
        "FILE",
        results.merge: "merge other-results",
        checking.reproduce: "reproduce reference/face_direction/td3/dae12/s00 --episodes 1",
        results.verify: "verify --results reference",
        results.repair: "repair --dry-run",
    },
}
"""The commands by the headings of the help, and an example of each."""

for heading, commands in _COMMANDS.items():
    for command, example in commands.items():
        name = command.__name__.rstrip("_").replace("_", "-")
        add = partial(
            app.command, cls=_Command, epilog=f"Example: jbench {example}", rich_help_panel=heading
        )
        add(name)(command)
        if command is train.train:
            add(_OLD_NAME, hidden=True)(command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code: 0 done, 1 work failed, 2 wrong request."""
    # Most commands render nothing; without this, a machine without a display gets a warning.
    os.environ.setdefault("MUJOCO_GL", "disable")
    arguments = sys.argv[1:] if arguments is None else arguments
    as_json, output.Output.has_document = "--json" in arguments, False
    try:
        answer = app(arguments, prog_name="jbench", standalone_mode=False)
        # typer returns this on Ctrl-C.
        if answer == 128 + signal.SIGINT:
            raise KeyboardInterrupt
        sys.stdout.flush()
        return answer if isinstance(answer, int) else 0
    except typer.TyperException as error:
        return _failed(_refusal(error, arguments), 2, as_json)
    except (RequestError, WorkError) as error:
        return _failed(str(error), error.exit_code, as_json)
    except (KeyboardInterrupt, typer.Abort):
        return _ended("Stopped. The same command continues from the last commit, if any.", 1)
    except BrokenPipeError:
        return 0
    except SystemExit as end:
        # typer and rich exit with 1 when the reader closes the pipe, as `head` does.
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        return 0
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        return _failed(f"the system reports: {error.strerror or error}{where}.", 1, as_json)
    finally:
        _discard_unwritten()


_COMMANDS_ELSEWHERE = {
    **{"encoders": "query 'FROM encoders'", "list": "runs", "ls": "runs", "plot": "report"},
    **{f"train-{kind}": f"train-encoder --kind {kind}" for kind in names.ENCODER_KINDS},
}
"""Commands that users may look for, and what to type instead."""

_OPTIONS_ELSEWHERE = {
    **{"--n-envs": "--environments", "--num-envs": "--environments", "--env": "--task"},
    **{"--timesteps": "--steps", "--total-timesteps": "--steps"},
    **{"--lr": "--set learning_rate=VALUE", "--kind": "train-encoder --kind"},
}
"""Options that users may know from other programs or commands, and what to type instead."""


def _refusal(error: typer.TyperException, arguments: Sequence[str]) -> str:
    """Returns what is wrong with the arguments, and the help that lists the right ones."""
    message = " ".join(error.format_message().replace("Value error, ", "").split()).rstrip(".")
    context = getattr(error, "ctx", None)
    if context is None or context.parent is None:
        if arguments and arguments[0] in _COMMANDS_ELSEWHERE:
            here = _COMMANDS_ELSEWHERE[arguments[0]]
            message = f"No such command '{arguments[0]}'; type jbench {here} instead"
        if arguments and any(arguments[0] == info.name for info in app.registered_commands):
            help_ = f"jbench {arguments[0]} --help lists the options and shows an example."
        else:
            help_ = "jbench --help lists the commands."
    else:
        from jbench.settings.algorithms import SETTINGS

        option = getattr(error, "option_name", "")
        name = option.removeprefix("--").replace("-", "_")
        is_setting = any(name in settings.model_fields for settings in SETTINGS.values())
        instead = _OPTIONS_ELSEWHERE.get(option, f"--set {name}=VALUE" if is_setting else "")
        first = instead.partition(" ")[0]
        if first and (
            not first.startswith("--")
            or any(first in parameter.opts for parameter in context.command.params)
        ):
            message = f"No such option: {option}; type {instead} instead"
        elif context.info_name == "report" and "unexpected extra argument" in message:
            message += ": type --curves FILE, or --results DIR"
        help_ = f"jbench {context.info_name} --help lists the options and shows an example."
    return f"{message}{'' if message.endswith('?') else ';'} {help_}"


def _failed(sentence: str, exit_code: int, as_json: bool) -> int:
    """Prints an error, also as the JSON document if none was printed; returns the exit code."""
    if as_json and not output.Output.has_document:
        with contextlib.suppress(OSError, WorkError):
            output.Output(as_json=True).document({"error": sentence})
    return _ended(f"Error: {sentence}", exit_code)


def _ended(sentence: str, exit_code: int) -> int:
    """Prints the last sentence, if stderr is writable; returns the exit code."""
    with contextlib.suppress(OSError):
        print(output.printable(sentence), file=sys.stderr, flush=True)
    return exit_code


def _discard_unwritten() -> None:
    """Discards output that can't be written; otherwise Python fails when it exits."""
    for stream in filter(None, (sys.__stdout__, sys.__stderr__)):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
