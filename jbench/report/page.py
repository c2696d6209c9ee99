"""The report's page: one file, with everything in it, that needs no network and runs no script."""

import base64
import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import pandas as pd

_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 80rem; margin: 2rem auto; padding: 0 1rem; }
figure { margin: 1.5rem 0; }
img { max-width: 100%; height: auto; background: white; border-radius: 6px; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.875rem; font-variant-numeric: tabular-nums; }
th, td { padding: 0.3rem 0.7rem; text-align: left; vertical-align: top; }
th { border-bottom: 1px solid; }
td { border-bottom: 1px solid color-mix(in srgb, currentColor 20%, transparent); }
th.number, td.number { text-align: right; }
td.number { white-space: nowrap; }
td.notes { min-width: 20rem; }
.problems { border-left: 4px solid #d00000; padding-left: 1rem; }
"""

_ORDERS = (
    "Quantile-first, the order of the paper's Figure 9, takes the quantiles across seeds in each "
    "episode and then averages them over a window of episodes, so its bands hold the ups and "
    "downs of single episodes too. Smooth-first, the order of Figure 8, averages each seed over "
    "the window and then takes the quantiles across seeds, so its bands show how seeds differ "
    "and are narrower."
)

_FINAL = (
    "A final return is the mean of a run's last 100 episodes, or of its last quarter where that "
    "is less; median and percentiles are across seeds, and are spread, not a confidence interval. "
    "The published median is the paper's best at the same number of control steps."
)

_REDUCED = (
    "The fraction of the variance of the scaled features that an encoder does not give back, on "
    "held-out episodes of its dataset and on episodes of the task's hand-written policy; beside it "
    "PCA and a random projection of the same size, on the same states. Medians across seeds."
)


def render(
    table: pd.DataFrame,
    encoders: pd.DataFrame,
    pictures: Mapping[str, bytes],
    notes: Sequence[str],
    problems: Sequence[str],
) -> str:
    """Returns the page as HTML.

    Args:
        table: of the report.
        encoders: errors of encoders, as `encoders.encoder_table` returns them.
        pictures: content of the figures' files, by name; the PNGs are put into the page.
        notes: sentences for a reader of the curves.
        problems: sentences on what can't be read.
    """
    images = [(name, content) for name, content in pictures.items() if name.endswith(".png")]
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            "<title>Jitterbug learning curves</title>",
            f"<style>{_STYLE}</style>",
            "</head>",
            "<body>",
            "<h1>Jitterbug learning curves</h1>",
            *_list("Problems", problems, "problems"),
            *_learning(table),
            *[_figure(name, content) for name, content in images],
            *_encoders(encoders),
            *_list("Notes", notes, "notes"),
            "</body>",
            "</html>",
            "",
        ]
    )


def _learning(table: pd.DataFrame) -> list[str]:
    """Returns what the page says of runs; without any it shows what policies do, and no more."""
    if table.empty:
        return ["<p>There are no runs yet; this is what else was made.</p>"]
    return [
        "<h2>Final returns</h2>",
        f"<p>{escape(_FINAL)}</p>",
        _table(table),
        "<h2>Curves</h2>",
        f"<p>{escape(_ORDERS)}</p>",
    ]


def _encoders(table: pd.DataFrame) -> list[str]:
    """Returns the table of encoders, if there are any."""
    if table.empty:
        return []
    header = ("task", "kind", "latents", "seeds", "not explained", "PCA's", "random projection's")
    more = ("heuristic's episodes", "PCA's there")
    rows = ["<tr>", *[f"<th>{escape(name)}</th>" for name in (*header, *more)], "</tr>"]
    for row in table.to_dict("records"):
        fractions = ("test", "pca", "random", "heuristic", "pca_heuristic")
        numbers = [str(row["latents"]), str(row["seeds"]), *(f"{row[n]:.4f}" for n in fractions)]
        kind = " ".join(filter(None, (row["kind"], row["settings"])))
        rows.append("<tr>")
        rows += [f"<td>{escape(text)}</td>" for text in (row["task"], kind)]
        rows += [f'<td class="number">{text}</td>' for text in numbers]
        rows.append("</tr>")
    return [
        "<h2>Encoders</h2>",
        f"<p>{escape(_REDUCED)}</p>",
        "\n".join(['<div class="wide">', "<table>", *rows, "</table>", "</div>"]),
    ]


def _list(title: str, sentences: Sequence[str], kind: str) -> list[str]:
    if not sentences:
        return []
    items = [f"<li>{escape(sentence)}</li>" for sentence in sentences]
    return [f'<section class="{kind}">', f"<h2>{title}</h2>", "<ul>", *items, "</ul>", "</section>"]


def _figure(name: str, content: bytes) -> str:
    data = base64.b64encode(content).decode()
    title = name.removesuffix(".png")
    return (
        f'<figure><img alt="{escape(f"Figure: {title}")}" '
        f'src="data:image/png;base64,{data}"><figcaption>{escape(title)}</figcaption></figure>'
    )


def _table(table: pd.DataFrame) -> str:
    header = (
        ("task", ""),
        ("algorithm", ""),
        ("representation", ""),
        ("variant", ""),
        ("seeds", "number"),
        ("episodes", "number"),
        ("control steps", "number"),
        ("final return: median [10th, 90th]", "number"),
        ("published median", "number"),
        ("notes", "notes"),
    )
    rows = ["<tr>", *[f'<th class="{kind}">{name}</th>' for name, kind in header], "</tr>"]
    kinds = [kind for _, kind in header]
    for row in table.to_dict("records"):
        cells = zip(_texts(row), kinds, strict=True)
        rows.append("<tr>")
        rows += [f'<td class="{kind}">{escape(text)}</td>' for text, kind in cells]
        rows.append("</tr>")
    return "\n".join(['<div class="wide">', "<table>", *rows, "</table>", "</div>"])


def _texts(row: Mapping[Any, Any]) -> list[str]:
    """Returns the row's cells as a reader wants them: the CSV keeps the exact numbers."""
    low, high = row["episodes_min"], row["episodes_max"]
    spread = f"[{row['final_return_q10']:.0f}, {row['final_return_q90']:.0f}]"
    published = row["published_median"]
    return [
        row["task"],
        row["algo"],
        row["representation"],
        row["settings"] or row["variant"],
        str(row["seeds"]),
        str(low) if low == high else f"{low}\N{EN DASH}{high}",
        f"{row['control_steps']:,.0f}",
        f"{row['final_return_median']:.0f} {spread}",
        ""
        if math.isnan(published)
        else f"{published:.0f} ({row['published_figure'].replace('fig', 'Figure ')})",
        row["notes"],
    ]
