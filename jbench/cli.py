"""Command-line entry point. Heavy imports are deferred to the command bodies."""

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Annotated

import typer

from jbench import __version__, names
from jbench.commands import data, encoders, parsing, policies, report, results, sweep
from jbench.commands.options import (
    RESULTS,
    AugmentOption,
    JobsOption,
    JsonOption,
    ResultsOption,
    RetryOption,
    TaskOption,
    complete,
)
from jbench.commands.output import Output, printable
from jbench.errors import RequestError, WorkError
from jbench.seeds import parse_seeds

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
    """Options before the verb."""


verb: Callable[..., None]
for verb in (data.collect, data.datasets, data.export):
    app.command()(verb)
app.command("train-dae")(encoders.train_dae)
app.command("train-encoder")(encoders.train_encoder)


@app.command("train")
@app.command("train-agent", help="The same as train.")
def train(
    algo: Annotated[
        str,
        typer.Option(
            help=f"Algorithm: {', '.join(names.ALGORITHMS)}.",
            autocompletion=complete(*names.ALGORITHMS),
        ),
    ] = "ddpg",
    task: TaskOption = "face_direction",
    encoder: Annotated[
        str,
        typer.Option(
            help="Representation of the observation: none, KIND:LATENTS (the newest encoder), the "
            "number of latents of a DAE, the id of an encoder, or ofeN (N features learned "
            "with the agent).",
        ),
    ] = "none",
    seeds: Annotated[str, typer.Option(help="Seeds to train, such as 0-9 or 0,2,5-7.")] = "0-9",
    steps: Annotated[str, typer.Option(help="Number of control steps of each run.")] = "5e6",
    settings: Annotated[
        str,
        typer.Option(
            help="Hyperparameters: published (the paper's Table 1), script (the authors' script, "
            "which differs) or sb3 (stable-baselines3's defaults where Table 1 is silent).",
            autocompletion=complete(*names.BASES),
        ),
    ] = "published",
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="Set a hyperparameter, as NAME=VALUE; repeatable."),
    ] = None,
    time_limit: Annotated[
        str,
        typer.Option(
            help="Treat the time limit as a truncation (bootstrap) or as terminal (terminal).",
            autocompletion=complete(*names.TIME_LIMITS),
        ),
    ] = "bootstrap",
    evaluate_every: Annotated[
        str, typer.Option(help="Control steps between evaluations.")
    ] = "50000",
    evaluate_episodes: Annotated[
        int, typer.Option(help="Episodes per evaluation (0 disables it).")
    ] = 10,
    augment: AugmentOption = None,
    robots: Annotated[
        int,
        typer.Option(help="Number of augmented robots to train on in sequence, from --augment on."),
    ] = 1,
    engine: Annotated[
        str,
        typer.Option(
            help="Training engine: batched (many seeds at a time) or sb3 (stable-baselines3).",
            autocompletion=complete(*names.ENGINES),
        ),
    ] = "batched",
    device: Annotated[
        str,
        typer.Option(
            help="Device of the batched engine: auto, cpu or cuda.",
            autocompletion=complete(*names.DEVICES),
        ),
    ] = "auto",
    precision: Annotated[
        str,
        typer.Option(
            help="Precision of the batched engine: float32, bfloat16, or on a GPU tf32.",
            autocompletion=complete(*names.PRECISIONS),
        ),
    ] = "float32",
    environments: Annotated[
        int | None,
        typer.Option(help="Parallel environments per seed (default: those of the algorithm)."),
    ] = None,
    checkpoint_every: Annotated[
        float,
        typer.Option(min=0, help="Minimum seconds between checkpoints of the batched engine."),
    ] = names.CHECKPOINT_EVERY,
    retry_failed: RetryOption = False,
    jobs: JobsOption = 0,
    results: ResultsOption = RESULTS,
    json: JsonOption = False,
) -> None:
    """Train agents, one run for each seed; runs that are finished are not repeated."""
    from jbench.commands import display
    from jbench.training.request import find_device, request_runs
    from jbench.training.status import failures_among, plan

    output, place = Output(json), parsing.results_to_write(results)
    chosen = names.known("engine", engine, names.ENGINES)
    products = names.known("precision", precision, names.PRECISIONS)
    place_of_work = find_device(chosen, names.known("device", device, names.DEVICES), products)
    runs = request_runs(
        place,
        algo=names.known("algorithm", algo, names.ALGORITHMS),
        task=names.known("task", task, names.TASKS),
        encoder=encoder,
        seeds=parse_seeds(seeds),
        steps=parsing.count("--steps", steps),
        base=names.known("value of --settings", settings, names.BASES),
        overrides=set_ or [],
        time_limit=names.known("value of --time-limit", time_limit, names.TIME_LIMITS),
        evaluate_every=parsing.count("--evaluate-every", evaluate_every),
        evaluate_episodes=evaluate_episodes,
        augment=parsing.augmented(augment),
        robots=robots,
        engine=chosen,
        precision=products,
        parallel=environments,
    )
    planned = plan(runs, place)
    display.show_plan(planned, retry_failed, output)
    failures: dict[str, str] = {}
    if to_do := planned.to_do(retry_failed):
        failures |= display.train_with_progress(
            to_do, place, parsing.all_cores(jobs), output, place_of_work, checkpoint_every
        )
    for run_id, reason in failures.items():
        output.warn(f"the run {run_id} failed: {reason}")
    failures |= failures_among(runs, place)
    display.show_runs(runs, place, output)
    output.say("Next: jbench report")
    output.document({"runs": [run.id for run in runs], "failures": failures})
    if failures:
        raise WorkError(f"{len(failures)} of {len(runs)} runs failed; --retry-failed retries them.")


for verb in (sweep.sweep, policies.evaluate, policies.render, policies.view):
    app.command()(verb)


app.command()(report.report)
for verb in results.VERBS:
    app.command()(verb)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code: 0 done, 1 work failed, 2 wrong request."""
    # Nothing is drawn by these verbs; without this, a machine without a display gets a warning.
    os.environ.setdefault("MUJOCO_GL", "disable")
    try:
        answer = app(arguments, prog_name="jbench", standalone_mode=False)
        # What typer makes of Ctrl-C.
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
        # typer and rich exit with 1 when the reader of our output has left, as `head` does.
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        return 0
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        return _ended(f"Error: the system reports: {error.strerror or error}{where}.", 1)
    finally:
        _discard_unwritten()


def _ended(sentence: str, exit_code: int) -> int:
    """Prints the last sentence, if standard error takes it; returns the exit code."""
    with contextlib.suppress(OSError):
        print(printable(sentence), file=sys.stderr, flush=True)
    return exit_code


def _discard_unwritten() -> None:
    """Discards output that can't be written: else Python fails when it exits."""
    for stream in filter(None, (sys.__stdout__, sys.__stderr__)):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


if __name__ == "__main__":
    sys.exit(main())
