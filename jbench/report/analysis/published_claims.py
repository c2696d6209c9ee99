"""Tests the paper's claims on its own curves.

The curves give only medians and bands. With ten seeds, the band from the 10th to the 90th
percentile covers the second to the ninth of them (numpy's linear method puts the 10th percentile
between the first and the second). It therefore contains the population median with a probability of
1 - 22/1024 = 97.9% for any distribution, and serves as a confidence interval of the median. If two
such bands do not overlap, the order of the medians is known with 95.7%. A quartile band covers the
fourth to the seventh seed: 65.6%, too little for a verdict. The uncertainty of a band's width is
unknown.
"""

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import FULL
from jbench.report.analysis import claims
from jbench.report.data.published import CURVE
from jbench.report.data.returns import TRAINING
from jbench.statistics import bootstrap as st

_BAND = "the interval is the 10-90 band, which contains the population median with 97.9%"
_NO_WIDTH = "the uncertainty of a published band's width is unknown"
_QUARTILES = (
    "only medians and quartile bands are published, which give no 95% interval (a quartile band "
    "contains the median with only 65.6%)"
)
_ONE_SEED = "only one seed each is published"
_PRINTED_STEPS = "PPO's steps are taken as printed"


def examine_published(published: pd.DataFrame) -> Iterator[claims.Row]:
    """Yields findings on the claims (a) to (g) from the published training returns.

    Returns at the end of training are compared; for (c) and (d), the mean of the median over
    training.
    """
    groups = published.groupby(CURVE)
    ends = groups.last().reset_index()
    ends["name"] = ends["task"] + " " + ends["algo"] + " " + ends["representation"]
    ends["over_run"] = [
        np.trapezoid(curve["median"], curve["steps"]) / np.ptp(curve["steps"])
        for _, curve in groups[["steps", "median"]]
    ]
    newest = ends[ends["figure"] == "Figure 9"]
    yield from _on_figure_9(list(newest.itertuples()))
    yield from _on_figures_7_and_8(ends, newest)


def _on_figure_9(curves: Sequence[Any]) -> Iterator[claims.Row]:
    for curve in curves:
        effect = st.Estimate(curve.median, curve.q10, curve.q90)
        solved = claims.decide_solved(effect, curve.seeds)
        yield _published("g", curve.name, effect, _BAND, curve, solved["verdict"])
    for ppo, curve in product(curves, repeat=2):
        if (
            curve.task == ppo.task
            and curve.algo in claims.OFF_POLICY
            and ppo.algo == claims.ON_POLICY
        ):
            compared = f"{curve.name} against {claims.ON_POLICY}"
            ends = curve.q10 - ppo.q90, curve.q90 - ppo.q10
            effect = st.Estimate(curve.median - ppo.median, *ends)
            verdict = claims.decide(effect, curve.seeds, 0)["verdict"]
            yield _published("e", compared, effect, f"{_BAND}; {_PRINTED_STEPS}", curve, verdict)
            remark = f"ratio of the 10-90 widths; {_NO_WIDTH}; {_PRINTED_STEPS}"
            effect = st.Estimate(claims.ratio_of_widths(curve.q90 - curve.q10, ppo.q90 - ppo.q10))
            yield _published("f", compared, effect, remark, curve)


def _on_figures_7_and_8(ends: pd.DataFrame, newest: pd.DataFrame) -> Iterator[claims.Row]:
    compared = ends[ends["representation"] == FULL].merge(
        ends[ends["representation"] == claims.REDUCED], on=CURVE[:3], suffixes=("_full", "")
    )
    baseline = newest["median"][newest["name"] == f"{claims.HARDER} ddpg {FULL}"]
    gains: dict[str, float] = {}
    curves: list[Any] = list(compared.itertuples())
    for curve in curves:
        remark = _ONE_SEED if curve.seeds == 1 else _QUARTILES
        if curve.figure == "Figure 8" and len(baseline):
            remark += f"; Figure 8's own baseline ends at {curve.median_full:.0f}, Figure 9's of "
            remark += f"the same task and algorithm at {baseline.iloc[0]:.0f}"
        gains[curve.task] = gain = curve.over_run - curve.over_run_full
        effects = {
            "a": (curve.median - curve.median_full, remark),
            "c": (gain, f"difference of medians; {remark}"),
        }
        if np.isfinite(curve.q25):
            widths = claims.ratio_of_widths(curve.q75 - curve.q25, curve.q75_full - curve.q25_full)
            effects["b"] = widths, f"ratio of the quartile bands' widths; {_NO_WIDTH}"
        for claim, (effect, why) in effects.items():
            yield _published(claim, f"{curve.name} against {FULL}", st.Estimate(effect), why, curve)
    if {claims.EASIER, claims.HARDER} <= {*gains}:
        effect, compared_tasks = (
            gains[claims.HARDER] - gains[claims.EASIER],
            f"{claims.HARDER} against {claims.EASIER}",
        )
        more = {"source": "Figures 7 and 8", "returns": TRAINING}
        more["remark"] = f"Figure 8's gain less Figure 7's; there, {_ONE_SEED}"
        yield claims.finding(
            "d", f"ddpg: {compared_tasks}", st.Estimate(effect), 1, claims.UNDECIDED, **more
        )


def _published(
    claim: str,
    compared: str,
    effect: st.Estimate,
    remark: str,
    curve: Any,
    verdict: str = "undecided",
) -> claims.Row:
    more = {"source": curve.figure, "remark": remark, "returns": TRAINING}
    return claims.finding(
        claim, compared, effect, curve.seeds, claims.UNDECIDED | {"verdict": verdict}, **more
    )
