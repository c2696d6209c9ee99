"""The shipped results database: reference runs and some trained policies."""

from importlib import resources
from pathlib import Path


def shipped() -> Path:
    """Returns the results directory in the package; it may not exist."""
    return Path(str(resources.files("jbench").joinpath("reference")))
