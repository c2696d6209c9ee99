"""The verbs: parse, call one function, print. What is heavy is imported inside the functions."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from jbench import __version__, cli_policies, names, parsing
from jbench.errors import RequestError, WorkError
from jbench.options import AugmentOption, JsonOption, ResultsOption, TaskOption, complete
from jbench.output import Output, short

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
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print it.")
    ] = False,
) -> None:
    """Options before the verb."""


@app.command()
def collect(
    steps: Annotated[str, typer.Option(help="Control steps, a multiple of 1000.")] = "5e6",
    seed: Annotated[int, typer.Option(help="Of every draw.")] = 0,
    threads: Annotated[int, typer.Option(help="Simulations at a time; 0 for all cores.")] = 0,
    augment: AugmentOption = None,
    results: ResultsOption = Path("results"),
    json: JsonOption = False,
) -> None:
    """Collect a random-policy dataset that serves all five tasks."""
    from jbench import display
    from jbench.datasets import DatasetSettings
    from jbench.datasets import collect as collect_dataset
    from jbench.store import Results
    from jbench.validation import validated

    output = Output(json)
    settings = validated(
        DatasetSettings,
        "the dataset",
        steps=parsing.count("--steps", steps),
        seed=parsing.seed(seed),
        augment=parsing.augmented(augment),
    )
    place = Results(results)
    before = place.find("dataset", settings.id)
    if before is not None and before.status == "finished":
        output.say(f"The dataset {settings.id} is finished already; nothing to do.")
    with output.progress("collect", settings.steps, "control steps") as progress:
        record = collect_dataset(settings, place, parsing.all_cores(threads), progress.update)
    size = sum(entry.bytes for entry in record.manifest.files)
    output.say(
        f"Dataset {record.id}: {settings.steps:,} control steps, {size / 1e6:.1f} MB, in "
        f"{record.path}. Next: jbench train-dae"
    )
    output.document(display.described(record, bytes=size))


@app.command("train-dae")
def train_dae(
    task: Annotated[
        str,
        typer.Option(
            help=f"{', '.join(names.TASKS)}, or all.",
            autocompletion=complete("all", *names.TASKS),
        ),
    ] = "face_direction",
    latent: Annotated[int, typer.Option(help="Number of latents, 1 to the features.")] = 12,
    dataset: Annotated[str | None, typer.Option(help="Its id; else the newest.")] = None,
    noise: Annotated[float, typer.Option(help="Sd of the noise on a scaled feature.")] = 0.1,
    epochs: Annotated[int, typer.Option(help="Passes over the training rows.")] = 200,
    batch: Annotated[int, typer.Option(help="Rows in a step.")] = 8192,
    learning_rate: Annotated[
        float, typer.Option(help="Of Adam; the authors' script had 5e-4.")
    ] = 1e-3,
    seed: Annotated[int, typer.Option(help="Of weights, order, noise and split.")] = 0,
    results: ResultsOption = Path("results"),
    json: JsonOption = False,
) -> None:
    """Train the paper's denoising autoencoder on a dataset."""
    from jbench import display
    from jbench.datasets import find_dataset
    from jbench.encoders.training import EncoderSettings, train_encoder
    from jbench.store import Results
    from jbench.validation import validated

    output, place = Output(json), Results(results)
    tasks = names.TASKS if task == "all" else (parsing.known("task", task, (*names.TASKS, "all")),)
    source = find_dataset(place, dataset)
    wanted = [
        validated(
            EncoderSettings,
            "the autoencoder",
            task=name,
            dataset=source.id,
            latents=latent,
            noise=noise,
            epochs=epochs,
            batch=batch,
            learning_rate=learning_rate,
            seed=parsing.seed(seed),
        )
        for name in tasks
    ]
    records = []
    for settings in wanted:
        before = place.find("encoder", settings.id)
        if before is not None and before.status == "finished":
            output.say(f"The encoder {settings.id} is finished already; nothing to do.")
        elif before is not None:
            output.say(f"The encoder {settings.id} was interrupted; it starts over.")
        with output.progress(f"train-dae {settings.task}", epochs, "epochs") as progress:
            records.append(train_encoder(settings, source, place, progress.update))
        display.show_encoder(records[-1], output)
        output.say(f"Next: jbench train --task {settings.task} --encoder {latent}")
    output.document({"encoders": [display.described(record) for record in records]})


@app.command("train")
@app.command("train-agent", help="The same as train.")
def train(
    algo: Annotated[
        str,
        typer.Option(
            help=f"{', '.join(names.ALGORITHMS)}.", autocompletion=complete(*names.ALGORITHMS)
        ),
    ] = "ddpg",
    task: TaskOption = "face_direction",
    encoder: Annotated[
        str, typer.Option(help="none, a number of latents (the newest such DAE), or an id.")
    ] = "none",
    seeds: Annotated[str, typer.Option(help="Like 0-9, or 0,2,5-7.")] = "0-9",
    steps: Annotated[str, typer.Option(help="Control steps of each run.")] = "5e6",
    settings: Annotated[
        str,
        typer.Option(
            help="published: the paper's; sb3: stable-baselines3's where Table 1 is silent.",
            autocompletion=complete(*names.BASES),
        ),
    ] = "published",
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="NAME=VALUE, one setting; repeatable.")
    ] = None,
    time_limit: Annotated[
        str,
        typer.Option(
            help="bootstrap: an episode's end is no end for the value; terminal: it is.",
            autocompletion=complete(*names.TIME_LIMITS),
        ),
    ] = "bootstrap",
    evaluate_every: Annotated[str, typer.Option(help="Control steps between.")] = "50000",
    evaluate_episodes: Annotated[int, typer.Option(help="In each; 0 for none.")] = 10,
    augment: AugmentOption = None,
    robots: Annotated[
        int, typer.Option(help="Augmented ones to learn on in turn, the first of --augment, or 0.")
    ] = 1,
    jobs: Annotated[int, typer.Option(help="Runs at a time; 0 for one a core.")] = 0,
    results: ResultsOption = Path("results"),
    json: JsonOption = False,
) -> None:
    """Train agents, one run for each seed; runs that are finished are not repeated."""
    from jbench import display
    from jbench.experiments.request import request_runs
    from jbench.experiments.train import plan
    from jbench.store import Results

    output, place = Output(json), Results(results)
    runs = request_runs(
        place,
        algo=parsing.known("algorithm", algo, names.ALGORITHMS),
        task=parsing.known("task", task, names.TASKS),
        encoder=encoder,
        seeds=parsing.seeds(seeds),
        steps=parsing.count("--steps", steps),
        base=parsing.known("value of --settings", settings, names.BASES),
        overrides=set_ or [],
        time_limit=parsing.known("value of --time-limit", time_limit, names.TIME_LIMITS),
        evaluate_every=parsing.count("--evaluate-every", evaluate_every),
        evaluate_episodes=evaluate_episodes,
        augment=parsing.augmented(augment),
        robots=robots,
    )
    planned = plan(runs, place)
    if planned.finished:
        count, of = len(planned.finished), len(runs)
        rest = "" if planned.to_do else "; nothing to do"
        output.say(f"{count} of {of} runs are finished already and not repeated{rest}.")
    for run in planned.begun:
        output.say(f"The run {run.id} was interrupted or failed; it starts over.")
    failures = {}
    if planned.to_do:
        failures = display.train_with_progress(
            planned.to_do, place, parsing.all_cores(jobs), output
        )
    for run_id, reason in failures.items():
        output.warn(f"the run {run_id} failed: {reason}")
    display.show_runs(runs, place, output)
    output.say("Next: jbench report")
    output.document({"runs": [run.id for run in runs], "failures": failures})
    if failures:
        raise WorkError(f"{len(failures)} of {len(runs)} runs failed.")


for verb in (cli_policies.evaluate, cli_policies.render, cli_policies.view):
    app.command()(verb)


@app.command()
def report(
    task: Annotated[
        str | None, typer.Option(help="Only this one.", autocompletion=complete(*names.TASKS))
    ] = None,
    algo: Annotated[
        str | None,
        typer.Option(help="Only this one.", autocompletion=complete(*names.ALGORITHMS)),
    ] = None,
    order: Annotated[
        str,
        typer.Option(
            help="quantile-first (the paper's Figure 9) or smooth-first (Figure 8).",
            autocompletion=complete(*names.ORDERS),
        ),
    ] = "quantile-first",
    window: Annotated[int, typer.Option(help="Episodes in a moving average.")] = 100,
    out: Annotated[
        Path | None, typer.Option(help="Directory to write to; else RESULTS/report.")
    ] = None,
    results: ResultsOption = Path("results"),
    json: JsonOption = False,
) -> None:
    """Aggregate all runs into curves across seeds, figures and tables."""
    from jbench import display
    from jbench.report import write_report
    from jbench.store import Results

    output = Output(json)
    written = write_report(
        Results(results),
        out or results / "report",
        order=parsing.known("value of --order", order, names.ORDERS),
        window=window,
        task=task and parsing.known("task", task, names.TASKS),
        algo=algo and parsing.known("algorithm", algo, names.ALGORITHMS),
    )
    table = written.table.astype(object).where(written.table.notna(), None)
    display.show_final_returns(table, output)
    for note in written.notes:
        output.say(f"Note: {note}")
    page = next(path for path in written.files if path.name == "index.html")
    output.say(f"Wrote {len(written.files)} files to {page.parent}; open {page} in a browser.")
    output.document(
        {
            "table": table.to_dict("records"),
            "files": [str(path) for path in written.files],
            "notes": written.notes,
            "problems": written.problems,
        }
    )
    for problem in written.problems:
        output.warn(problem)
    if written.problems:
        raise WorkError(f"{len(written.problems)} records are damaged and left out; see above.")


@app.command()
def query(
    sql: Annotated[str, typer.Argument(help="One SELECT over the tables; see the README.")],
    as_csv: Annotated[bool, typer.Option("--csv", help="CSV on standard output.")] = False,
    results: ResultsOption = Path("results"),
    json: JsonOption = False,
) -> None:
    """Ask the results in SQL: tables runs, episodes, evaluations, encoders, published and more."""
    from jbench.store import Results
    from jbench.store.query import load, run_sql, to_csv, to_json

    if as_csv and json:
        raise RequestError("--csv and --json exclude each other; type one of them.")
    loaded = load(Results(results))
    answer = run_sql(sql, loaded.tables)
    if json:
        print(to_json(answer))
    elif as_csv:
        print(to_csv(answer), end="")
    else:
        cells = answer.astype(object).where(answer.notna(), None).to_numpy()
        rows = [[short(cell) for cell in row] for row in cells]
        Output().table(f"{len(answer):,} rows", list(answer.columns), rows)
    for problem in loaded.problems:
        Output(json).warn(problem)
    if loaded.problems:
        raise WorkError(f"{len(loaded.problems)} records are damaged and left out; see above.")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code: 0 done, 1 work failed, 2 wrong request."""
    # Nothing is drawn by these verbs; without this, a machine without a display gets a warning.
    os.environ.setdefault("MUJOCO_GL", "disable")
    try:
        answer = app(arguments, prog_name="jbench", standalone_mode=False)
        return answer if isinstance(answer, int) else 0
    except typer.TyperException as error:
        message = error.format_message().rstrip(".")
        print(f"Error: {message}; jbench --help shows what there is.", file=sys.stderr)
        return 2
    except (RequestError, WorkError) as error:
        print(f"Error: {error}", file=sys.stderr)
        return error.exit_code
    except (KeyboardInterrupt, typer.Abort):
        print("Stopped. What was committed is kept; type the same command again.", file=sys.stderr)
        return 1
    except BrokenPipeError:
        # The reader of our output left (`| head`); that is no error of ours.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


if __name__ == "__main__":
    sys.exit(main())
