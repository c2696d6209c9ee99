"""Documents for the tests of the report's page."""

import numpy as np
import pandas as pd

from jbench.report.document import Document, FigureItem, Section, TableItem, Value
from jbench.report.figure import (
    Axis,
    Band,
    CellText,
    Figure,
    HeatMap,
    Panel,
    ReferenceLine,
    Series,
    Style,
    padded,
)

HOSTILE = (
    "<img src=x onerror=window.hacked=1>",
    "</script><script>window.hacked=1</script>",
    "</style><style>body{display:none}</style>",
    "<svg onload=window.hacked=1>",
    "\"onmouseover='window.hacked=1'",
    "javascript:window.hacked=1",
    "&lt;b&gt; &amp; ${window.hacked=1}",
    "=1+1",
    "evil\u202egnp.exe\u2066\x00\x1b[31m\ud800",
    "<!--",
)
"""Hostile names of runs: HTML, script and terminal injections."""

CURVES = pd.DataFrame(
    {
        "control_steps": np.arange(1, 31) * 1000.0,
        "td3": 20.0 * np.arange(1, 31) + 0.25,
        "td3_low": 18.0 * np.arange(1, 31),
        "td3_high": 24.0 * np.arange(1, 31),
        "ddpg": 600 - 17.5 * np.arange(1, 31),
    }
)


KEY = (("median", Style("0.25")),)


def curves_panel(names=("TD3 (10 seeds)", "DDPG (10 seeds)"), title="face_direction"):
    """Returns a panel of two learning curves, a band about the first, in thousands of steps."""
    x, td3, low, high, ddpg = CURVES.to_numpy().T
    return Panel(
        title,
        Axis("control steps (thousands)", (0, 30_000), unit=0.001),
        Axis("episode return", (-15, 1015)),
        [
            Series(x, td3, Style("#cc79a7"), names[0], [Band(low, high)]),
            Series(x, ddpg, Style("#0072b2"), names[1]),
            Series(x, ddpg / 2, Style("#000000")),
        ],
        [ReferenceLine(900, Style("#d00000"), "solved")],
    )


def curves_figure(*panels, notes=("With a band.",)):
    """Returns a figure of learning curves, with a panel unless there are others."""
    return Figure("Learning curves", panels or [curves_panel()], KEY, notes)


def log_figure():
    """Returns two panels: an empty one, and an error over latents on a logarithmic axis."""
    x, y = np.array([2.0, 4, 8, 12]), np.array([0.5, 0.1, 0.01, 0.002])
    empty = Panel("", Axis("", (0, 1), ticks=()), Axis("", (0, 1)), text="no runs yet")
    error = Panel(
        "",
        Axis("latents", padded(x), integer=True),
        Axis("variance not explained", padded(y, log=True), log=True),
        [Series(x, y, Style("0.2", marker="o"), "pca")],
    )
    return Figure("Errors", [empty, error], KEY, ["Against latents."])


MATRIX = np.array([[910.0, 12.5], [450.0, np.nan], [0.0, 668.25]])
TASKS, ALGORITHMS = ("face_direction", "move_to_position", "move_to_pose"), ("DDPG", "TD3")


def matrix_figure():
    """Returns a heat map of `MATRIX` with its numbers written in the cells."""
    texts = [
        CellText(row, column, f"{MATRIX[row, column]:.0f}", "#1a1a1a")
        for row, column in np.argwhere(np.isfinite(MATRIX))
    ]
    x, y = np.arange(3) - 0.5, np.arange(4) - 0.5
    panel = Panel(
        "",
        Axis("", (-0.5, 1.5), ticks=range(2), names=ALGORITHMS),
        Axis("", (2.5, -0.5), ticks=range(3), names=TASKS),
        heat_map=HeatMap(x, y, MATRIX, "final return", (0, 1000), texts=texts),
    )
    return Figure("Cells", [panel], notes=["By final return."])


TABLE = pd.DataFrame(
    {
        "algorithm": ["td3", "ddpg", "sac", "PPO", "td10"],
        "final return: median [10th, 90th]": [
            Value("668 [659, 676]", 668.0, best=True),
            Value("1,000 [990, 1,000]", 1000.0),
            Value("-3 [-5, -1]", -3.0),
            None,
            Value("99 [98, 100]", 99.0),
        ],
        "seeds": [10, 9, 100, 2, 1],
        "published median": [963.25, np.nan, 1e-5, 40.0, 1234567.8],
        "verdict": [
            Value("supported", "2"),
            Value("undecided", "10"),
            Value("contradicted", "1"),
            Value("", float("nan")),
            Value("not tested", "30"),
        ],
    }
)


def provenance(count=3, name="face_direction/td3/full/s{:02d}-1f9a2c4e"):
    """Returns rows of provenance, each with a long command."""
    return pd.DataFrame(
        [
            {
                "run": name.format(i),
                "wall time (s)": 100.5 + i,
                "python": "3.11.7",
                "processor": "AMD EPYC",
                "command": f"worker.py {i} " + '{"hidden_layers": [128, 128]} ' * 20,
            }
            for i in range(count)
        ]
    )


def document(**changes):
    """Returns a document with every kind of content."""
    parts = {
        "title": "Jitterbug learning curves",
        "summary": ["3 runs of TD3 on face_direction.", "No task is solved."],
        "problems": ["The run a/b can't be read."],
        "notes": ["Only 2 seeds: no band is drawn."],
        "sections": [
            Section(
                "Final returns",
                ["A final return is the mean of the last 100 episodes."],
                [TableItem("final_returns", "Final returns", "Across seeds.", TABLE)],
            ),
            Section(
                "Curves",
                [],
                [
                    FigureItem("curves", "Learning curves", curves_figure(), CURVES),
                    FigureItem("errors", "Errors", log_figure()),
                    FigureItem("matrix", "Cells", matrix_figure()),
                ],
            ),
        ],
        "provenance": provenance(),
        "command": "jbench report --window 5 --results 'my results'",
    }
    return Document(**{**parts, **changes})


def hostile_document():
    """Returns a document with hostile names in every place that shows untrusted text."""
    # matplotlib can't set half a surrogate pair.
    drawn = [name.replace("\ud800", "") for name in HOSTILE]
    figures = [
        FigureItem(
            name,
            name,
            curves_figure(curves_panel((label, label[::-1]), label), notes=[name]),
            CURVES,
        )
        for name, label in zip(HOSTILE, drawn, strict=True)
    ]
    # As objects, because pandas' string type can't hold half a surrogate pair.
    rows = [HOSTILE, [Value(name, name) for name in HOSTILE], [None] * len(HOSTILE)]
    frame = pd.DataFrame(rows, columns=pd.Index(HOSTILE, dtype=object), dtype=object)
    tables = [TableItem(name, name, name, frame) for name in HOSTILE]
    return Document(
        title=" ".join(HOSTILE),
        summary=HOSTILE,
        problems=HOSTILE,
        notes=HOSTILE,
        sections=[Section(name, HOSTILE, []) for name in HOSTILE]
        + [Section("All", [], [*figures, *tables])],
        provenance=frame,
        command=" ".join(HOSTILE),
    )
