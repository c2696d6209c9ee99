"""Unusual runs: notes on them, and diverged ones, which count with return 0 from then on.

If diverged seeds were left out, an algorithm that diverges half of the time would look as good as
one that never does.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import EPISODE_STEPS
from jbench.report.data.curves import BAND_SEEDS, BoolArray, FloatArray, IntArray, Points
from jbench.report.data.returns import EVALUATION, TRAINING, Returns
from jbench.wording import are, counted


@dataclass(frozen=True)
class Divergence:
    """The divergence of a run.

    Attributes:
        control_steps: control steps until then.
        update: number of the update; None if it is not recorded.
        what: the quantity that was not finite, such as `critic_loss`; empty if not recorded.
    """

    control_steps: int
    update: int | None
    what: str

    def __str__(self) -> str:
        update = f"update {self.update:,}" if self.update is not None else ""
        more = ", ".join(filter(None, (update, self.what)))
        return f"after {self.control_steps:,} control steps" + (f", {more}" if more else "")


def divergence_of(text: str | None) -> Divergence | None:
    """Parses the column `diverged` of the table `runs`, which is untrusted."""
    if not isinstance(text, str):
        return None
    recorded: Any = json.loads(text)
    steps, update, what = (recorded.get(name) for name in ("control_steps", "update", "what"))
    return Divergence(
        control_steps=steps if _is_count(steps) else 0,
        update=update if _is_count(update) else None,
        what=what if isinstance(what, str) else "",
    )


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and 0 <= value < 1 << 62


def count_divergence(
    points: Points, divergences: Sequence[Divergence | None], planned: int, kind: Returns
) -> Points:
    """Returns the points of a cell, with diverged seeds extended to the end of the others.

    Args:
        points: (seeds, points) each.
        divergences: one per seed; None if it did not diverge.
        planned: planned control steps, to which all seeds are extended if all diverged.
    """
    if not any(divergences):
        return points
    planned = max([planned, *(one.control_steps for one in divergences if one)])
    if all(divergences):
        points = Points(*(_widened(a, points.control_steps, planned, kind) for a in points))
    returns, control_steps, _, deviations, counts = points
    present = np.isfinite(control_steps)
    grid = np.max(np.where(present, control_steps, -np.inf), axis=0)
    empty = np.isinf(grid)
    grid[empty] = _further_steps(grid[~empty], int(empty.sum()), planned, kind)
    for row, divergence in enumerate(divergences):
        if divergence is None:
            continue
        late = ~present[row] & (grid >= divergence.control_steps)
        if not (present[row] | late).any():
            late[-1] = True
        control_steps[row, late] = grid[late]
        returns[row, late] = 0.0
        returns[row, present[row] & (control_steps[row] > divergence.control_steps)] = 0.0
        if kind is EVALUATION:
            zero = returns[row] == 0
            deviations[row, zero] = 0.0
            counts[row, zero & np.isnan(counts[row])] = 1.0
    return points


def _widened(
    values: FloatArray, control_steps: FloatArray, planned: int, kind: Returns
) -> FloatArray:
    """Returns the values, padded with NaN to the points up to the planned control steps."""
    points = values.shape[1]
    if kind is TRAINING:
        more = max(1, -(-planned // EPISODE_STEPS)) - points
    else:
        more = int(not points or np.nanmax(control_steps) < planned)
    return np.pad(values, ((0, 0), (0, max(0, more))), constant_values=np.nan)


def _further_steps(grid: FloatArray, count: int, planned: int, kind: Returns) -> FloatArray:
    """Returns the control steps of further points, which no seed has recorded."""
    if kind is TRAINING:
        return np.asarray((len(grid) + 1.0 + np.arange(count)) * EPISODE_STEPS)
    return np.full(count, float(planned))


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
