"""The verdicts on representations on a terminal."""

import sys
from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING

from jbench.commands import output

if TYPE_CHECKING:
    from jbench.report.verdict_matrices import VerdictMatrix

_WIDE = 120
"""Characters of a line from which verdicts against two baselines are beside each other."""


def print_verdicts(title: str, matrix: "VerdictMatrix") -> None:
    """Prints the verdicts on some representations: in a narrow line, a table for each baseline."""
    width = output.width(sys.stdout)
    if width is None or width >= _WIDE:
        pairs = product(matrix.baselines, matrix.claims.values())
        header = [f"{claim} against {baseline}" for baseline, claim in pairs]
        _print_against(title, matrix, matrix.baselines, header)
        return

    for baseline in matrix.baselines:
        header = list(matrix.claims.values())
        _print_against(f"{title} Against {baseline}", matrix, [baseline], header)


def _print_against(
    title: str, matrix: "VerdictMatrix", baselines: Sequence[str], header: Sequence[str]
) -> None:
    """Prints the verdicts against some baselines, on the representations that have any."""
    from jbench.report.table import OBSERVED

    count = len(matrix.claims)
    first = matrix.baselines.index(baselines[0]) * count
    rows = []
    for about, group in matrix.groups.items():
        for row in group:
            verdicts = row.verdicts[first : first + count * len(baselines)]
            if any(verdicts):
                cells = (cell and f"{cell.mark} {cell.verdict}" for cell in verdicts)
                rows.append([about, OBSERVED.form(vars(row)), *cells])

    output.table(title, ["", "representation", *header], rows)
