"""Draws figures of README and docs/answer.md from the shipped runs: docs/images/draw_answer.py.

They are figures of `jbench report`, as for a paper, of the runs of the batched engine in float32.
"""

import io
import shutil
import tempfile
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from jbench.report import figures, style
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.settings.defaults import nearest_base
from jbench.store import Results
from jbench.store.shipped import shipped_results

HERE = Path(__file__).parent
COLORS = 256
SMALLER = 0.7  # than in a paper
BOTH = ("running", "none")


class Drawing(NamedTuple):
    """A file of docs/images, and the figure of the report in it.

    Attributes:
        columns: its width in columns of a paper; with one, a phone shows it at a legible size.
        settings: of its agents: those of Table 1 (`published`) or of Figures 7 and 8 (`figure8`).
        normalize: what its agents do with their inputs.
        representations: those whose runs it shows; none for all.
    """

    name: str
    figure: str = "representations"
    task: str = "face_direction"
    algo: str = "td3"
    columns: int = 1
    settings: str = "published"
    normalize: tuple[str, ...] = ("none",)
    representations: tuple[str, ...] = ()


DRAWINGS = (
    Drawing(
        "readme-td3",
        representations=("full", "scaled16", "planar12", "planar-mirror12", "dae12"),
    ),
    Drawing(
        "answer-td3",
        columns=2,
        representations=(
            "full",
            "scaled16",
            "planar12",
            "planar-mirror12",
            "planar-no-yaw11",
            "heading16",
        ),
    ),
    Drawing(
        "answer-td3-encoders",
        columns=2,
        representations=(
            "full",
            "forward12",
            "random12",
            "pca12",
            "dae12",
            "dae12-whitened",
            "dae12-observation",
            "dae12-observation-whitened",
            "dae-yaw13",
        ),
    ),
    Drawing("answer-harder", task="move_in_direction", columns=2),
    Drawing(
        "answer-authors",
        algo="ddpg",
        columns=2,
        settings="figure8",
        normalize=("running",),
        representations=("raw16", "dae12-script"),
    ),
    Drawing("answer-standardized", algo="ddpg", columns=2, settings="figure8", normalize=BOTH),
    Drawing(
        "answer-authors-harder",
        task="move_in_direction",
        algo="ddpg",
        columns=2,
        settings="figure8",
        normalize=("running",),
    ),
    Drawing("answer-hopper", task="gym:Hopper-v5", settings="suite"),
    Drawing("answer-cheetah", task="dmc:cheetah-run", settings="suite"),
)


def copy_compared(target: Path, drawing: Drawing) -> Results:
    """Copies the shipped runs that a figure shows, all encoders and all evaluations."""
    source = shipped_results()
    for run in source.scan("run")[0]:
        if run.settings["engine"] != "batched" or "precision" in run.settings:
            continue

        representation = run.id.split("/")[2]
        if drawing.representations and representation not in drawing.representations:
            continue

        hyperparameters = run.settings["hyperparameters"]
        settings = nearest_base(run.settings["algo"], hyperparameters, run.settings["task"])
        normalize = hyperparameters.get("normalize", "none")
        if settings == drawing.settings and normalize in drawing.normalize:
            shutil.copytree(run.path, target / run.path.relative_to(source.path))

    for kind in ("encoders", "evaluations"):
        shutil.copytree(source.path / kind, target / kind)
    return Results(target)


def draw(results: Results, drawing: Drawing) -> None:
    """Draws a figure with few colors and pixels, which makes its file small."""
    found = Frames(results, Request(task=drawing.task, algo=(drawing.algo,)))
    made = figures.charts(found)
    (drawn,) = (one.figure(drawing.columns) for one in made if one.name == drawing.figure)
    picture = Image.open(io.BytesIO(style.image(drawn, "png"))).convert("RGB")
    picture = picture.resize(
        (round(SMALLER * picture.width), round(SMALLER * picture.height)), Image.Resampling.LANCZOS
    )
    path = HERE / f"{drawing.name}.png"
    picture.quantize(COLORS).save(path, optimize=True)
    print(f"{path}: {path.stat().st_size / 1e3:.0f} KB")


if __name__ == "__main__":
    for one in DRAWINGS:
        with tempfile.TemporaryDirectory() as directory:
            draw(copy_compared(Path(directory), one), one)
