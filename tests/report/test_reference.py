"""The runs that are shipped with jbench are intact, and learned what was published."""

from pathlib import Path

import numpy as np
import pytest

from jbench.names import kind_of
from jbench.report import sources
from jbench.report.analysis import reduction
from jbench.report.data.cells import of_kind
from jbench.report.data.returns import EVALUATION
from jbench.report.request import Request
from jbench.report.tables.reduction_items import effect_text
from jbench.settings.run import RunSettings
from jbench.store.shipped import shipped_results
from jbench.store.verify import verify


@pytest.fixture(scope="module")
def runs():
    results = shipped_results()
    records, problems = results.scan("run")
    assert problems == []
    return records


def test_they_are_intact(runs):
    found = verify(shipped_results(), 1)
    assert found.faults == []
    encoders = shipped_results().scan("encoder")[0]
    assert found.records == len(runs) + len(encoders)
    assert runs
    assert {record.status for record in runs} == {"finished"}


def test_no_directory_of_the_machine_that_made_them_is_named(runs):
    assert all("command" not in record.manifest.provenance for record in runs)


def last_twenty(runs, steps, **settings):
    """Returns the last 20 training returns of each of some seeds on face_direction."""
    wanted = {"task": "face_direction", "steps": steps, **settings}
    return [
        record.read("episodes")["episode_return"].to_numpy()[-20:]
        for record in runs
        if wanted.items() <= RunSettings(**record.settings).__dict__.items()
    ]


# Figure 9: by algorithm and control steps, the 10th and the 90th percentile of ten seeds.
BANDS = {
    ("td3", 100_000): (766.07, 971.14),
    ("sac", 100_000): (840.23, 951.93),
    ("ddpg", 300_000): (391.17, 859.33),
}


@pytest.mark.parametrize(
    ("algo", "steps", "engine", "precision", "seeds"),
    [
        ("td3", 100_000, "batched", "float32", 10),
        ("td3", 100_000, "batched", "bfloat16", 4),
        ("td3", 100_000, "sb3", "float32", 7),
        ("sac", 100_000, "batched", "float32", 6),
        ("sac", 100_000, "sb3", "float32", 4),
        ("ddpg", 300_000, "batched", "float32", 6),
    ],
)
def test_the_last_twenty_episodes_lie_in_the_published_band(
    runs, algo, steps, engine, precision, seeds
):
    wanted = {"algo": algo, "representation": "full", "engine": engine, "precision": precision}
    chosen = last_twenty(runs, steps, **wanted)
    assert len(chosen) == seeds
    low, high = BANDS[algo, steps]
    assert low <= np.median(chosen) <= high


def test_on_twelve_latents_the_published_seed_lies_among_ours(runs):
    chosen = last_twenty(runs, 300_000, algo="ddpg", representation="dae12")
    assert len(chosen) == 6
    # Figure 7, one seed: the mean of its points at 290,000 and 310,000 control steps.
    assert min(map(np.median, chosen)) < 554.0 < max(map(np.median, chosen))


@pytest.fixture(scope="module")
def reductions():
    cells = sources.own(shipped_results(), Request()).cells
    found = reduction.reductions(of_kind(cells, EVALUATION))
    assert found
    return found


def rows_of(page):
    """Returns the cells of all rows of tables of a page."""
    lines = (Path(__file__).parents[2] / page).read_text().splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if "|" in line]


def names_of(cell):
    """Returns the names of a representation: with its number of latents, and without."""
    return cell.representation, kind_of(cell.representation)


def test_readme_table_has_the_numbers_of_the_shipped_runs(reductions):
    rows = rows_of("README.md")
    for one in reductions:
        if (one.cell.algo, one.cell.task) == ("td3", "face_direction"):
            names = [f"(`{name}`)" for name in names_of(one.cell)]
            (row,) = [row for row in rows if row[0].endswith(tuple(names))]
            assert one.seeds == (10, 10)
            assert effect_text(one.finding("a")) in row


def test_answer_has_every_comparison_of_the_shipped_runs(reductions):
    rows = rows_of("docs/answer.md")
    text = " ".join((Path(__file__).parents[2] / "docs/answer.md").read_text().split())
    for one in reductions:
        effects = [effect_text(finding) for finding in one.findings]
        if (one.cell.algo, one.cell.task) == ("td3", "face_direction"):
            (row,) = [row for row in rows if row[0] in names_of(one.cell) and one.baseline in row]
            assert row[2:] == [effects[0], effects[2], effects[1]]
        else:
            assert all(effects[i] in text for i in (0, 2))


def of_episodes_alone(record, table):
    """Returns the final return of a seed and the squared standard error of its episodes."""
    rows = record.read(table).to_pandas()
    if table == "evaluations":
        rows = rows[rows["control_steps"] == rows["control_steps"].max()]
    else:
        rows = rows[-len(rows) // 4 :]
    returns = rows["episode_return"]
    return returns.mean(), returns.var() / len(returns)


@pytest.mark.parametrize(
    ("name", "representation"),
    [
        ("full", "full"),
        ("scaled", "scaled16"),
        ("planar", "planar12"),
        *((name, name) for name in ("forward12", "random12", "pca12", "dae12")),
    ],
)
def test_answer_says_how_much_of_the_spread_is_that_of_episodes(runs, name, representation):
    wanted = {"task": "face_direction", "algo": "td3", "representation": representation}
    wanted |= {"engine": "batched", "precision": "float32"}
    expected = [name]
    for table in ("evaluations", "episodes"):
        seeds = [
            of_episodes_alone(record, table)
            for record in runs
            if wanted.items() <= RunSettings(**record.settings).__dict__.items()
        ]
        assert len(seeds) == 10
        returns, errors = np.array(seeds).T
        expected += [f"{returns.std(ddof=1):.0f}", f"{np.sqrt(errors.mean()):.0f}"]
    assert expected in rows_of("docs/answer.md")


def test_page_on_submissions_counts_the_runs_whose_evaluation_can_be_repeated(runs):
    kept = [
        record
        for record in runs
        if record.manifest.summary.get("policy_evaluation") is not None
        and "policy.safetensors" in {file.name for file in record.manifest.files}
    ]
    assert len(kept) == 12
    page = (Path(__file__).parents[2] / "docs/submit.md").read_text()
    assert "most were saved without their policy and twelve are equal" in page
