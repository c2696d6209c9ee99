"""What can be wrong with a record: errors of its readers, and their sorts in `jbench verify`."""

from pathlib import Path
from typing import Literal

from jbench.errors import WorkError

Sort = Literal["damaged", "leftover", "foreign", "warning"]
"""A record is damaged; no manifest lists a file; a record can't be checked, because a newer jbench
wrote it or reading fails; or a record is intact, with a warning.
"""


class RecordError(WorkError):
    """A record, or a file of it, can't be used; the problem is a clause to follow the path."""

    sort: Sort = "damaged"

    def __init__(self, path: Path, problem: str, advice: str = "") -> None:
        """Says what is wrong, and may add what to do, as a clause."""
        super().__init__(f"{path} {problem}{advice and '; '}{advice}.")
        self.path, self.problem = path, problem


class DamagedError(RecordError):
    """It is missing or damaged."""


class UnreadableError(RecordError):
    """It can't be read at present, or only by a newer jbench; it may be intact."""

    sort = "foreign"
