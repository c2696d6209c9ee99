"""One run in a process of its own: JSON lines on standard output, and it ends with its parent.

`python -m jbench.experiments.worker '{"results": …, "settings": …}'`. Plain JSON instead of
multiprocessing, which would pickle.
"""

import json
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any


def main(argument: str) -> int:
    """Does the run that the JSON argument describes; returns the exit code."""
    # Ctrl-C reaches the whole group; the parent decides, and closes our standard input.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    send = _sender()
    import torch

    from jbench.errors import RequestError, WorkError
    from jbench.experiments.run import load_encoder_of, run
    from jbench.experiments.settings import RunSettings
    from jbench.experiments.speed import seconds_per_step
    from jbench.store import Results

    torch.set_num_threads(1)
    request = json.loads(argument)
    results = Results(Path(request["results"]))
    settings = RunSettings(**request["settings"])
    try:
        encoder = load_encoder_of(settings, results)
        send({"seconds_per_step": seconds_per_step(settings, encoder)})
        run(
            settings,
            results,
            lambda steps, value: send({"control_steps": steps, "episode_return": value}),
        )
    except (RequestError, WorkError) as error:
        send({"failed": str(error)})
        return 1
    except Exception as error:
        import traceback

        traceback.print_exc()
        send({"failed": f"{type(error).__name__}: {error}"})
        return 1
    send({"finished": True})
    return 0


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
