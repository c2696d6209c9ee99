"""Command-line entry point. Heavy imports are deferred to the command bodies."""

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, Any

import typer

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
from jbench.commands.grouped_help import Command, GroupedCommands
from jbench.errors import RequestError, WorkError

app = typer.Typer(
    name="jbench",
    cls=GroupedCommands,
    help="The Jitterbug problem: one motor, five tasks, full or reduced-order observations, "
    "and the tasks of other robots.",
    epilog="The commands collect, train-dae, train --encoder dae12 and report, in this order, are "
    "the paper's experiment on one task; --steps and --seeds make it shorter.",
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    suggest_commands=False,
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
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Shows the help if no command is typed."""
    if context.invoked_subcommand is None:
        print(context.get_help())


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
            app.command,
            cls=Command,
            epilog=f"Example: jbench {example}",
            rich_help_panel=heading,
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


_OPTIONS_ELSEWHERE = {
    **dict.fromkeys(("--total-timesteps", "--timesteps", "--n-timesteps"), "--steps"),
    **dict.fromkeys(("--env", "--env-id", "--environment-id"), "--task"),
    **dict.fromkeys(("--n-envs", "--num-envs"), "--environments"),
    **dict.fromkeys(("--algorithm", "--agent"), "--algo"),
    **dict.fromkeys(("--logdir", "--output", "--out-dir"), "--results"),
    **dict.fromkeys(("--eval-freq", "--eval-every"), "--evaluate-every"),
    **dict.fromkeys(("--eval-episodes", "--n-eval-episodes"), "--evaluate-episodes"),
    **{"--cuda": "--device", "--track": "--log", "--lr": "--set learning_rate=VALUE"},
    **{"--net-arch": "--set hidden_layers=VALUE", "--n-steps": "--set n_steps=VALUE"},
}
"""Options of similar tools, and what to type here."""


_COMMANDS_ELSEWHERE = {
    **{"enjoy": "render", "play": "render", "eval": "evaluate", "test": "evaluate"},
    **{"list": "runs", "ls": "runs", "plot": "report", "sql": "query"},
    **{"encoders": "query 'FROM encoders'", "watch": "tail", "resume": "train"},
    **{f"train-{kind}": f"train-encoder --kind {kind}" for kind in names.ENCODER_KINDS},
}
"""Commands of similar tools, and what to type here."""


def _refusal(error: typer.TyperException, arguments: Sequence[str]) -> str:
    """Returns what is wrong with the arguments, and the help that lists the right ones."""
    context = getattr(error, "ctx", None)
    message = error.format_message()
    if context is None or context.parent is None:
        verb = arguments[0] if arguments and arguments[0] in _verbs() else ""
        if not verb and (here := _command_here(message.partition("'")[2].partition("'")[0])):
            message = f"{message.rstrip('.')}; type jbench {here} instead"
    elif message.startswith("Missing") and len(missing := _missing(context, arguments)) > 1:
        verb, message = context.info_name, f"Missing options {', '.join(missing)}: type all of them"
    elif context.info_name == "report" and "unexpected extra argument" in message:
        verb, message = "report", f"{message}: type --curves FILE, or --results DIR"
    else:
        verb = context.info_name
        options = {option for each in context.command.params for option in each.opts}
        here = _option_here(getattr(error, "option_name", ""))
        if here.partition(" ")[0] in options:
            message = f"{message.split(' (')[0]}; type {here} instead"
        elif len(others := _commands_with(getattr(error, "option_name", ""))) == 1:
            message = f"{message.split(' (')[0]}; jbench {others[0]} has it"
    listed = "the options and shows an example" if verb else "the commands"
    help_ = f"{f'jbench {verb}'.rstrip()} --help lists {listed}."
    return f"{message} {help_}" if message.endswith("?") else f"{message.rstrip('.')}; {help_}"


def _missing(context: Any, arguments: Sequence[str]) -> list[str]:
    """Returns the required options of the command that were not typed."""
    typed = {argument.partition("=")[0] for argument in arguments}
    required = (each for each in context.command.params if each.required)
    return [
        each.opts[0]
        for each in required
        if each.param_type_name == "option" and not typed.intersection(each.opts)
    ]


def _verbs() -> set[str | None]:
    return {command.name for command in app.registered_commands}


def _commands_with(option: str) -> list[str]:
    """Returns the commands that have an option."""
    commands = typer.main.get_command(app).commands.items()  # type: ignore[attr-defined]
    return [
        name
        for name, command in commands
        if not command.hidden and any(option in each.opts for each in command.params)
    ]


def _command_here(elsewhere: str) -> str:
    """Returns the command for one of another tool or a misspelled one; empty if there is none."""
    shown = sorted(str(name) for name in _verbs() - {_OLD_NAME})
    return _COMMANDS_ELSEWHERE.get(elsewhere) or names.closest(elsewhere, shown) or ""


def _option_here(elsewhere: str) -> str:
    """Returns the option for one of another tool or a hyperparameter; empty if there is none."""
    if elsewhere in _OPTIONS_ELSEWHERE:
        return _OPTIONS_ELSEWHERE[elsewhere]
    from jbench.settings.algorithms import SETTINGS

    name = elsewhere.removeprefix("--").replace("-", "_")
    known = any(name in settings.model_fields for settings in SETTINGS.values())
    return f"--set {name}=VALUE" if known else ""


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
