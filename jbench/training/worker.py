"""Runs in a separate process, which ends when its parent does.

`python -m jbench.training.worker` reads a request, one line of JSON as `worker_request` returns
it, from standard input, where it has any length, and writes messages, lines of JSON, to standard
output: multiprocessing would pickle. It ends at once when its standard input is closed. Runs of the
batched engine differ only in their seeds; with stable-baselines3 there is one run.

Messages: for a run that was begun before, {"run": id, "resumed_at": control steps, "reason":
sentence or ""}; then for each run {"run": id} with {"control_steps": n, "episode_return": r}, and
last {"finished": true} or {"failed": reason}, with {"held": true} if another process is training
it.
"""

import json
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any


def main() -> int:
    """Trains the runs of the request; returns the exit code."""
    # Ctrl-C is sent to the parent and to this process; the parent decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    line = sys.stdin.buffer.readline()
    if not line.endswith(b"\n"):
        return 1  # the parent died while it wrote
    threading.Thread(target=_end_with_parent, daemon=True).start()
    send = _sender()
    import torch

    from jbench.errors import RequestError, WorkError
    from jbench.settings.run import RunSettings
    from jbench.store import Results

    torch.set_num_threads(1)
    request = json.loads(line)
    # Records hold the command line that a person typed.
    sys.argv = request["command"]
    runs = [RunSettings(**settings) for settings in request["runs"]]
    try:
        failures = _train(runs, request, send)
    except (RequestError, WorkError) as error:
        failures = dict.fromkeys((run.id for run in runs), error)
    except Exception as error:
        import traceback

        traceback.print_exc()
        told = WorkError(f"{type(error).__name__}: {error}")
        failures = dict.fromkeys((run.id for run in runs), told)
    results = Results(Path(request["results"]))
    for run in runs:
        send({"run": run.id, **_ended(run, results, failures.get(run.id))})
    return 1 if failures else 0


def _ended(run: Any, results: Any, failure: Exception | None) -> dict[str, Any]:
    """Returns the last message of a run; records a failure that is not recorded yet."""
    from jbench.store.locks import HeldError
    from jbench.training.status import record_failure, run_status

    # An error that ends the whole batch may come after some of its runs were finished.
    if failure is None or run_status(run, results).state == "finished":
        return {"finished": True}
    if isinstance(failure, HeldError):
        return {"failed": str(failure), "held": True}
    record_failure(run, results, str(failure))
    return {"failed": str(failure)}


def _train(runs: list[Any], request: dict[str, Any], send: Any) -> dict[str, Any]:
    """Trains the agents of all runs; returns the error of each that failed, by its id."""
    from jbench.store import Results
    from jbench.training.batched_run import run_batch
    from jbench.training.sb3_run import load_encoder_of, run

    results, device = Results(Path(request["results"])), request["device"]
    encoder = load_encoder_of(runs[0], results)

    def tell(settings: Any, steps: int, episode_return: float | None) -> None:
        send({"run": settings.id, "control_steps": steps, "episode_return": episode_return})

    def tell_start(settings: Any, steps: int, sentence: str) -> None:
        send({"run": settings.id, "resumed_at": steps, "reason": sentence})

    if runs[0].engine == "batched":
        return run_batch(
            runs,
            results,
            encoder,
            device=device,
            checkpoint_every=request["checkpoint_every"],
            progress=tell,
            notice=tell_start,
        )
    for settings in runs:
        record = results.find("run", settings.id)
        if record is not None and record.status != "finished":
            tell_start(settings, 0, "")
        run(settings, results, lambda steps, value: tell(settings, steps, value))  # noqa: B023
    return {}


def _sender() -> Any:
    """Keeps standard output for messages: what libraries print goes to standard error."""
    messages = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)

    def send(message: dict[str, Any]) -> None:
        messages.write(json.dumps(message) + "\n")

    return send


def _end_with_parent() -> None:
    """Ends this process at once when the parent's end of standard input is gone."""
    while os.read(0, 1):
        pass
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
