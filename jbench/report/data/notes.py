"""Notes on unusual runs and returns of a cell."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jbench.report.data.curves import BAND_SEEDS, BoolArray, IntArray
from jbench.report.data.divergence import Divergence
from jbench.report.data.returns import EVALUATION, TRAINING, Returns
from jbench.wording import are, counted


def on_runs(
    runs: pd.DataFrame,
    chosen: pd.DataFrame,
    divergences: Sequence[Divergence | None],
    kind: Returns,
) -> list[str]:
    """Returns notes on unusual runs of a cell.

    Args:
        runs: rows of the runs of these settings, of which a cell uses some.
        chosen: rows of its runs.
        divergences: one per row of `chosen`.
        kind: kind of return of the cell.
    """
    notes = []
    point = "episode" if kind is TRAINING else "evaluation"
    if len(chosen) < BAND_SEEDS:
        seeds = counted(len(chosen), "seed")
        notes.append(f"only {seeds}: no band is drawn, and quantiles across seeds say little")
    lengths = dict(zip(chosen["seed"], chosen["recorded"], strict=True))
    unused = runs[runs["seed"].isin(chosen["seed"])].drop(chosen.index)
    for seed, recorded in unused["recorded"].groupby(unused["seed"]) if len(unused) else ():
        notes.append(
            f"seed {seed} has {len(recorded) + 1} runs: the longest is used, of {lengths[seed]} "
            f"{point}s, not that of {', '.join(map(str, recorded))}"
        )
    rows = list(zip(chosen["seed"], chosen["status"], divergences, strict=True))
    which = [f"seed {seed} {divergence}" for seed, _, divergence in rows if divergence]
    if which:
        notes.append(
            f"{len(which)} of {len(chosen)} diverged ({', '.join(which)}): from its divergence on, "
            "a seed counts with return 0, the minimum"
        )
    others = {seed: status for seed, status, divergence in rows if not divergence}
    for ended in ("failed", "unfinished"):
        for seed in (seed for seed, status in others.items() if status == ended):
            notes.append(f"seed {seed} {ended} after {counted(lengths[seed], point)}")
    different = {lengths[seed] for seed in others}
    if len(different) > 1:
        notes.append(f"seeds of unequal length, {min(different)} to {max(different)} {point}s")
    return notes


def on_points(
    chosen: pd.DataFrame, present: BoolArray, absent: IntArray, kind: Returns
) -> list[str]:
    """Returns notes on non-finite returns, and on evaluations at different steps.

    Args:
        present: (seeds, points) whether a seed has a point there.
        absent: (seeds,) number of points without a return.
    """
    name = "return" if kind is TRAINING else "evaluation"
    notes = [
        f"{counted(count, name)} of seed {seed} {are(count)} not finite and left out"
        for seed, count in zip(chosen["seed"], absent, strict=True)
        if count
    ]
    # A gap after a run's last point is its end; a gap before it is a missing evaluation.
    ended = ~np.logical_or.accumulate(present[:, ::-1], axis=1)[:, ::-1]
    if kind is EVALUATION and not (present | ended).all():
        notes.append("seeds were evaluated after different numbers of control steps")
    return notes
