"""The command train: the seeds of one configuration."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Option

from jbench import names
from jbench.commands import options, output, parsing
from jbench.commands.stopped import stopped_runs
from jbench.errors import RequestError
from jbench.settings.algorithms import ALGORITHMS
from jbench.settings.run import TYPED, RunSettings
from jbench.task_specs import GYM
from jbench.typed_values import lowered

if TYPE_CHECKING:
    from jbench.sweeps.cell import Cell


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
        autocompletion=options.complete_encoders,
    ),
    encoder_seeds: names.EncoderSeeds = Option(
        "newest",
        help="Encoder of each agent: the newest, or each: the one trained with the agent's seed "
        "(train-encoder --seed 0-9).",
    ),
    seeds: str = Option("0-9", "--seeds", "--seed", help="Seeds to train, such as 0-9 or 0,2,5-7."),
    settings: names.SettingsBase | None = Option(
        None,
        help="Hyperparameters: published (the paper's Table 1), script (the authors' script, which "
        "differs), figure8 (their earlier script, whose DDPG standardizes its inputs), sb3 "
        "(stable-baselines3's defaults for settings missing in Table 1) or suite (for other "
        "robots) (default: published, and suite for other robots).",
    ),
    set_: list[str] = options.SET,
    final_episodes: int | None = options.FINAL_EPISODES,
    device: str = options.DEVICE,
    checkpoint_every: float = options.CHECKPOINT_EVERY,
    keep_state: bool = options.KEEP_STATE,
    keep_compact_state: bool = options.KEEP_COMPACT_STATE,
    accept_changed_code: bool = options.ACCEPT_CHANGED_CODE,
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
    from jbench.commands.run_checks import check_runs
    from jbench.commands.sweep_status import show_cells
    from jbench.sweeps.executors import Local, default_jobs
    from jbench.training.code import plan_runs
    from jbench.training.kept_evaluations import with_kept_evaluations
    from jbench.training.request import request_runs, training_device

    if task == "all" or ("," in task and not task.startswith(GYM)):
        raise RequestError("jbench train trains one task; type jbench sweep FILE for several.")

    keep = parsing.state_to_keep(keep_state, keep_compact_state)
    database = parsing.results_to_write(results)
    algo = lowered(algo, ALGORITHMS)
    chosen["engine"] = choose_engine(algo, chosen["engine"])
    train_on = training_device(chosen["engine"], device, chosen["precision"])
    at_once = jobs or default_jobs(train_on)
    runs = request_runs(
        database,
        algo=algo,
        task=task,
        encoder=encoder,
        encoder_seeds=encoder_seeds,
        seeds=parsing.seeds(seeds),
        base=settings,
        overrides=parsing.parse_overrides(set_),
        accept_changed=accept_changed_code,
        **chosen,
    )
    runs, notes = plan_runs(runs, database, accept_changed_code)
    runs = with_kept_evaluations(runs, database, chosen)
    check_runs(runs[:1], keep, train_on, final_episodes)
    notes = [*training.note_encoder(encoder, runs[0]), *notes]
    cells = [_cell(runs, algo, settings, notes)]
    if dry_run:
        most = min(at_once, len(runs))
        output.document(show_cells(None, cells, database, most, train_on, True, final_episodes))
        return

    worker = training.worker_options(keep, final_episodes, checkpoint_every)
    local = partial(Local, database, at_once, train_on, **worker)
    output.if_stopped(partial(stopped_runs, runs, database))
    failures = training.train_cells(
        cells, database, local, log, device=train_on, retry_failed=retry_failed, wait=False
    )
    training.show_outcome(runs, database, failures)


def _cell(
    runs: list[RunSettings], algo: str, base: names.SettingsBase | None, notes: Sequence[str]
) -> "Cell":
    """Returns the only cell of a training, with sentences on its runs."""
    from jbench.settings.algorithms import default_base
    from jbench.sweeps.cell import Cell

    first = runs[0]
    return Cell(
        first.task,
        algo,
        first.representation,
        runs,
        default_base(first.task, base),
        notes=tuple(notes),
    )
