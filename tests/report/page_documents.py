"""Documents for the tests of the report's page."""

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from jbench.report.document import Document, FigureItem, Section, TableItem, Value

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
"""Names that nobody should give a run, and anybody could."""

CURVES = pd.DataFrame(
    {
        "control_steps": np.arange(1, 31) * 1000.0,
        "td3": 20.0 * np.arange(1, 31) + 0.25,
        "td3_low": 18.0 * np.arange(1, 31),
        "td3_high": 24.0 * np.arange(1, 31),
        "ddpg": 600 - 17.5 * np.arange(1, 31),
    }
)


def curves_figure(names=("TD3 (10 seeds)", "DDPG (10 seeds)"), title="face_direction"):
    """Returns a panel of two learning curves, a band about the first, in thousands of steps."""
    figure = Figure(figsize=(6, 4), facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.1, 0.15, 0.85, 0.75))
    x = CURVES["control_steps"]
    axes.fill_between(x, CURVES["td3_low"], CURVES["td3_high"], color="#CC79A7", alpha=0.2)
    axes.plot(x, CURVES["td3"], color="#CC79A7", label=names[0])
    axes.plot(x, CURVES["ddpg"], color="#0072B2", label=names[1])
    axes.plot(x, CURVES["ddpg"] / 2, color="#000000", label="_a single seed")
    axes.axhline(900, color="#d00000", label="solved")
    axes.set_title(title, loc="left", parse_math=False)
    axes.set_xlim(0, 30_000)
    axes.set_ylim(-15, 1015)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / 1000:g}"))
    axes.set_xlabel("control steps (thousands)")
    axes.set_ylabel("episode return")
    legend = axes.legend()
    for text in legend.get_texts():
        text.set_parse_math(False)
    return figure


def log_figure():
    """Returns two panels: an error over latents on a logarithmic axis, and nothing to read."""
    figure = Figure(figsize=(11, 3), facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    empty, axes = figure.subplots(1, 2)
    empty.text(0.5, 0.5, "no runs yet")
    axes.plot([2, 4, 8, 12], [0.5, 0.1, 0.01, 0.002], color="0.2", marker="o", label="pca")
    axes.set_yscale("log")
    axes.set_xlabel("latents")
    axes.set_ylabel("variance not explained")
    return figure


MATRIX = np.array([[910.0, 12.5], [450.0, np.nan], [0.0, 668.25]])
TASKS, ALGORITHMS = ("face_direction", "move_to_position", "move_to_pose"), ("DDPG", "TD3")


def matrix_figure():
    """Returns a heat map of `MATRIX` with its numbers written in the cells."""
    figure = Figure(figsize=(5, 4), facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    edges = np.arange(4) - 0.5
    mesh = axes.pcolormesh(edges[:3], edges, np.ma.masked_invalid(MATRIX), vmin=0, vmax=1000)
    axes.set_facecolor("0.93")
    axes.patch.set_hatch("////")
    axes.patch.set_edgecolor("0.75")
    axes.set_xticks(range(2), ALGORITHMS)
    axes.set_yticks(range(3), TASKS)
    for row, column in np.argwhere(np.isfinite(MATRIX)):
        axes.text(column, row, f"{MATRIX[row, column]:.0f}", color="0.1", ha="center")
    figure.colorbar(mesh).set_label("final return")
    return figure


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
    """Returns so many rows of provenance, each with a long command."""
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
    """Returns a document with every kind of thing in it."""
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
                    FigureItem(
                        "curves", "Learning curves", "With a band.", curves_figure(), CURVES
                    ),
                    FigureItem("errors", "Errors", "Against latents.", log_figure()),
                    FigureItem("matrix", "Cells", "By final return.", matrix_figure()),
                ],
            ),
        ],
        "provenance": provenance(),
        "command": "jbench report --window 5 --results 'my results'",
    }
    return Document(**{**parts, **changes})


def hostile_document():
    """Returns a document with hostile names wherever a stranger's text can get."""
    # matplotlib can't set half a surrogate pair.
    drawn = [name.replace("\ud800", "") for name in HOSTILE]
    figures = [
        FigureItem(name, name, name, curves_figure((label, label[::-1]), label), CURVES)
        for name, label in zip(HOSTILE, drawn, strict=True)
    ]
    # As objects, since pandas' own texts can't hold half a surrogate pair.
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
