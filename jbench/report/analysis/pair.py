"""Two configurations, and the evidence that their scores differ."""

from functools import cache, cached_property, partial

import numpy as np
from scipy.stats import rankdata

from jbench.array_types import FloatArray
from jbench.report.analysis.scores import mean_returns, seed_scores
from jbench.report.data.configuration import Configuration
from jbench.report.data.scores import Scores
from jbench.statistics import bootstrap as st
from jbench.statistics.agents import deviation_difference
from jbench.statistics.permutation import p_value
from jbench.statistics.verdicts import Evidence

IQM_DIFFERENCE = st.difference(st.interquartile_mean)


class Pair:
    """Two configurations, with scores at the last control step that every seed has reached."""

    def __init__(
        self, ours: Configuration, theirs: Configuration, control_steps: int | None = None
    ) -> None:
        """Compares at a control step, None for the last that every seed of both has reached."""
        self.ours = ours
        self.theirs = theirs
        self.sides = (ours, theirs)
        last = int(min(ours.last_step, theirs.last_step))
        self.control_steps = last if control_steps is None else control_steps
        self._alone = [seed_scores(side, self.control_steps) for side in self.sides]
        self.seeds = min(len(side.final) for side in self._alone)

    def up_to(self, control_steps: int) -> "Pair":
        """Returns the pair with scores up to an earlier control step, or the same one."""
        return self if control_steps == self.control_steps else Pair(*self.sides, control_steps)

    @cached_property
    def scores(self) -> list[Scores]:
        """The scores of both sides, whose means over the run compare with the other's.

        Most pairs of a report are compared by their final returns alone.
        """
        found = []
        for alone, side, other in zip(self._alone, self.sides, self.sides[::-1], strict=True):
            area = mean_returns(side, [other], self.control_steps)
            found.append(alone._replace(area=area[alone.known]))
        return found

    @property
    def finals(self) -> list[FloatArray]:
        """The final returns (seeds,) of both sides."""
        return [side.final for side in self._alone]

    def _values(self, scores: str) -> list[FloatArray]:
        """Returns the `final` returns or the means over the run (`area`) of both sides."""
        return self.finals if scores == "final" else [side.area for side in self.scores]

    def sample(self, statistic: st.Statistic, scores: str = "final") -> st.Resampled:
        """Returns a statistic of the scores of both: `final`, or `area`."""
        groups = ([values] for values in self._values(scores))
        return st.samples([statistic], *groups)[0]

    def difference(self, scores: str = "final", margin: float = 0.0) -> Evidence:
        """Returns the evidence of a difference of interquartile means, tested by that of means.

        Args:
            scores: `final`, or `area`.
            margin: within which both are equal; 0 if they never are.
        """
        sample = self.sample(IQM_DIFFERENCE, scores)
        ours, theirs = self._values(scores)

        @cache
        def p_of_shifted(shift: float) -> float:
            return p_value([ours + shift], [theirs], sample.value + shift)

        return Evidence(sample.estimate, p_of_shifted, self.seeds, margin)

    def variability(self) -> Evidence:
        """Returns the evidence of a difference of the standard deviations between agents.

        The test compares mean absolute deviations from the median of each configuration, which a
        failed seed moves less than a variance (M. B. Brown, A. B. Forsythe, *Robust tests for the
        equality of variances*, J. Am. Stat. Assoc. 69, 1974).
        """
        agents, others = (side.agents for side in self._alone)
        estimate = partial(deviation_difference, agents, others)

        @cache
        def p_of_difference(_: float) -> float:
            ours, theirs = (np.abs(final - np.median(final)) for final in self.finals)
            return p_value([ours], [theirs], estimate().value)

        return Evidence(estimate, p_of_difference, self.seeds)

    @property
    def unknown_variability(self) -> str:
        """Why the variability between agents is unknown, as a clause; "" if it is known."""
        for side, scores in zip(self.sides, self._alone, strict=True):
            if len(scores.final) < 2:
                return f"since {side.configuration} has fewer than two seeds with a return"
            if not scores.agents.is_known:
                return (
                    f"since {side.configuration} has final returns of a single episode, which do "
                    "not tell how much the episodes of an agent vary"
                )

        return ""

    def improvement(self) -> Evidence:
        """Returns the evidence of the probability of improvement, tested by means of ranks."""

        @cache
        def p_of_difference(_: float) -> float:
            first, other = self.finals
            ranks = rankdata(np.concatenate([first, other]))
            ours, theirs = np.split(ranks, [len(first)])
            return p_value([ours], [theirs])

        sample = self.sample(st.probability_of_improvement)
        return Evidence(sample.estimate, p_of_difference, self.seeds, null_value=0.5)
