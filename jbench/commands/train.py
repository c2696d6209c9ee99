"""The train command."""

from pathlib import Path
from typing import Any

from typer import Option

from jbench import names
from jbench.commands import options, parsing
from jbench.commands.output import Output
from jbench.errors import RequestError, WorkError
from jbench.seeds import parse_numbers
from jbench.settings.algorithms import ALGORITHMS
from jbench.settings.run import TYPED, RunSettings
from jbench.wording import counted, with_results

CHECKPOINT_EVERY = Option(
    names.CHECKPOINT_EVERY,
    min=0,
    help="Minimum seconds between checkpoints of a run of the batched engine; each is at the end "
    "of an episode.",
)


@options.with_settings(RunSettings, *TYPED, main=("task", "algo", "encoder", "seeds", "steps"))
def train(
    task: str = options.TASK,
    algo: str = Option(
        "ddpg",
        help=f"Algorithm: {', '.join(ALGORITHMS)}, one of another package "
        "(jbench algorithms), or MODULE:CLASS: a jbench.Agent, a jbench.Rule, or a class with the "
        "interface of stable-baselines3.",
        autocompletion=options.complete(*ALGORITHMS),
    ),
    encoder: str = Option(
        "none",
        help="Representation of the observation: none (or full), a kind with its number of "
        "latents, such as dae12 (the newest encoder), the id of an encoder, or ofeN (N features "
        "learned with the agent).",
        autocompletion=options.complete_encoders,
    ),
    encoder_seeds: names.EncoderSeeds = Option(
        "newest",
        help="Encoder of each agent: the newest, or each: the one trained with the agent's seed "
        "(train-encoder --seed 0-9).",
    ),
    seeds: str = Option("0-9", "--seeds", "--seed", help="Seeds to train, such as 0-9 or 0,2,5-7."),
    settings: names.Base | None = Option(
        None,
        help="Hyperparameters: published (the paper's Table 1), script (the authors' script, which "
        "differs), sb3 (stable-baselines3's defaults for settings missing in Table 1) or suite "
        "(for other robots) (default: published, and suite for other robots).",
    ),
    set_: list[str] = Option(
        [],
        "--set",
        metavar="NAME=VALUE",
        help="Set a hyperparameter; repeatable.",
        autocompletion=options.complete_settings,
    ),
    final_episodes: int | None = options.FINAL_EPISODES,
    device: str = Option(
        "auto",
        help="Device of the batched engine: auto, cpu, cuda or such as cuda:1.",
        autocompletion=options.complete(*names.DEVICES),
    ),
    checkpoint_every: float = CHECKPOINT_EVERY,
    keep_state: bool = options.KEEP_STATE,
    log: names.LoggerName | None = options.LOG,
    dry_run: bool = options.DRY_RUN,
    retry_failed: bool = options.RETRY_FAILED,
    jobs: int = options.JOBS,
    results: Path = options.RESULTS,
    json: bool = options.JSON,
    **chosen: Any,
) -> None:
    """Train agents, one run per seed; finished runs are skipped."""
    from jbench.agents.algorithms import choose_engine
    from jbench.commands import display
    from jbench.commands.live_view import TrainingView
    from jbench.commands.log import logged
    from jbench.commands.sweep_view import show_dry_run
    from jbench.settings.algorithms import default_base
    from jbench.sweeps.cell import Cell
    from jbench.sweeps.executors import Local
    from jbench.sweeps.scheduler import sweep
    from jbench.training.continuation import check_state_can_be_kept
    from jbench.training.request import request_runs, training_device
    from jbench.training.status import failures_among, run_statuses

    if task == "all" or "," in task:
        raise RequestError("jbench train trains one task; type jbench sweep FILE for several.")
    output, database = Output(json), parsing.results_to_write(results)
    algo = algo.lower() if algo.lower() in ALGORITHMS else algo
    chosen["engine"] = choose_engine(algo, chosen["engine"])
    chosen["evaluate_every"] = chosen["evaluate_every"] or names.evaluation_interval(
        chosen["steps"]
    )
    train_on = training_device(chosen["engine"], device, chosen["precision"])
    processes = parsing.processes(jobs, train_on)
    runs = request_runs(
        database,
        algo=algo,
        task=task,
        encoder=encoder,
        encoder_seeds=encoder_seeds,
        seeds=parse_numbers(seeds),
        base=settings,
        overrides=parsing.parse_overrides(set_),
        **chosen,
    )
    if keep_state:
        check_state_can_be_kept(runs[:1])
    display.warn_of_short_runs(runs[:1], output)
    cells = [Cell(task, algo, runs[0].representation, runs, default_base(task, settings))]
    if dry_run:
        show_dry_run(cells, database, processes, train_on, output)
        return
    with logged(log, database, runs, output), TrainingView(output) as view:
        failures = sweep(
            cells,
            database,
            lambda: Local(
                database,
                processes,
                train_on,
                checkpoint_every=checkpoint_every,
                final_episodes=final_episodes,
                keep_state=keep_state,
            ),
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
