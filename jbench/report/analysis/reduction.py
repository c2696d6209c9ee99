"""Compares every representation with the full and with the scaled observation.

An encoder scales its inputs before it reduces them. A difference from `full` is therefore due to
scaling and reduction together; a difference from `scaled`, the observation with the same scaling,
is due to reduction alone.
"""

from collections.abc import Sequence
from statistics import multimode
from typing import NamedTuple

import numpy as np
import pandas as pd

from jbench.names import FULL, OFE, TASKS, kind_of
from jbench.report.analysis import statistics as st
from jbench.report.analysis.claims import Finding
from jbench.report.analysis.examine import reduction_findings
from jbench.report.analysis.scores import compared_scores, scores_of
from jbench.report.data.cells import Cell, groups_same_but
from jbench.report.data.curves import FloatArray
from jbench.report.formatting import display_name

SCALED = "scaled"
BASELINES = (FULL, SCALED)
"""Baselines of reduced representations, without and with the encoders' scaling."""

_MAX_DIGITS = 9  # more digits at the end of a label are no number of latents


class Reduction(NamedTuple):
    """Comparison of a representation with a baseline, with all other settings equal.

    Attributes:
        baseline: `full` or `scaled`.
        findings: on the claims (a), (b) and (c).
        seeds: numbers of seeds of representation and baseline with a final return.
    """

    cell: Cell
    baseline: str
    findings: Sequence[Finding]
    seeds: tuple[int, int]

    def finding(self, claim: str) -> Finding:
        """Returns the finding on a claim."""
        return next(finding for finding in self.findings if finding.claim == claim)


class Point(NamedTuple):
    """Final returns of a representation.

    Attributes:
        input_size: see the function of that name.
        final: (seeds,) final returns.
        estimate: their interquartile mean with its 95% interval.
    """

    cell: Cell
    input_size: int | None
    final: FloatArray
    estimate: st.Estimate


class Group(NamedTuple):
    """Cells that differ only in their representation, compared at the same control step.

    Attributes:
        points: one per cell that has reached the control step.
        control_steps: at which they are compared.
        short: cells whose seeds have not reached it.
    """

    points: Sequence[Point]
    control_steps: int
    short: Sequence[Cell]

    @property
    def name(self) -> str:
        """What its cells have in common: source, task and algorithm."""
        first = self.points[0].cell
        return f"{first.prefix}{first.task}, {display_name(first.algo)}"


def input_size(representation: str, task: str) -> int | None:
    """Returns the size of an agent's input; None for the full observation, or if it is unknown.

    Features learned with the agent that outnumber the observation are appended to it.
    """
    kind = kind_of(representation)
    digits = representation.removeprefix(kind)
    if not 0 < len(digits) <= _MAX_DIGITS:
        return None
    latents = int(digits)
    if kind != OFE or task not in TASKS:
        return latents
    # Imported here because the package imports dm_control.
    from jbench.tasks.labels import feature_labels

    observed = len(feature_labels(task))
    return latents + observed if latents > observed else latents


def reductions(cells: Sequence[Cell]) -> list[Reduction]:
    """Returns the comparisons of each reduced representation with each available baseline.

    Beside reduced representations, `scaled` is compared with `full`: the effect of scaling alone.
    """
    found = []
    for group in _by_settings(cells):
        baselines = {kind_of(c.representation): c for c in reversed(group)}
        if not {*baselines} - {*BASELINES}:
            continue
        for cell in group:
            kind = kind_of(cell.representation)
            others = {FULL: (), SCALED: (FULL,)}.get(kind, BASELINES)
            for name in (name for name in others if name in baselines):
                ours, theirs = (len(s.final) for s in compared_scores(cell, baselines[name]))
                findings = reduction_findings(baselines[name], cell)
                found.append(Reduction(cell, name, findings, (ours, theirs)))
    return found


def groups(cells: Sequence[Cell]) -> list[Group]:
    """Returns the groups that have a baseline and a reduced representation.

    The control step of a group is the most frequent last step of its cells; if several are equally
    frequent, the latest.
    """
    found = []
    for group in _by_settings(cells):
        end = max(multimode(int(cell.last_step) for cell in group))
        short = [cell for cell in group if cell.last_step < end]
        long = [cell for cell in group if cell not in short]
        kinds = {kind_of(cell.representation) for cell in long}
        if kinds & {*BASELINES} and kinds - {*BASELINES}:
            found.append(Group([_point(cell, end) for cell in long], end, short))
    return found


def _point(cell: Cell, control_steps: int) -> Point:
    final = scores_of(cell, control_steps).final
    estimate = st.estimate(st.interquartile_mean, [final])
    return Point(cell, input_size(cell.representation, cell.task), final, estimate)


def _by_settings(cells: Sequence[Cell]) -> list[list[Cell]]:
    """Returns groups of cells on the plain robot that differ only in their representation."""
    return groups_same_but((cell for cell in cells if not cell.robots), "representation")


def frame(found: Sequence[Group]) -> pd.DataFrame:
    """Returns the numbers of the groups' figures.

    Columns: source, task, algo, representation, settings (those that distinguish a variant),
    returns (kind), latents, control_steps, seeds, iqm, low and high (95% interval), median.
    """
    return pd.DataFrame(
        [
            {
                "source": point.cell.source,
                "task": point.cell.task,
                "algo": point.cell.algo,
                "representation": point.cell.representation,
                "settings": point.cell.label,
                "returns": point.cell.kind.name,
                "latents": point.input_size,
                "control_steps": group.control_steps,
                "seeds": len(point.final),
                "iqm": point.estimate.value,
                "low": point.estimate.low,
                "high": point.estimate.high,
                "median": float(np.median(point.final)) if len(point.final) else np.nan,
            }
            for group in found
            for point in group.points
        ]
    ).astype({"latents": "Int64"})
