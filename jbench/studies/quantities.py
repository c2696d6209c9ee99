"""What is compared of two configurations, and the words of its verdicts.

Each quantity is that of one of the paper's claims (docs/claims.md), by whose letter matrix files,
frames and JSON call it.
"""

from dataclasses import dataclass

from jbench.statistics.verdicts import Verdict
from jbench.task_specs import return_range

SIMILAR = "similar"
UNDECIDED = "undecided"

MARGIN = 50.0
"""Difference in final return within which two configurations are similar: 5% of the largest
possible return of an episode. See `margin`."""


@dataclass(frozen=True)
class Quantity:
    """A number by which two configurations are compared, the first minus the second.

    Attributes:
        claim: letter of the paper's claim.
        title: what is compared, in tables.
        number: what the number is called in a sentence; empty if it needs no name.
        larger: the verdict if the first one's is larger.
        smaller: the verdict if it is smaller.
    """

    claim: str
    title: str
    number: str
    larger: str
    smaller: str

    @property
    def directions(self) -> tuple[str, str]:
        """The verdicts that say which of two numbers is larger."""
        return self.larger, self.smaller

    def word(self, verdict: Verdict) -> str:
        """Returns the word for a verdict on the first configuration."""
        words: dict[Verdict, str] = {
            "larger": self.larger,
            "smaller": self.smaller,
            "equal": SIMILAR,
            "undecided": UNDECIDED,
        }
        return words[verdict]


FINAL_RETURN = Quantity("a", "final return", "", "higher", "lower")

VARIABILITY = Quantity(
    "b",
    "variability",
    "standard deviation between agents",
    "more variable",
    "less variable",
)

SPEED = Quantity("c", "speed", "mean return over the run", "faster", "slower")

QUANTITIES = {quantity.claim: quantity for quantity in (FINAL_RETURN, VARIABILITY, SPEED)}
"""By the letters of their claims."""


def margin(task: str) -> float:
    """Returns the `MARGIN` on a task; 0, by which nothing is similar, if its range is unknown."""
    return 0.0 if return_range(task) is None else MARGIN
