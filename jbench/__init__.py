"""jbench: the Jitterbug problem as a benchmark with a results database.

    Agent       base class of an agent that jbench trains, with AgentSettings, EnvironmentSpec and
                Transition
    Rule        base class of an update rule of the batched engine, with OffPolicySettings and Batch
    rules       DDPG, TD3 and SAC as update rules, to override a network or a loss
    record      records a training loop of your own as a run
    open        opens a results directory: SQL and learning curves as pandas data frames

These names are imported at their first use, so that `import jbench` is instant. Once Gymnasium is
imported, too, before or after it, the environments are registered, such as
Jitterbug/FaceDirection-v0.
"""

import importlib.abc
import importlib.util
import sys
from functools import cache
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the names of the package, which `_exports` reads
    from jbench import rules as rules
    from jbench.agents.batched.replay import Batch as Batch
    from jbench.agents.batched.rule import Rule as Rule
    from jbench.agents.plugin import Agent as Agent
    from jbench.agents.plugin import AgentSettings as AgentSettings
    from jbench.agents.plugin import EnvironmentSpec as EnvironmentSpec
    from jbench.agents.plugin import Transition as Transition
    from jbench.errors import RequestError as RequestError
    from jbench.errors import WorkError as WorkError
    from jbench.policies.copied_modules import UnsupportedPolicyError as UnsupportedPolicyError
    from jbench.recording.opened import OpenedResults as OpenedResults
    from jbench.recording.opened import open as open
    from jbench.recording.recorder import AlreadyFinishedError as AlreadyFinishedError
    from jbench.recording.recorder import Recording as Recording
    from jbench.recording.request import record as record
    from jbench.settings.algorithms import OffPolicySettings as OffPolicySettings

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """Imports a public name when it is first used."""
    if name == "__all__":
        return sorted(_exports())
    if name not in _exports():
        raise AttributeError(f"module 'jbench' has no attribute {name!r}")
    module, attribute = _exports()[name]
    if module == "jbench":
        return importlib.import_module(f"jbench.{attribute}")
    return getattr(importlib.import_module(module), attribute)


def __dir__() -> list[str]:
    """Lists the public names that were not imported yet, too."""
    return sorted({*globals(), *_exports()})


@cache
def _exports() -> dict[str, tuple[str, str]]:
    """Returns the module and the name of each public name, as the imports above say."""
    import ast

    exports = {}
    for node in ast.walk(ast.parse(Path(__file__).read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                if alias.asname:
                    exports[alias.asname] = (node.module or "", alias.name)

    return exports


def _register_environments() -> None:
    """Registers the environments with Gymnasium."""
    # Only the ids: the environments are imported when they are made.
    importlib.import_module("jbench.registration").register_environments()


class _AfterGymnasium(importlib.abc.MetaPathFinder):
    """Registers the environments when Gymnasium is imported after jbench.

    Others may look for Gymnasium without importing it, so the finder stays until it is imported.
    """

    _is_looking = False

    def find_spec(self, fullname: str, path: object, target: object = None) -> ModuleSpec | None:
        if fullname != "gymnasium" or self._is_looking:
            return None

        self._is_looking = True
        try:
            spec = importlib.util.find_spec(fullname)
        finally:
            self._is_looking = False

        if spec is None or spec.loader is None:
            return spec

        execute = spec.loader.exec_module

        def execute_and_register(module: ModuleType) -> None:
            execute(module)
            if self in sys.meta_path:
                sys.meta_path.remove(self)
            _register_environments()

        spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec


if "gymnasium" in sys.modules:
    _register_environments()
else:
    sys.meta_path.insert(0, _AfterGymnasium())
