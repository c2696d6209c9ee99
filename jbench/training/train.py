"""Runs side by side: one process per core, or one for a GPU."""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from jbench.names import CHECKPOINT_EVERY
from jbench.settings.alike import SEED, alike
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.training.processes import Message, Workers, worker_request


def resume_sentence(run: RunSettings, message: Message) -> str:
    """Returns the sentence for a worker's message about a run that was begun before."""
    steps = message["goes_on_from"]
    how = f"resumes at control step {steps:,}" if steps else "starts again from the beginning"
    return f"The run {run.id} was interrupted or failed; it {how}. {message['because']}".rstrip()


def train(
    runs: Sequence[RunSettings],
    results: Results,
    jobs: int,
    on_message: Callable[[RunSettings, Message], None],
    device: str = "cpu",
    checkpoint_every: float = CHECKPOINT_EVERY,
) -> dict[str, str]:
    """Trains runs side by side, in processes that have one thread each for learning.

    Args:
        runs: to train.
        results: where they are written.
        jobs: processes at a time.
        on_message: called, one call at a time, with each message of a run. A message about all runs
            of a process comes with its first run.
        device: that the batched engine learns on, `cpu` or `cuda`.
        checkpoint_every: least time between two checkpoints of a run (s).

    Returns:
        A sentence for each run that failed, by its id; one failure does not stop the others.

    Raises:
        WorkError: if a process can't be started.
    """
    failures: dict[str, str] = {}
    one_call = threading.Lock()
    workers = Workers()

    def work(batch: Sequence[RunSettings]) -> None:
        by_id = {run.id: run for run in batch}
        failed = dict.fromkeys(by_id, "its process died without a message")
        measure = batch is all_batches[0]
        request = worker_request(batch, results, device, checkpoint_every, measure)
        with workers.run(request) as messages:
            for message in messages:
                run = by_id[message.get("run", batch[0].id)]
                if "failed" in message:
                    failed[run.id] = message["failed"]
                elif "finished" in message:
                    del failed[run.id]
                with one_call:
                    on_message(run, message)
        failures.update(failed)

    all_batches = batches(runs, jobs, device)
    pool = ThreadPoolExecutor(jobs)
    try:
        futures = [pool.submit(work, batch) for batch in all_batches]
        for future in futures:
            future.result()
    finally:
        # After Ctrl-C or an error, runs are still being trained.
        workers.stop()
        pool.shutdown(cancel_futures=True)
    return failures


def batches(runs: Sequence[RunSettings], jobs: int, device: str) -> list[list[RunSettings]]:
    """Returns the runs of each process: runs that differ only in their seeds may share one.

    On a CPU the seeds are divided among `jobs` processes; on a GPU all share one. A run with
    stable-baselines3 has its own process.

    Args:
        runs: to train.
        jobs: processes at a time.
        device: `cpu` or `cuda`.
    """
    groups: dict[str, list[RunSettings]] = {}
    for run in runs:
        alone = run.engine != "batched"
        key = run.id if alone else alike(run, SEED)
        groups.setdefault(key, []).append(run)
    parts = 1 if device == "cuda" else jobs
    return [
        [group[i] for i in share]
        for group in groups.values()
        for share in np.array_split(np.arange(len(group)), min(parts, len(group)))
    ]
