"""jbench: the Jitterbug problem as a benchmark with a results database.

    record      records a training loop of your own as a run
    open        opens a results directory: SQL and learning curves as pandas data frames

These names are imported at their first use, so that `import jbench` is instant. After
`import gymnasium`, `import jbench` registers the environments, such as Jitterbug/FaceDirection-v0.
"""

import importlib
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jbench.errors import RequestError, WorkError
    from jbench.recording.networks import UnsupportedPolicyError
    from jbench.recording.opened import OpenedResults
    from jbench.recording.opened import open_results as open
    from jbench.recording.recorder import AlreadyFinishedError, Recording, record

__version__ = "0.1.0"

_EXPORTS = {
    "AlreadyFinishedError": "jbench.recording.recorder:AlreadyFinishedError",
    "OpenedResults": "jbench.recording.opened:OpenedResults",
    "Recording": "jbench.recording.recorder:Recording",
    "RequestError": "jbench.errors:RequestError",
    "UnsupportedPolicyError": "jbench.recording.networks:UnsupportedPolicyError",
    "WorkError": "jbench.errors:WorkError",
    "open": "jbench.recording.opened:open_results",
    "record": "jbench.recording.recorder:record",
}

__all__ = [
    "AlreadyFinishedError",
    "OpenedResults",
    "Recording",
    "RequestError",
    "UnsupportedPolicyError",
    "WorkError",
    "open",
    "record",
]


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        raise AttributeError(f"module 'jbench' has no attribute {name!r}")
    module, _, attribute = _EXPORTS[name].partition(":")
    return getattr(importlib.import_module(module), attribute)


# Only the ids: the environments are imported when they are made.
if "gymnasium" in sys.modules:
    importlib.import_module("jbench.registration").register_environments()


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
