"""Settings, learning curves and paths of the single runs of a report."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from jbench.remembered import remembered
from jbench.report.data.cells import OURS, page_tags
from jbench.report.data.paths import RunPath
from jbench.report.document import RunCurve, RunDetail
from jbench.report.views import View
from jbench.settings.alike import flatten
from jbench.settings.run import RunSettings, parse_run
from jbench.settings.variants import value_text


def details(
    views: Sequence[View], runs: pd.DataFrame, paths: Mapping[tuple[str, str], Sequence[RunPath]]
) -> list[RunDetail]:
    """Returns the run of each row.

    Args:
        views: contain the curves. A run without a curve is in no cell, or has no episodes yet.
        runs: rows of the table `runs`, with a column `source` if there are several.
        paths: by source and run.
    """
    curves = _curves(views)
    found = []
    for row in runs.to_dict("records"):
        source, id = row.get("source", OURS), str(row["run"])
        settings = _texts(row["settings"])
        found.append(
            RunDetail(
                name=f"{source}: {id}" if "source" in row else id,
                cell=(source, str(row["variant"])),
                settings=settings,
                curves=curves.get((source, id), []),
                tags=page_tags(
                    str(row["algo"]), str(row["representation"]), source, str(row["task"])
                ),
                paths=paths.get((source, id), []),
            )
        )
    return found


def _curves(views: Sequence[View]) -> dict[tuple[str, str], list[RunCurve]]:
    """Returns the learning curves of single runs, by source and run."""
    curves: dict[tuple[str, str], list[RunCurve]] = {}
    for cell, curve in (item for view in views for item in view.learned):
        mean = f", mean over {curve.window} episodes" if cell.kind.smoothed else ""
        label = f"{cell.kind.name} return{mean}"
        for run, returns in zip(cell.runs, curve.each, strict=True):
            shown = np.isfinite(returns)
            if shown.any():
                points = slice(None) if shown.all() else shown  # a slice copies nothing
                one = RunCurve(label, curve.control_steps[points], returns[points])
                curves.setdefault((cell.source, run), []).append(one)
    return curves


@remembered
def _texts(settings: str) -> Mapping[str, str]:
    """Returns the text of each setting by its name, in the order of the fields of `RunSettings`."""
    run = parse_run(settings)
    order = {name: i for i, name in enumerate(RunSettings.model_fields)}
    ordered = sorted(flatten(run).items(), key=lambda item: (order.get(item[0][0], 99), item[0]))
    return {
        ".".join(path): "none" if value is None else value_text(value) for path, value in ordered
    }
