"""The train command."""

import sys
from collections.abc import Callable, Sequence, Sized
from contextlib import ExitStack, redirect_stdout
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Option

from jbench import names
from jbench.commands import completion, options, parsing
from jbench.commands.output import Output
from jbench.errors import RequestError, WorkError
from jbench.seeds import parse_numbers
from jbench.settings.algorithms import ALGORITHMS
from jbench.settings.run import TYPED, RunSettings
from jbench.wording import counted, with_results

if TYPE_CHECKING:
    from jbench.store import Results
    from jbench.sweeps.cell import Cell
    from jbench.sweeps.executors import Executor


@options.with_settings(RunSettings, *TYPED, main=("task", "algo", "encoder", "seeds", "steps"))
def train(
    task: str = options.TASK,
    algo: str = Option(
        "ddpg",
        help=f"Algorithm: {', '.join(ALGORITHMS)}, one of another package "
        "(jbench algorithms), or MODULE:CLASS: a jbench.Agent, a jbench.Rule, or a class with the "
        "interface of stable-baselines3.",
        autocompletion=completion.complete(*ALGORITHMS),
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
    from jbench.commands.sweep_view import show_status
    from jbench.settings.algorithms import default_base
    from jbench.sweeps.cell import Cell
    from jbench.sweeps.executors import Local, default_jobs
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
    processes = jobs or default_jobs(train_on)
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
    check_runs(runs[:1], keep_state, output)
    cells = [Cell(task, algo, runs[0].representation, runs, default_base(task, settings))]
    title = counted(len(runs), "run")
    if dry_run:
        at_once = min(processes, len(runs))
        status = show_status(title, cells, database, at_once, train_on, output, times=True)
        output.document(status)
        return
    worker: dict[str, Any] = {"final_episodes": final_episodes, "keep_state": keep_state}
    worker["checkpoint_every"] = checkpoint_every
    make = partial(Local, database, processes, train_on, **worker)
    how: dict[str, Any] = {"retry_failed": retry_failed, "wait": False}
    failures = train_cells(cells, database, make, log, output, **how)
    after = run_statuses(runs, database)
    failures |= failures_among(after)
    elsewhere = [id for id, status in after.items() if not status.is_ended]
    show_runs(runs, database, output)
    if len(elsewhere) + len(failures) < len(runs):
        output.say(f"Next: {with_results('jbench report', results)}")
    output.document({"runs": [run.id for run in runs], "left": elsewhere, "failures": failures})
    check_failures(failures, len(runs))


def train_cells(
    cells: Sequence["Cell"],
    results: "Results",
    make_executor: Callable[[], "Executor"],
    log: str | None,
    output: Output,
    **options: Any,
) -> dict[str, str]:
    """Trains the missing runs of cells with the options of `jbench.sweeps.scheduler.sweep`.

    Their progress is shown, and their rows are copied to an experiment tracker if one is named.

    Returns:
        A sentence for each run that failed, by run id.

    Raises:
        RequestError: if the tracker's library is not installed; see also `sweep`.
    """
    from jbench.commands.progress import TrainingView
    from jbench.loggers.logger import copying_rows, make_logger
    from jbench.sweeps.cell import all_runs
    from jbench.sweeps.scheduler import sweep

    with ExitStack() as stack:
        if output.as_json:  # Ray prints to standard output, which is only for the JSON document
            stack.enter_context(redirect_stdout(sys.stderr))
        if log is not None:
            logger, ids = make_logger(log, results.path), {run.id for run in all_runs(cells)}
            output.say(logger.where)
            stack.enter_context(copying_rows(results, ids, logger, output.warn))
        view = stack.enter_context(TrainingView(output))
        return sweep(cells, results, make_executor, view.show, **options)


def check_failures(failures: Sized, runs: int) -> None:
    """Raises a WorkError if some of a number of runs have failed."""
    if failures:
        failed = f"{len(failures)} of {counted(runs, 'run')} failed"
        raise WorkError(f"{failed}; --retry-failed tries again.")


_FINAL_RETURNS = (
    "Final returns. Quote the evaluation return: the mean over the last evaluation, in which the "
    "policy is\ndeterministic. The training return, exploration included, is the mean over the "
    "last quarter of the\nepisodes, at most 100."
)


def show_runs(runs: Sequence[RunSettings], results: "Results", output: Output) -> None:
    """Prints the final returns of each run in the results."""
    from jbench.returns import final_return
    from jbench.store.listing import evaluation_return

    rows = []
    for run in runs:
        try:
            record = results.find("run", run.id)
            if record is not None:
                status = "" if record.status == "finished" else f" ({record.status})"
                returns = record.read("episodes")["episode_return"].to_numpy()
                finals = final_return(returns), evaluation_return(record)
                means = ("" if mean is None else f"{mean:.0f}" for mean in finals)
                rows.append((record.id + status, len(returns), *means))
        except WorkError as error:
            output.warn(str(error))
    output.table(_FINAL_RETURNS, ("run", "episodes", "training return", "evaluation return"), rows)


def check_runs(runs: Sequence[RunSettings], keep_state: bool, output: Output) -> None:
    """Checks runs, one of each configuration, before they are trained.

    Their state must be one that can be kept, if it is to be; unexpected numbers of control steps
    are warned of.
    """
    from jbench.settings.algorithms import OffPolicySettings
    from jbench.training.continuation import check_state_can_be_kept

    if keep_state:
        check_state_can_be_kept(runs)
    sentences = []
    for run in (run for run in runs if run.is_ours):
        end, episode = run.last_step, names.EPISODE_STEPS
        if run.steps % episode:
            where = f"in the middle of an episode of {episode:,}, whose return is not recorded"
            if end % (episode * run.environments) == 0:
                where = f"at the end of an episode of {episode:,}"
            sentences.append(f"a run of {run.steps:,} control steps ends after {end:,}, {where}.")
        algorithm = run.algorithm
        if isinstance(algorithm, OffPolicySettings) and end < algorithm.first_update:
            sentences.append(
                f"{run.algo} first updates its networks after {algorithm.first_update:,} control "
                f"steps, so a run of {run.steps:,} learns nothing; raise --steps, or lower that "
                "number with --set learning_starts=N and --set train_freq=N (in a matrix file, the "
                f"same keys of [hyperparameters.{run.algo}])."
            )
    for sentence in dict.fromkeys(sentences):
        output.warn(sentence)
