"""What can be wrong with a record: errors of its readers, and their sorts in `jbench verify`."""

from pathlib import Path
from typing import Literal

from jbench.errors import WorkError

Sort = Literal["damaged", "leftover", "foreign", "warning"]
"""A record is damaged; no manifest lists a file; a record can't be checked, because a newer jbench
wrote it or reading fails; or a record is intact, with a warning.
"""


class RecordError(WorkError):
    """A record, or a file of it, can't be used.

    Attributes:
        problem: clause to follow the path in a sentence.
        advice: what to do, as a clause; may be empty.
    """

    sort: Sort = "damaged"

    def __init__(self, path: Path, problem: str, advice: str = "") -> None:
        super().__init__(path, problem, advice)
        self.path, self.problem, self.advice = path, problem, advice

    @property
    def problem_with_advice(self) -> str:
        """Clause to follow the path in a sentence."""
        return f"{self.problem}{self.advice and '; '}{self.advice}"

    def __str__(self) -> str:
        return f"{self.path} {self.problem_with_advice}."


class DamagedError(RecordError):
    """It is missing or damaged."""


class UnreadableError(RecordError):
    """It can't be read at present, or only by a newer jbench; it may be intact."""

    sort = "foreign"
