"""Some runs in a process of their own: JSON lines on standard output, and it ends with its parent.

`python -m jbench.experiments.worker JSON`, where JSON is what `worker_request` returns; plain JSON
instead of multiprocessing, which would pickle. Runs of the batched engine differ in their seeds
alone; with stable-baselines3 there is one run.

Messages: {"seconds_per_step": s} where "measure" asks for it; for a run that was begun before,
{"run": id, "goes_on_from": n, "because": sentence or ""}; then for each run {"run": id} with
{"control_steps": n, "episode_return": r}, {"failed": reason}, with {"held": true} if another
process does it, or {"finished": true}.
"""

import json
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any


def main(argument: str) -> int:
    """Does the runs that the JSON argument describes; returns the exit code."""
    # Ctrl-C reaches the whole group; the parent decides, and closes our standard input.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    send = _sender()
    import torch

    from jbench.errors import RequestError, WorkError
    from jbench.experiments.settings import RunSettings
    from jbench.store import Results

    torch.set_num_threads(1)
    request = json.loads(argument)
    # Records tell what a person typed.
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
    """Returns the last message of a run; a failure that nobody has recorded yet is recorded."""
    from jbench.experiments.standing import record_failure
    from jbench.store.locks import HeldError

    if failure is None:
        return {"finished": True}
    if isinstance(failure, HeldError):
        return {"failed": str(failure), "held": True}
    record_failure(run, results, str(failure))
    return {"failed": str(failure)}


def _train(runs: list[Any], request: dict[str, Any], send: Any) -> dict[str, Any]:
    """Trains the agents of all runs; returns the error of each that failed, by its id."""
    from jbench.experiments.batch import run_batch
    from jbench.experiments.run import load_encoder_of, run
    from jbench.store import Results

    results, device = Results(Path(request["results"])), request["device"]
    encoder = load_encoder_of(runs[0], results)
    if request["measure"]:
        from jbench.experiments.speed import seconds_per_step

        send({"seconds_per_step": seconds_per_step(runs, encoder, device)})

    def tell(settings: Any, steps: int, episode_return: float | None) -> None:
        send({"run": settings.id, "control_steps": steps, "episode_return": episode_return})

    def tell_start(settings: Any, steps: int, sentence: str) -> None:
        send({"run": settings.id, "goes_on_from": steps, "because": sentence})

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
    sys.exit(main(sys.argv[1]))
