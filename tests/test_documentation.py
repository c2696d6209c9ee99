"""What README and docs/ show is so: their blocks of code run, or are marked as illustrations.

A mark is an HTML comment above a block, which a reader of the page does not see:
`<!-- illustration: takes days -->`. The commands of marked blocks are parsed, not run.
"""

import html
import json
import re
import shlex
import shutil

import numpy as np
import pandas as pd
import pytest
import yaml
from typer.main import get_command

from jbench.cli import app
from jbench.datasets import Dataset
from jbench.paper import citation
from jbench.report.document import Document
from jbench.report.page import render_document
from jbench.store import Results
from jbench.tasks import features
from tests.documentation import PAGES, ROOT, Session, blocks_of

BLOCKS = {page.name: blocks_of(page.name, page.read_text()) for page in PAGES}
VERBS = get_command(app).commands


@pytest.fixture(scope="module")
def pages(demo_results, tmp_path_factory):
    """Runs a page's blocks once, in results like those of the demo; returns their outputs."""
    done = {}

    def outputs(page):
        if page not in done:
            session = Session(tmp_path_factory.mktemp("page"))
            _fill(session.directory / "results", demo_results.path)
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(session.directory)
                for block in BLOCKS[page]:
                    if block.illustration is None:
                        session.run(block)
            done[page] = session.outputs
        return done[page]

    return outputs


def _fill(directory, demo):
    """Copies results, with what readers have to cope with.

    That is a file and a folder that no manifest lists, as a kill may leave them, and a manifest
    whose fields have other types than those of the others.
    """
    shutil.copytree(demo, directory)
    manifest = next((directory / "runs").rglob("manifest.json"))
    said = {**json.loads(manifest.read_text()), "provenance": {"packages": [{"a": 1}]}}
    manifest.write_text(json.dumps(said))
    run = manifest.parent
    rows = next(run.glob("episodes-*.parquet"))
    shutil.copy(rows, run / "episodes-00007-00000000.parquet")
    left = directory / "runs" / "face_direction" / "td3" / "full" / "s09-00000000"
    left.mkdir()
    shutil.copy(rows, left)


@pytest.fixture
def output(pages):
    """Returns what the one block of a page that contains a text printed."""

    def find(page, containing):
        (block,) = (one for one in BLOCKS[page] if containing in one.text)
        return pages(page)[block.line]

    return find


SLOW = ("agents.md", "import.md", "recording.md", "submit.md")
"""Pages whose blocks take more than some five seconds."""


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.slow] if page in SLOW else []) for page in BLOCKS],
)
def test_blocks_run_unchanged(page, pages):
    run = [block.line for block in BLOCKS[page] if block.illustration is None]
    assert [*pages(page)] == run


@pytest.mark.parametrize("page", BLOCKS)
def test_commands_of_illustrations_have_verbs_and_options_that_there_are(page):
    for block in BLOCKS[page]:
        if block.illustration is None or block.kind not in ("sh", "console"):
            continue
        for line in block.commands.replace("\\\n", " ").split("\n"):
            program, *arguments = shlex.split(line, comments=True) or [""]
            if program == "jbench":
                VERBS[arguments[0]].make_context(arguments[0], arguments[1:])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_are_named_are_there(page):
    named = re.findall(r"\b(?:benchmarks|docs|tests)/[\w/.]+\.\w+", page.read_text())
    assert [name for name in named if not (ROOT / name).exists()] == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("Text.\n\n```ruby\nputs 1\n```\n", "page:3: a block of an unknown kind"),
        ("Text.\n\n```\nresults/\n```\n", "page:3: a block of an unknown kind"),
        ("Text.\n\n    jbench runs\n    rm -r results\n", "page:3: a block of an unknown kind"),
        ("<!-- illustration: slow -->\n\nText.\n\n    jbench runs\n", "no block of code below"),
        ("<!-- illustration -->\n\n    results/\n", "page:3: a block of an unknown kind"),
    ],
)
def test_a_block_of_an_unknown_kind_is_refused(text, says):
    with pytest.raises(ValueError, match=says):
        blocks_of("page", text)


def test_kinds_and_marks_are_distinguished():
    text = (
        "    jbench runs   # lists\n    jbench query \\\n        'FROM runs'\n\n"
        "<!-- illustration: takes days -->\n```\n$ jbench train\n```\n\n"
        '```\n$ jbench query "FROM\n      runs"\n 1 row\n```\n\n'
        "<!-- illustration: a layout -->\n\n    results/\n"
    )
    first, second, third, fourth = blocks_of("page", text)
    assert (first.kind, first.illustration) == ("sh", None)
    assert (second.kind, second.illustration) == ("console", "takes days")
    assert (third.commands, third.output) == ('jbench query "FROM\n      runs"', " 1 row\n")
    assert (fourth.kind, fourth.illustration) == (None, "a layout")


# What the blocks of some pages print, against what was written into the results.

MEANS = {"s00-cbbe1b0b": 792.0, "s01-ad6653f9": 736.0}


def numbers(text):
    return np.array([float(number) for number in re.findall(r"-?\d+\.\d+(?:e-?\d+)?", text)])


@pytest.fixture(scope="module")
def dataset(demo_results):
    return Dataset(Results(demo_results.path).scan("dataset")[0][0])


@pytest.mark.parametrize("library", ["import pandas", "import polars"])
def test_dataframes_hold_the_rows_that_manifests_list_and_no_others(library, output):
    printed = output("database.md", library)
    for run, mean in MEANS.items():
        # Polars cuts the ids short.
        assert re.search(rf"full/{run[:5]}\S*\W+{mean}", printed)


def test_duckdb_finds_the_rows_that_manifests_list_and_no_others(output):
    rows = dict(output("database.md", "SET VARIABLE"))
    assert {run[-12:]: mean for run, mean in rows.items() if "/full/" in run} == MEANS


@pytest.mark.parametrize("library", ["import pandas", "import polars", "import duckdb"])
def test_files_of_a_dataset_are_read_without_jbench(library, output, dataset):
    (block,) = dataset.blocks("move_from_origin")
    heights = features.denormalize("move_from_origin", block.observations)[..., 2]
    printed = numbers(output("datasets.md", library))
    for wanted in heights.mean(axis=1):
        assert np.isclose(printed, wanted, rtol=1e-3).any()


def test_blocks_of_a_dataset_are_as_a_task_sees_them(output, dataset):
    (block,) = dataset.blocks("move_to_pose")
    printed = output("datasets.md", "print(block.observations.shape")
    assert "(2, 1001, 19) (2, 1000)" in printed
    np.testing.assert_allclose(numbers(printed.split("[")[1]), block.rewards.sum(axis=1), rtol=1e-5)


def test_torch_reads_transitions(output):
    # 2000 transitions in batches of 256: the last has 208.
    sizes = "([208, 16]) ([208]) ([208]) ([208, 16])"
    printed = output("datasets.md", "import torch")
    assert printed.split() == sizes.replace("(", "torch.Size(").split()


def test_minari_loads_what_was_exported(output, dataset):
    id = f"jitterbug/face_direction/{dataset.id.replace('/', '-')}-v0"
    printed = output("datasets.md", "import minari")
    assert printed.split("\n")[0] == f"{id} 2 (1001, 16) (1000, 1)"


def test_queries_of_encoders_md_name_a_column_of_one_table(output):
    printed = output("encoders.md", "FROM encoder_errors")
    assert re.search(r"dae12 +0\.927 +0\.937 +0\.919", printed)


# The paper is cited in the same words everywhere.


def test_readme_and_page_cite_the_paper():
    readme = " ".join((ROOT / "README.md").read_text().split())
    first, second, third = citation.AUTHORS
    assert f"{first}, {second} and {third}, *{citation.TITLE}*" in readme
    assert f"{citation.VENUE}, {citation.YEAR}" in readme
    page = html.unescape(render_document(Document("", [], [], [], [], pd.DataFrame(), "")))
    assert citation.CITATION in page


def test_citation_file_cites_the_paper():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    for work in cited["references"]:
        names = [f"{one['given-names']} {one['family-names']}" for one in work["authors"]]
        assert tuple(names) == citation.AUTHORS
        assert (work["title"], work["year"]) == (citation.TITLE, citation.YEAR)
        assert (work["type"], work["collection-title"]) == ("conference-paper", citation.VENUE)
