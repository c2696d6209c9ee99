"""Imports scripts of the repository that are in no package."""

import importlib.util
import sys

from tests.documentation import ROOT


def script(path):
    """Returns the module of a file, whose path is relative to the repository."""
    file = ROOT / path
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = importlib.util.module_from_spec(spec)
    sys.modules[file.stem] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module
