"""Tests the paper's claims on its own curves, which give only medians and bands.

With ten seeds, the band from the 10th to the 90th percentile covers the second to the ninth of them
(numpy's linear method puts the 10th percentile between the first and the second). It therefore
contains the population median with a probability of 1 - 22/1024 = 97.9% for any distribution, and
serves as a confidence interval of the median. If two such bands do not overlap, the order of the
medians is known with 95.7%. A quartile band covers the fourth to the seventh seed: 65.6%, too
little for a verdict. The uncertainty of a band's width is unknown.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jbench.names import FULL
from jbench.report.analysis import statistics as st
from jbench.report.analysis.claims import (
    EASIER,
    HARDER,
    OFF_POLICY,
    ON_POLICY,
    REDUCED,
    Finding,
    Verdict,
)
from jbench.report.analysis.examine import decide, decide_solved
from jbench.report.data.published import SEEDS, PublishedCurve
from jbench.report.data.returns import TRAINING

_BAND = "the interval is the 10-90 band, which contains the population median with 97.9%"
_NO_WIDTH = "the uncertainty of a published band's width is unknown"
_QUARTILES = (
    "only medians and quartile bands are published, which give no 95% interval (a quartile band "
    "contains the median with only 65.6%)"
)
_ONE_SEED = "only one seed each is published"
_PRINTED_STEPS = "PPO's steps are taken as printed"


def examine_published(curves: Sequence[PublishedCurve]) -> list[Finding]:
    """Returns findings on the claims (a) to (g) in order, from the published training returns.

    Returns at the end of training are compared; for (c) and (d), the mean of the median over
    training.
    """
    findings = [
        *_of_figure_9([curve for curve in curves if curve.figure == "fig9"]),
        *_of_figures_7_and_8([curve for curve in curves if curve.figure in ("fig7", "fig8")]),
    ]
    return sorted((_with_other_baseline(f, curves) for f in findings), key=lambda f: f.claim)


def _of_figure_9(curves: Sequence[PublishedCurve]) -> Iterator[Finding]:
    more: dict[str, Any] = {"seeds": SEEDS, "source": "Figure 9"}
    for curve in curves:
        effect = _median(curve)
        verdict, _ = decide_solved(effect, SEEDS)
        yield _finding("g", _name(curve), effect, _BAND, verdict, **more)
    for ppo in (curve for curve in curves if curve.algo == ON_POLICY):
        for other in (c for c in curves if c.task == ppo.task and c.algo in OFF_POLICY):
            ours, theirs = _median(other), _median(ppo)
            effect = st.Estimate(
                ours.value - theirs.value, ours.low - theirs.high, ours.high - theirs.low
            )
            compared = f"{_name(other)} against {ON_POLICY}"
            verdict, _ = decide(effect, SEEDS, 0)
            yield _finding("e", compared, effect, f"{_BAND}; {_PRINTED_STEPS}", verdict, **more)
            remark = f"ratio of the 10-90 widths; {_NO_WIDTH}; {_PRINTED_STEPS}"
            effect = st.Estimate(_ratio(ours.high - ours.low, theirs.high - theirs.low))
            yield _finding("f", compared, effect, remark, **more)


def _of_figures_7_and_8(curves: Sequence[PublishedCurve]) -> Iterator[Finding]:
    gains: dict[str, float] = {}
    for full in (curve for curve in curves if curve.representation == FULL):
        for reduced in (c for c in curves if _is_reduced(c, full)):
            remark = _ONE_SEED if full.seeds == 1 else _QUARTILES
            compared = f"{_name(reduced)} against {FULL}"
            more: dict[str, Any] = {"seeds": full.seeds, "source": full.figure_name}
            ends = st.Estimate(float(reduced.quantiles[50][-1] - full.quantiles[50][-1]))
            yield _finding("a", compared, ends, remark, **more)
            if 25 in full.quantiles:
                widths = (float(c.quantiles[75][-1] - c.quantiles[25][-1]) for c in (reduced, full))
                remark_b = f"ratio of the quartile bands' widths; {_NO_WIDTH}"
                yield _finding("b", compared, st.Estimate(_ratio(*widths)), remark_b, **more)
            gain = gains[full.task] = _over_training(reduced) - _over_training(full)
            remark_c = f"difference of medians; {remark}"
            yield _finding("c", compared, st.Estimate(gain), remark_c, **more)
    if {EASIER, HARDER} <= gains.keys():
        remark = f"Figure 8's gain less Figure 7's; there, {_ONE_SEED}"
        compared = f"ddpg: {HARDER} against {EASIER}"
        gain_of_gains = st.Estimate(gains[HARDER] - gains[EASIER])
        yield _finding("d", compared, gain_of_gains, remark, seeds=1, source="Figures 7 and 8")


def _with_other_baseline(finding: Finding, curves: Sequence[PublishedCurve]) -> Finding:
    """Adds to findings from Figure 8 what Figure 9 shows for the same task and algorithm."""
    baseline = (HARDER, "ddpg", FULL)
    ends = {
        curve.figure: curve.quantiles[50][-1]
        for curve in curves
        if (curve.task, curve.algo, curve.representation) == baseline
    }
    if finding.claim not in "ac" or finding.source != "Figure 8" or "fig9" not in ends:
        return finding
    return replace(
        finding,
        remark=f"{finding.remark}; Figure 8's own baseline ends at {ends['fig8']:.0f}, "
        f"Figure 9's of the same task and algorithm at {ends['fig9']:.0f}",
    )


def _finding(
    claim: str,
    compared: str,
    effect: st.Estimate,
    remark: str,
    verdict: Verdict = "undecided",
    *,
    seeds: int,
    source: str,
) -> Finding:
    return Finding(
        claim, compared, effect, seeds, verdict, None, TRAINING.name, source=source, remark=remark
    )


def _median(curve: PublishedCurve) -> st.Estimate:
    """Returns the last median with the 10-90 band as its interval."""
    return st.Estimate(*(float(curve.quantiles[percent][-1]) for percent in (50, 10, 90)))


def _over_training(curve: PublishedCurve) -> float:
    """Returns the mean of the median over training, between the first and the last point."""
    steps = curve.control_steps
    return float(np.trapezoid(curve.quantiles[50], steps) / (steps[-1] - steps[0]))


def _ratio(ours: float, theirs: float) -> float:
    return ours / theirs if theirs else np.nan


def _name(curve: PublishedCurve) -> str:
    return f"{curve.task} {curve.algo} {curve.representation}"


def _is_reduced(curve: PublishedCurve, full: PublishedCurve) -> bool:
    same = (curve.figure, curve.task, curve.algo) == (full.figure, full.task, full.algo)
    return same and curve.representation == REDUCED
