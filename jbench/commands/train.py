"""The train command."""

from typing import Annotated

import typer

from jbench import names
from jbench.commands import parsing
from jbench.commands.options import (
    RESULTS,
    AugmentOption,
    DryRunOption,
    FinalEpisodesOption,
    JobsOption,
    JsonOption,
    KeepStateOption,
    LogOption,
    ResultsOption,
    RetryOption,
    TaskOption,
    complete,
    complete_encoders,
    complete_settings,
)
from jbench.commands.output import Output
from jbench.errors import RequestError, WorkError
from jbench.seeds import parse_seeds
from jbench.wording import counted, with_results


def train(
    algo: Annotated[
        str,
        typer.Option(
            help=f"Algorithm: {', '.join(names.ALGORITHMS)}, one of another package "
            "(jbench algorithms), or MODULE:CLASS: a jbench.Agent, a jbench.Rule, or a class with "
            "the interface of stable-baselines3.",
            autocompletion=complete(*names.ALGORITHMS),
        ),
    ] = "ddpg",
    task: TaskOption = "face_direction",
    encoder: Annotated[
        str,
        typer.Option(
            help="Representation of the observation: none (or full), a kind with its number of "
            "latents, such as dae12 (the newest encoder), the id of an encoder, or ofeN (N "
            "features learned with the agent).",
            autocompletion=complete_encoders,
        ),
    ] = "none",
    encoder_seeds: Annotated[
        str,
        typer.Option(
            help="Encoder of each agent: the newest, or each: the one trained with the agent's "
            "seed (train-encoder --seed 0-9).",
            autocompletion=complete(*names.ENCODER_SEEDS),
        ),
    ] = "newest",
    seeds: Annotated[
        str, typer.Option("--seeds", "--seed", help="Seeds to train, such as 0-9 or 0,2,5-7.")
    ] = "0-9",
    steps: Annotated[
        str, typer.Option(help="Number of control steps of each run, such as 100k or 5e6.")
    ] = "5e6",
    settings: Annotated[
        str | None,
        typer.Option(
            help="Hyperparameters: published (the paper's Table 1), script (the authors' script, "
            "which differs), sb3 (stable-baselines3's defaults for settings missing in Table 1) or "
            "suite (for other robots) (default: published, and suite for other robots).",
            autocompletion=complete(*names.BASES),
        ),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="Set a hyperparameter; repeatable.",
            autocompletion=complete_settings,
        ),
    ] = None,
    time_limit: Annotated[
        str,
        typer.Option(
            help="Treat the time limit as a truncation (bootstrap) or as terminal (terminal).",
            autocompletion=complete(*names.TIME_LIMITS),
        ),
    ] = "bootstrap",
    evaluate_every: Annotated[
        str | None,
        typer.Option(
            help="Control steps between evaluations (default: a tenth of --steps, in whole "
            "thousands, at most 50,000)."
        ),
    ] = None,
    evaluate_episodes: Annotated[
        int, typer.Option(help="Episodes per evaluation (0 disables it).")
    ] = 10,
    final_episodes: FinalEpisodesOption = None,
    augment: AugmentOption = None,
    robots: Annotated[
        int,
        typer.Option(help="Number of augmented robots to train on in sequence, from --augment on."),
    ] = 1,
    engine: Annotated[
        str | None,
        typer.Option(
            help="Training engine: batched (many seeds at a time) or sb3 (stable-baselines3) "
            "(default: batched, or the only engine of the algorithm).",
            autocompletion=complete(*names.ENGINES),
        ),
    ] = None,
    device: Annotated[
        str,
        typer.Option(
            help="Device of the batched engine: auto, cpu, cuda or such as cuda:1.",
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
        typer.Option(
            min=0,
            help="Minimum seconds between checkpoints of the batched engine; each is at the end of "
            "an episode.",
        ),
    ] = names.CHECKPOINT_EVERY,
    keep_state: KeepStateOption = False,
    log: LogOption = None,
    dry_run: DryRunOption = False,
    retry_failed: RetryOption = False,
    jobs: JobsOption = 0,
    results: ResultsOption = RESULTS,
    json: JsonOption = False,
) -> None:
    """Train agents, one run per seed; finished runs are skipped."""
    from jbench.agents.algorithms import engine_of
    from jbench.commands import display
    from jbench.commands.live_view import TrainingView
    from jbench.commands.log import logged
    from jbench.commands.sweep_view import show_dry_run
    from jbench.settings.algorithms import base_of
    from jbench.sweeps.cell import Cell
    from jbench.sweeps.executors import Local, WorkerOptions
    from jbench.sweeps.scheduler import sweep
    from jbench.training.continuation import check_state_can_be_kept
    from jbench.training.request import request_runs, training_device
    from jbench.training.status import failures_among, run_statuses

    if task == "all" or "," in task:
        raise RequestError("jbench train trains one task; type jbench sweep FILE for several.")
    output, database = Output(json), parsing.results_to_write(results)
    chosen_engine = None if engine is None else names.known("engine", engine, names.ENGINES)
    chosen_precision = names.known("precision", precision, names.PRECISIONS)
    algo = algo.lower() if algo.lower() in names.ALGORITHMS else algo
    chosen_engine = engine_of(algo, chosen_engine)
    train_on = training_device(chosen_engine, device, chosen_precision)
    processes = parsing.processes(jobs, train_on)
    base = None if settings is None else names.known("value of --settings", settings, names.BASES)
    runs = request_runs(
        database,
        algo=algo,
        task=task,
        encoder=encoder,
        encoder_seeds=names.known("value of --encoder-seeds", encoder_seeds, names.ENCODER_SEEDS),
        seeds=parse_seeds(seeds),
        steps=(control_steps := parsing.count("--steps", steps)),
        base=base,
        overrides=parsing.parse_overrides(set_ or []),
        time_limit=names.known("value of --time-limit", time_limit, names.TIME_LIMITS),
        evaluate_every=names.evaluation_interval(control_steps)
        if evaluate_every is None
        else parsing.count("--evaluate-every", evaluate_every),
        evaluate_episodes=evaluate_episodes,
        augment=parsing.augmented(augment),
        robots=robots,
        engine=chosen_engine,
        precision=chosen_precision,
        parallel=environments,
    )
    if keep_state:
        check_state_can_be_kept(runs[:1])
    display.warn_of_short_runs(runs[:1], output)
    cells = [Cell(task, algo, runs[0].representation, runs, base_of(task, base))]
    if dry_run:
        show_dry_run(cells, database, processes, train_on, output)
        return
    options = WorkerOptions(checkpoint_every, final_episodes, keep_state)
    with logged(log, database, runs, output), TrainingView(output) as view:
        failures = sweep(
            cells,
            database,
            lambda: Local(database, processes, train_on, options),
            view.show,
            retry_failed=retry_failed,
            wait=False,
        )
    statuses = run_statuses(runs, database)
    failures |= failures_among(statuses)
    # Other processes are training them.
    left = [id for id, status in statuses.items() if not status.is_ended]
    display.show_runs(runs, database, output)
    if len(left) + len(failures) < len(runs):
        output.say(f"Next: {with_results('jbench report', results)}")
    output.document({"runs": [run.id for run in runs], "left": left, "failures": failures})
    if failures:
        raise WorkError(
            f"{len(failures)} of {counted(len(runs), 'run')} failed; --retry-failed tries again."
        )
