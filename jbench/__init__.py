"""jbench: the Jitterbug problem as a benchmark with a results database.

    Agent       base class of an agent that jbench trains, with AgentSettings, EnvironmentSpec and
                Transition
    Rule        base class of an update rule of the batched engine, with OffPolicySettings and Batch
    record      records a training loop of your own as a run
    open        opens a results directory: SQL and learning curves as pandas data frames

These names are imported at their first use, so that `import jbench` is instant. After
`import gymnasium`, `import jbench` registers the environments, such as Jitterbug/FaceDirection-v0.
"""

import importlib
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jbench.agents.batched.batch import Batch
    from jbench.agents.batched.rule import Rule
    from jbench.agents.plugin import Agent, AgentSettings, EnvironmentSpec, Transition
    from jbench.errors import RequestError, WorkError
    from jbench.policies.copied import UnsupportedPolicyError
    from jbench.recording.opened import OpenedResults
    from jbench.recording.opened import open_results as open
    from jbench.recording.recorder import AlreadyFinishedError, Recording, record
    from jbench.settings.algorithms import OffPolicySettings

__version__ = "0.1.0"

_EXPORTS = {
    "Agent": "jbench.agents.plugin:Agent",
    "AgentSettings": "jbench.agents.plugin:AgentSettings",
    "AlreadyFinishedError": "jbench.recording.recorder:AlreadyFinishedError",
    "Batch": "jbench.agents.batched.batch:Batch",
    "EnvironmentSpec": "jbench.agents.plugin:EnvironmentSpec",
    "OffPolicySettings": "jbench.settings.algorithms:OffPolicySettings",
    "OpenedResults": "jbench.recording.opened:OpenedResults",
    "Recording": "jbench.recording.recorder:Recording",
    "RequestError": "jbench.errors:RequestError",
    "Rule": "jbench.agents.batched.rule:Rule",
    "Transition": "jbench.agents.plugin:Transition",
    "UnsupportedPolicyError": "jbench.policies.copied:UnsupportedPolicyError",
    "WorkError": "jbench.errors:WorkError",
    "open": "jbench.recording.opened:open_results",
    "record": "jbench.recording.recorder:record",
}

__all__ = [
    "Agent",
    "AgentSettings",
    "AlreadyFinishedError",
    "Batch",
    "EnvironmentSpec",
    "OffPolicySettings",
    "OpenedResults",
    "Recording",
    "RequestError",
    "Rule",
    "Transition",
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
