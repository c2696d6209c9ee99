"""The number of seeds that a decision needs."""

import numpy as np

from jbench.report.analysis.statistics import MIN_SEEDS

# Quantiles of the normal distribution, for a two-sided test at 5% and for a power of 80%.
_SIGNIFICANCE, _POWER = 1.959964, 0.841621
_MAX_SEEDS = 1_000_000  # limit of a recommendation


def seeds_to_decide(distance: float, standard_error: float, seeds: int) -> int | None:
    """Returns the seeds per group that decide a comparison with a power of 80% at 5%, two-sided.

    The standard error falls with the root of the number of seeds; the true effect is assumed to
    equal the observed one (Cohen, 1988, chapter 2, by the normal approximation).

    Args:
        distance: distance of the effect from the deciding value.
        standard_error: standard error of the effect at the present number of seeds.
        seeds: present number of seeds per group.

    Returns:
        None if the distance is 0 or unknown, or if more than a million seeds were needed.
    """
    if not (np.isfinite(distance) and np.isfinite(standard_error)) or distance == 0:
        return None
    root = abs((_SIGNIFICANCE + _POWER) * standard_error / distance)
    if root > np.sqrt(_MAX_SEEDS / seeds):
        return None
    return max(MIN_SEEDS, int(np.ceil(seeds * root**2)))
