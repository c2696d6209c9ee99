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
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the names of the package, which `_exports` reads
    from jbench.agents.batched.replay import Batch as Batch
    from jbench.agents.batched.rule import Rule as Rule
    from jbench.agents.plugin import Agent as Agent
    from jbench.agents.plugin import AgentSettings as AgentSettings
    from jbench.agents.plugin import EnvironmentSpec as EnvironmentSpec
    from jbench.agents.plugin import Transition as Transition
    from jbench.errors import RequestError as RequestError
    from jbench.errors import WorkError as WorkError
    from jbench.policies.actors import UnsupportedPolicyError as UnsupportedPolicyError
    from jbench.recording.opened import OpenedResults as OpenedResults
    from jbench.recording.opened import open as open
    from jbench.recording.recorder import AlreadyFinishedError as AlreadyFinishedError
    from jbench.recording.recorder import Recording as Recording
    from jbench.recording.request import record as record
    from jbench.settings.algorithms import OffPolicySettings as OffPolicySettings

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return sorted(_exports())
    if name not in _exports():
        raise AttributeError(f"module 'jbench' has no attribute {name!r}")
    module, attribute = _exports()[name]
    return getattr(importlib.import_module(module), attribute)


def __dir__() -> list[str]:
    return sorted({*globals(), *_exports()})


@cache
def _exports() -> dict[str, tuple[str, str]]:
    import ast

    return {
        alias.asname: (node.module or "", alias.name)
        for node in ast.walk(ast.parse(Path(__file__).read_text()))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.asname
    }


# Only the ids: the environments are imported when they are made.
if "gymnasium" in sys.modules:
    importlib.import_module("jbench.registration").register_environments()
