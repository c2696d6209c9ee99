"""Tests of what the documentation of the batched engine says of its modules."""

import pkgutil
import re

from jbench.agents import batched


def test_map_of_the_package_names_every_module():
    modules = {module.name for module in pkgutil.iter_modules(batched.__path__)}
    assert set(re.findall(r"(\w+)\.py", batched.__doc__)) == modules
