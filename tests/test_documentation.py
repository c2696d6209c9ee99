"""Tests of README and docs/: their code blocks run, or are marked as illustrations.

A mark is an HTML comment above a block: `<!-- illustration: takes days -->`. The commands of marked
blocks are parsed, not run. Outputs are compared with the rows of the results.
"""

import html
import importlib.util
import json
import math
import pydoc
import re
import shlex
import shutil

import numpy as np
import pytest
import yaml
from typer.main import get_command

import jbench
from jbench import paper
from jbench.archive import croissant
from jbench.cli import app
from jbench.datasets import Dataset
from jbench.report import page
from jbench.report.frames import Frames
from jbench.store import Results
from jbench.studies.matrix import read_matrix
from jbench.tasks.jitterbug import features
from tests.documentation import PAGES, ROOT, Session, blocks_of

BLOCKS = {page.name: blocks_of(page.name, page.read_text()) for page in PAGES}
VERBS = get_command(app).commands


@pytest.fixture(scope="module")
def pages(demo_results, tmp_path_factory):
    """Returns a function that runs the blocks of a page once, on results like the demo's."""
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
    """Copies results; adds unlisted files, as after a kill, and a manifest with other types."""
    shutil.copytree(demo, directory)
    manifest = next((directory / "runs").rglob("manifest.json"))
    reported = {**json.loads(manifest.read_text()), "provenance": {"packages": [{"a": 1}]}}
    manifest.write_text(json.dumps(reported))
    run = manifest.parent
    rows = next(run.glob("episodes-*.parquet"))
    shutil.copy(rows, run / "episodes-00007-00000000.parquet")
    left = directory / "runs" / "face_direction" / "td3" / "full" / "s09-00000000"
    left.mkdir()
    shutil.copy(rows, left)


@pytest.fixture
def output(pages):
    """Returns a function: the output of the only block of a page that contains a text."""

    def find(page, containing):
        (block,) = (block for block in BLOCKS[page] if containing in block.text)
        return pages(page)[block.line]

    return find


SLOW = {
    "agents.md",
    "checking.md",
    "curves.md",
    "database.md",
    "datasets.md",
    "encoders.md",
    "export.md",
    "figure9.md",
    "programs.md",
    "import.md",
    "recording.md",
    "report.md",
    "statistics-only.md",
    "submit.md",
    "tracking.md",
    "SKILL.md",
}
"""Pages whose blocks take more than about two seconds."""


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.slow] if page in SLOW else []) for page in BLOCKS],
)
def test_code_blocks_run(page, pages):
    run = [block.line for block in BLOCKS[page] if block.illustration is None]
    assert [*pages(page)] == run


@pytest.mark.parametrize("page", BLOCKS)
def test_commands_of_illustrations_parse(page):
    for block in BLOCKS[page]:
        if block.illustration is None or block.kind not in ("sh", "console"):
            continue
        for line in block.commands.replace("\\\n", " ").split("\n"):
            program, *arguments = shlex.split(line, comments=True) or [""]
            if program == "jbench":
                VERBS[arguments[0]].make_context(arguments[0], arguments[1:])


def test_no_line_of_a_paragraph_begins_as_an_item_of_a_list():
    """Markdown would make a list of `919. So`, and leave the number out."""
    begins = re.compile(r"^ *\d{2,}[.)] .*", re.MULTILINE)
    assert [(page.name, line) for page in PAGES for line in begins.findall(page.read_text())] == []


def test_named_files_exist():
    file = re.compile(r"\b(?:benchmarks|docs|tests)/[\w/.]+\.\w+")
    named = [(page.name, name) for page in PAGES for name in file.findall(page.read_text())]
    assert len(named) > 50
    assert [(page, name) for page, name in named if not (ROOT / name).exists()] == []


def test_page_on_sweeps_counts_the_runs_of_each_matrix():
    page = (ROOT / "docs" / "sweeps.md").read_text()
    counted = re.findall(r"^\| `(\w+)` \|.*\| (\d+) of ", page, re.MULTILINE)
    assert len(counted) > 5
    for name, runs in counted:
        axes = [(p.tasks, p.algos, p.representations, p.seeds) for p in read_matrix(name).values()]
        assert (name, sum(math.prod(map(len, part)) for part in axes)) == (name, int(runs))


def test_objects_of_python_api_exist():
    named = re.findall(r"^::: (\S+)", (ROOT / "docs" / "api.md").read_text(), re.MULTILINE)
    assert len(named) > 10
    assert [name for name in named if pydoc.locate(name) is None] == []


# Outputs of blocks, compared with the rows that were written to the results.

MEANS = {"s00-208b2f2e": 320.0, "s01-907963a4": 478.0}


def numbers(text):
    return [float(number) for number in re.findall(r"-?\d+\.\d+(?:e-?\d+)?", text)]


@pytest.fixture(scope="module")
def dataset(demo_results):
    return Dataset(Results(demo_results.path).scan("dataset")[0][0])


@pytest.mark.slow
def test_pandas_and_duckdb_read_only_rows_listed_by_manifests(output):
    printed = output("database.md", "import pandas")
    for run, mean in MEANS.items():
        assert re.search(rf"full/{run}\W+{mean}", printed)
    rows = dict(output("database.md", "SET VARIABLE"))
    assert {run[-12:]: mean for run, mean in rows.items() if "/full/" in run} == MEANS


@pytest.mark.parametrize("library", ["import pandas", "import duckdb"])
def test_dataset_files_are_read_without_jbench(library, output, dataset):
    (block,) = dataset.blocks("move_from_origin")
    heights = features.denormalize("move_from_origin", block.observations)[..., 2]
    printed = np.array(numbers(output("datasets.md", library)))
    for wanted in heights.mean(axis=1):
        assert np.isclose(printed, wanted, rtol=1e-3).any()


def test_dataset_blocks_have_observations_and_rewards_of_task(output, dataset):
    (block,) = dataset.blocks("move_to_pose")
    printed = output("datasets.md", "print(block.observations.shape")
    assert "(2, 1001, 19) (2, 1000)" in printed
    np.testing.assert_allclose(numbers(printed.split("[")[1]), block.rewards.sum(axis=1), rtol=1e-5)


def test_torch_and_minari_load_the_dataset(output, dataset):
    # 2000 transitions in batches of 256: the last has 208.
    sizes = re.findall(r"\[(.*?)\]", output("datasets.md", "import torch"))
    assert sizes == ["208, 16", "208", "208", "208, 16"]
    id = f"jitterbug/face_direction/{dataset.id.replace('/', '-')}-v0"
    printed = output("datasets.md", "import minari")
    assert printed.split("\n")[0] == f"{id} 2 (1001, 16) (1000, 1)"


@pytest.mark.slow
def test_query_of_encoders_page_prints_errors(output):
    printed = output("encoders.md", "FROM encoder_errors")
    assert re.search(r"dae14 +0\.959 +0\.976 +0\.977", printed)


# All citations of the paper are equal.


def test_readme_and_report_cite_paper(demo_results):
    readme = " ".join((ROOT / "README.md").read_text().split())
    authors = (name.rpartition(" ") for name in paper.AUTHORS)
    assert f"{{{' and '.join(f'{family}, {given}' for given, _, family in authors)}}}" in readme
    for text in (paper.TITLE, paper.VENUE, paper.YEAR):
        assert f"= {{{text}}}," in readme
    found = Frames(demo_results)
    assert paper.CITATION in html.unescape(page.render(found, []))


def test_citation_file_cites_paper():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    (work,) = cited["references"]
    names = [f"{author['given-names']} {author['family-names']}" for author in work["authors"]]
    assert tuple(names) == paper.AUTHORS
    assert (work["title"], work["year"]) == (paper.TITLE, paper.YEAR)
    assert work["collection-title"] == paper.VENUE


def test_citation_file_names_newest_release():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    released = f"## {cited['version']} ({cited['date-released']})"
    assert f"\n{released}\n" in (ROOT / "CHANGELOG.md").read_text()
    assert cited["version"] == jbench.__version__
    year = cited["date-released"].year
    (software,) = re.findall(r"@software\{.*?\n\}", (ROOT / "README.md").read_text(), re.DOTALL)
    assert f"year    = {{{year}}}" in software
    assert f". {year}. " in croissant._CITE


def test_pages_for_language_models_exist():
    """Those that `docs/llms.txt` links to are pages of the site, of which some are generated."""
    text = (ROOT / "docs" / "llms.txt").read_text()
    linked = re.findall(r"\]\(([\w-]+)\.html\)", text)
    assert len(linked) > 10
    for name in {*linked} - {"commands"}:
        assert (ROOT / "docs" / f"{name}.md").is_file(), name


def test_first_lines_of_readme_set_everything_up():
    """What CI runs in a bare environment, by `docs/run_readme.py`."""
    spec = importlib.util.spec_from_file_location("run_readme", ROOT / "docs" / "run_readme.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    readme = (ROOT / "README.md").read_text()
    demo, by_hand = module.blocks(readme)
    assert demo.split()[:2] == ["make", "demo"]
    assert "-m venv" in by_hand.splitlines()[0]
    first = "\n".join(readme.splitlines()[:60])
    for needed in ("make demo", "make test", "python3-venv", "Apache 2.0", "Cite", "![", "GB"):
        assert needed in first
