"""Writes the golden frames: python -m tests.report.golden.make."""

import tempfile
from pathlib import Path

from jbench.report.analysis import claims, comparisons, reduction, scores
from jbench.report.report import gather
from tests.report.conftest import FabricatedResults
from tests.report.golden.cases import CASES

THINNED = 20
"""Of the points of all curves, every so many are kept."""


def frames(data):
    """Returns the golden frames of a report's data by name."""
    yield "aggregate", data.aggregate.iloc[::THINNED]
    yield "table", data.table.drop(columns="notes")
    statistics = [one for view in data.views for one in view.statistics]
    yield "seed_statistics", scores.statistics_frame(statistics)
    yield "seed_comparisons", comparisons.comparisons_frame(data.comparisons)
    yield "reduction", reduction.frame([group for view in data.views for group in view.groups])
    yield "claims", claims.findings_frame(data.findings)
    if not data.encoders.empty:
        yield "encoders", data.encoders


def main():
    for name, make in CASES.items():
        with tempfile.TemporaryDirectory() as path:
            data = gather(*make(FabricatedResults(Path(path))))
            for frame, rows in frames(data):
                file = Path(__file__).parent / f"{name}-{frame}.csv"
                rows.to_csv(file, index=False, float_format="%.9g")
                print(file.name, len(rows))


if __name__ == "__main__":
    main()
