"""Trains runs in a separate process, which ends when its parent does.

`python -m jbench.training.worker` reads a request (one line of JSON, see `worker_request`) from
standard input, and writes messages (one line of JSON each) to standard output. multiprocessing is
not used because it pickles. The process exits when its standard input is closed. Runs of the
batched engine are those that `run_batch` takes; with the other engines there is one run.

Messages: for a resumed run, {"run": id, "resumed_at": control steps, "reason": sentence or ""}, and
if it is a longer run of a finished one, {"continues": id of that run};
then for each run {"run": id} with {"control_steps": n, "episode_return": r}, and finally
{"finished": true} or {"failed": reason, "traceback": text}, the text empty if the reason says all,
or {"failed": reason, "held": true} if another process is training it.
"""

import json
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jbench.settings.run import RunSettings
    from jbench.store import Results

_Send = Callable[[dict[str, Any]], None]


def main() -> int:
    """Trains the runs of the request; returns the exit code."""
    # Ctrl-C is sent to the parent and to this process; the parent decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    line = sys.stdin.buffer.readline()
    if not line.endswith(b"\n"):
        return 1  # the parent died while writing
    threading.Thread(target=_end_with_parent, daemon=True).start()
    send = _sender()
    import torch

    from jbench.settings.run import RunSettings
    from jbench.store import Results

    torch.set_num_threads(1)
    request = json.loads(line)
    # Records contain the command line that the user typed.
    sys.argv = request["command"]
    runs = [RunSettings(**settings) for settings in request["runs"]]
    results = Results(Path(request["results"]))
    failures: dict[str, Exception]
    try:
        failures = _train(runs, results, request, send)
    except Exception as error:
        failures = dict.fromkeys((run.id for run in runs), error)
    for run in runs:
        send({"run": run.id, **_ended(run, results, failures.get(run.id))})
    return 1 if failures else 0


def _ended(run: "RunSettings", results: "Results", failure: Exception | None) -> dict[str, Any]:
    """Returns the last message of a run; records a failure that is not recorded yet."""
    from jbench.errors import sentence_of_failure
    from jbench.store.locks import HeldError
    from jbench.training.status import record_failure, run_status

    # An error that ends the batch may occur after some of its runs were finished.
    if failure is None or run_status(run, results).state == "finished":
        return {"finished": True}
    if isinstance(failure, HeldError):
        return {"failed": str(failure), "held": True}
    reason = sentence_of_failure(failure)
    record_failure(run, results, reason)
    return {"failed": reason, "traceback": _traceback(failure)}


def _traceback(failure: Exception) -> str:
    """Returns the traceback of an error that is not jbench's sentence; else an empty text."""
    from jbench.errors import RequestError, WorkError

    ours = isinstance(failure, RequestError | WorkError)
    error = failure.__cause__ if ours else failure
    return "" if error is None else "".join(traceback.format_exception(error)).rstrip()


def _train(
    runs: Sequence["RunSettings"], results: "Results", request: dict[str, Any], send: _Send
) -> dict[str, Exception]:
    """Trains all runs; returns the error of each failed run by id."""
    from jbench.training.batched_run import run_batch
    from jbench.training.environment import load_encoders_of

    encoders, unusable = load_encoders_of(runs, results)
    failures: dict[str, Exception] = {**unusable}
    runs = [run for run in runs if run.id not in failures]
    if not runs:
        return failures

    def report(run: "RunSettings", steps: int, episode_return: float) -> None:
        send({"run": run.id, "control_steps": steps, "episode_return": episode_return})

    def report_resumed(run: "RunSettings", steps: int, sentence: str, continues: str = "") -> None:
        resumed = {"run": run.id, "resumed_at": steps, "reason": sentence}
        send({**resumed, **({"continues": continues} if continues else {})})

    if runs[0].engine != "sb3":
        return failures | run_batch(
            runs,
            results,
            [encoders[run.encoder] for run in runs],
            device=request["device"],
            checkpoint_every=request["checkpoint_every"],
            final_episodes=request["final_episodes"],
            keep_state=request["keep_state"],
            progress=report,
            notice=report_resumed,
        )
    from jbench.training import sb3_run

    (run,) = runs
    record = results.find("run", run.id)
    if record is not None and record.status != "finished":
        report_resumed(run, 0, "")
    sb3_run.run(
        run,
        results,
        encoders[run.encoder],
        partial(report, run),
        final_episodes=request["final_episodes"],
    )
    return failures


def _sender() -> _Send:
    """Returns a function that writes messages to stdout; other output is redirected to stderr."""
    messages = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)

    def send(message: dict[str, Any]) -> None:
        messages.write(json.dumps(message) + "\n")

    return send


def _end_with_parent() -> None:
    """Ends this process at once when the parent closes its end of standard input."""
    while os.read(0, 1):
        pass
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
