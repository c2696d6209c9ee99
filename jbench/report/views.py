"""Views: the parts of a report, each on one kind of return."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jbench.names import Order
from jbench.report.analysis import comparisons, reduction, scores
from jbench.report.analysis.claims import Finding
from jbench.report.analysis.comparisons import Comparison
from jbench.report.analysis.examine import examine
from jbench.report.analysis.reduction import Group, Reduction
from jbench.report.analysis.scores import Summary
from jbench.report.data.cells import IMPORTED, Cell, LearnedCurve, of_kind, paper_order, verified
from jbench.report.data.curves import Curve, learning_curve
from jbench.report.data.published import PublishedCurve, imported_curve
from jbench.report.data.returns import EVALUATION, KINDS, TRAINING, Returns
from jbench.report.request import Request

SEQUENCE_WINDOW = 20
"""Episodes in a moving average, within each robot's episodes (the authors' script)."""


@dataclass(frozen=True)
class View:
    """The part of a report on one kind of return.

    Attributes:
        leads: whether figures and statistics show this kind first.
        learned: curves in the order of the paper.
        statistics: of each cell, in the same order.
        reductions: comparisons of each representation with the full and the scaled observation.
        groups: cells that differ only in their representation.
        findings: on the claims (a) to (g); empty unless they were requested.
        baseline: algorithm whose imported curves are drawn as published ones, or None.
    """

    kind: Returns
    leads: bool
    learned: Sequence[LearnedCurve]
    statistics: Sequence[Summary]
    comparisons: Sequence[Comparison]
    reductions: Sequence[Reduction]
    groups: Sequence[Group]
    findings: Sequence[Finding]
    baseline: str | None = None

    @property
    def drawn(self) -> list[LearnedCurve]:
        """Curves of runs and imports, without those of the baseline."""
        return [item for item in self.learned if not self._is_baseline(item.cell)]

    @property
    def baselines(self) -> list[PublishedCurve]:
        """Curves of the baseline."""
        return [imported_curve(item) for item in self.learned if self._is_baseline(item.cell)]

    def _is_baseline(self, cell: Cell) -> bool:
        return cell.source == IMPORTED and cell.algo == self.baseline

    @property
    def cells(self) -> list[Cell]:
        """Cells of the curves."""
        return [item.cell for item in self.learned]

    def file(self, name: str) -> str:
        """Returns a file name with the kind of return appended, except for the leading kind."""
        return name if self.leads else f"{name}-{self.kind.name}"


def views_of(
    sources: Sequence[Sequence[Cell]],
    published: Sequence[PublishedCurve],
    request: Request,
) -> list[View]:
    """Returns a view for each kind of return, the leading one first; at least one.

    Args:
        sources: cells of each source, of both kinds.
        request: determines the leading kind, the smoothing, what is compared, and whether claims
            are tested.
    """
    views: list[View] = []
    for kind in sorted(KINDS.values(), key=lambda kind: kind.name != request.returns):
        of_sources = [of_kind(cells, kind) for cells in sources]
        cells = sorted((cell for one in of_sources for cell in one), key=paper_order)
        if not cells and (kind is not TRAINING or views):
            continue
        learned = [LearnedCurve(cell, curve_of(cell, request)) for cell in cells]
        views.append(
            View(
                kind=kind,
                leads=not views,
                learned=learned,
                statistics=scores.summaries(learned, published),
                comparisons=_comparisons(of_sources, request),
                reductions=reduction.reductions(verified(cells)),
                groups=reduction.groups(verified(cells)),
                findings=examine(verified(cells)) if request.claims else [],
                baseline=request.baseline,
            )
        )
    return views


def cells_of(views: Sequence[View]) -> list[Cell]:
    """Returns one cell for the runs of each setting: the one with most seeds.

    Of cells with equally many seeds, it is that of training returns.
    """
    found: dict[tuple[str, ...], Cell] = {}
    for view in sorted(views, key=lambda view: view.kind is TRAINING):
        for cell in view.cells:
            if len(cell.seeds) >= len(found.get(cell.key, cell).seeds):
                found[cell.key] = cell
    return list(found.values())


def curve_of(cell: Cell, request: Request) -> Curve:
    """Returns the curve of a cell: a moving average of episodes, or the single evaluations."""
    if cell.kind.smoothed and cell.robots > 1:
        return _sequence_curve(cell, request.order)
    window = request.window if cell.kind.smoothed else 1
    return learning_curve(cell.returns, cell.control_steps, cell.lengths, request.order, window)


def _sequence_curve(cell: Cell, order: Order) -> Curve:
    """Aggregates runs on several robots, each robot's episodes separately.

    A moving average across the switch from one robot to the next would hide it.
    """
    parts = []
    for first in range(0, cell.returns.shape[1], cell.robot_episodes):
        columns = slice(first, first + cell.robot_episodes)
        returns, control_steps = cell.returns[:, columns], cell.control_steps[:, columns]
        lengths = np.clip(cell.lengths - first, 0, returns.shape[1])
        parts.append(learning_curve(returns, control_steps, lengths, order, SEQUENCE_WINDOW))
    names = ("control_steps", "seeds", "quantiles", "each", "widths")
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in names
    }
    return replace(parts[0], **joined)


def _comparisons(sources: Sequence[Sequence[Cell]], request: Request) -> list[Comparison]:
    """Compares the two sides of the request, or the cells of all sources with each other."""
    if request.compare is not None:
        one, other = sources
        return comparisons.across(one, other, request.names_compared)
    return comparisons.within([cell for cells in sources for cell in cells])


def missing_evaluations(views: Sequence[View], request: Request) -> list[str]:
    """Returns a note on cells without evaluations, if there are any."""
    of_training = {c.key: c for view in views if view.kind is TRAINING for c in view.cells}
    evaluated = {c.key for view in views if view.kind is EVALUATION for c in view.cells}
    without = [cell.name for key, cell in of_training.items() if key not in evaluated]
    if not without:
        return []
    if evaluated:
        return [
            "These cells have no evaluations and appear only with training returns: "
            f"{'; '.join(without)}."
        ]
    if request.returns == TRAINING.name:
        return []
    return ["No run has evaluations: the report leads with training returns, exploration included."]
