"""The train command."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Option

from jbench import names
from jbench.commands import completion, options, parsing
from jbench.commands.output import Output
from jbench.errors import RequestError
from jbench.settings.algorithms import ALGORITHMS
from jbench.settings.run import TYPED, RunSettings
from jbench.wording import counted, with_results

if TYPE_CHECKING:
    from jbench.store import Results


@options.with_settings(RunSettings, *TYPED, main=("task", "algo", "encoder", "seeds", "steps"))
def train(
    task: str = options.TASK,
    algo: str = Option(
        "ddpg",
        help=f"Algorithm: {', '.join(ALGORITHMS)}, one of another package "
        "(jbench algorithms), or MODULE:CLASS: a jbench.Agent, a jbench.Rule, or a class with the "
        "interface of stable-baselines3.",
        autocompletion=lambda: ALGORITHMS,
    ),
    encoder: str = Option(
        "none",
        help="Representation of the observation: none (or full), a kind with its number of "
        "latents, such as dae12 (the newest encoder), the id of an encoder, or ofeN (N features "
        "learned with the agent).",
        autocompletion=completion.complete_encoders,
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
    set_: list[str] = options.SET,
    final_episodes: int | None = options.FINAL_EPISODES,
    device: str = options.DEVICE,
    checkpoint_every: float = options.CHECKPOINT_EVERY,
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
    from jbench.commands import training
    from jbench.settings.algorithms import default_base
    from jbench.sweeps.cell import Cell
    from jbench.sweeps.executors import Local, default_jobs
    from jbench.training.request import request_runs, training_device

    if task == "all" or "," in task:
        raise RequestError("jbench train trains one task; type jbench sweep FILE for several.")
    output, database = Output(json), parsing.results_to_write(results)
    algo = algo.lower() if algo.lower() in ALGORITHMS else algo
    chosen["engine"] = choose_engine(algo, chosen["engine"])
    every = chosen["evaluate_every"] or names.evaluation_interval(chosen["steps"])
    chosen["evaluate_every"] = every
    train_on = training_device(chosen["engine"], device, chosen["precision"])
    processes = jobs or default_jobs(train_on)
    runs = request_runs(
        database,
        algo=algo,
        task=task,
        encoder=encoder,
        encoder_seeds=encoder_seeds,
        seeds=names.parse_numbers(seeds),
        base=settings,
        overrides=parsing.parse_overrides(set_),
        **chosen,
    )
    training.check_runs(runs[:1], keep_state, output)
    cells = [Cell(task, algo, runs[0].representation, runs, default_base(task, settings))]
    title = counted(len(runs), "run")
    if dry_run:
        most = min(processes, len(runs))
        output.document(
            training.show_status(title, cells, database, most, train_on, output, times=True)
        )
        return
    make_executor = partial(
        Local,
        *(database, processes, train_on),
        checkpoint_every=checkpoint_every,
        keep_state=keep_state,
        final_episodes=final_episodes,
    )
    failures = training.train_cells(
        cells, database, make_executor, output, log, retry_failed=retry_failed, wait=False
    )
    _show_outcome(runs, failures, database, output)


def _show_outcome(
    runs: Sequence[RunSettings], failures: dict[str, str], results: "Results", output: Output
) -> None:
    from jbench.commands import training
    from jbench.training.status import failures_among, run_statuses

    after = run_statuses(runs, results)
    failures = failures | failures_among(after)
    elsewhere = [id for id, run in after.items() if run.state not in ("finished", "failed")]
    training.show_runs(runs, results, output)
    if len(elsewhere) + len(failures) < len(runs):
        output.say(f"Next: {with_results('jbench report', results.name)}")
    output.document({"runs": [run.id for run in runs], "left": elsewhere, "failures": failures})
    training.check_failures(failures, len(runs))
