"""Trains runs in a separate process, which ends when its parent does.

`python -m jbench.training.worker` reads a request (one line of JSON, see `Local.request`) from
standard input, and writes each `WorkerEvent` as a line of JSON to standard output.
multiprocessing is not used because it pickles. The process exits when its standard input is closed.
"""

import json
import os
import signal
import sys
import threading
import traceback
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jbench.settings.run import RunSettings
    from jbench.store import Results
    from jbench.training.events import Event, LastEvent


def main() -> int:
    """Trains the runs of the request; returns the exit code."""
    # Ctrl-C is sent to the parent and to this process; the parent decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    line = sys.stdin.buffer.readline()
    if not line.endswith(b"\n"):
        return 1  # the parent died while writing
    threading.Thread(target=_end_with_parent, daemon=True).start()
    events = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what libraries print is no event
    import torch

    from jbench.errors import ERRORS_OF_OTHERS, warning_by, without_exit
    from jbench.settings.run import RunSettings
    from jbench.store import Results
    from jbench.training.batched_run import run_batch
    from jbench.training.events import Warned, WorkerEvent, to_json

    torch.set_num_threads(1)
    request = json.loads(line)
    # Records contain the command line that the user typed.
    sys.argv = request["command"]
    runs = [RunSettings(**settings) for settings in request["runs"]]
    results = Results(Path(request["results"]))

    def send(event: "Event") -> None:
        assert isinstance(event, WorkerEvent)
        events.write(json.dumps(to_json(event)) + "\n")

    with warning_by(lambda sentence: send(Warned(sentence))):
        try:
            failures = run_batch(runs, results, report=send, **request["options"])
        except (*ERRORS_OF_OTHERS, KeyboardInterrupt) as error:  # Ctrl-C is ignored here
            failures = dict.fromkeys((run.id for run in runs), without_exit(error))
    for run in runs:
        send(_ended(run, results, failures.get(run.id)))
    return 1 if failures else 0


def _ended(run: "RunSettings", results: "Results", failure: Exception | None) -> "LastEvent":
    """Returns the last event of a run; records a failure that is not recorded yet."""
    from jbench.errors import RequestError, WorkError, sentence_of_failure
    from jbench.store.code import ChangedCodeError
    from jbench.store.files import NoRoomError
    from jbench.store.locks import HeldError
    from jbench.training.compact import OtherRowsError
    from jbench.training.events import Failed, Finished, Held
    from jbench.training.status import record_failure, run_status

    # An error that ends the batch may occur after some of its runs were finished.
    if failure is None or run_status(run, results).state == "finished":
        return Finished(run.id)
    if isinstance(failure, HeldError):
        return Held(run.id)
    reason = sentence_of_failure(failure)
    # After these, the run itself has not failed.
    if not isinstance(failure, ChangedCodeError | NoRoomError | OtherRowsError):
        record_failure(run, results, reason)

    error: BaseException | None = failure
    if isinstance(failure, RequestError | WorkError):
        error = failure.__cause__  # a sentence of jbench needs no traceback of its own
    if error is None:
        return Failed(run.id, reason, "")
    return Failed(run.id, reason, "".join(traceback.format_exception(error)).rstrip())


def _end_with_parent() -> None:
    """Ends this process at once when the parent closes its end of standard input."""
    while os.read(0, 1):
        pass
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
