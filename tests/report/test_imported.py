"""Tests of reports on imported learning curves, alone and together with runs."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest

import jbench
from jbench.cli import main
from jbench.report.data.source_names import IMPORTED
from jbench.report.figures import charts
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.store import Results
from tests.report.conftest import import_curves

RETURNS = {
    "slow": {seed: 400.0 + 10 * seed for seed in range(6)},
    "fast": {seed: 800.0 + 10 * seed for seed in range(6)},
}
"""Return of every episode, by label and seed."""


def add(results, algo, returns, *more, episodes=8):
    curves = {seed: [value] * episodes for seed, value in returns.items()}
    import_curves(results, algo, curves, *more)


@pytest.fixture
def demo(demo_results, tmp_path):
    return shutil.copytree(demo_results.path, tmp_path / "demo")


@pytest.fixture(scope="module")
def two_imported(tmp_path_factory):
    path = tmp_path_factory.mktemp("two")
    for algo, returns in RETURNS.items():
        add(path / "imported", algo, returns)
    return path / "imported"


@pytest.fixture
def imported(two_imported, tmp_path):
    return shutil.copytree(two_imported, tmp_path / "imported")


def test_report_of_imports_alone_has_statistics(imported):
    found = Frames(Results(imported))
    rows = found.configurations.set_index("algo")
    assert set(rows["source"]) == {IMPORTED}
    for algo, returns in RETURNS.items():
        assert rows.loc[algo, "median"] == pytest.approx(np.median(list(returns.values())))
        assert rows.loc[algo, "median_low"] <= rows.loc[algo, "median"]
    assert set(rows["seeds"]) == {6}
    # Points of imported files need not be episodes, so nothing is known of single agents.
    assert rows["s"].isna().all()
    assert found.pairs.empty  # imported curves are not ranked


def test_imports_are_reported_if_no_run_was_begun_since_date(demo):
    add(demo, "fast", {0: 800.0})
    found = Frames(Results(demo), Request(since="2100-01-01"))
    assert set(found.configurations["source"]) == {IMPORTED}
    assert any("begun before 2100-01-01 are left out" in note for note in found.notes)


def test_notes_count_only_imports_that_pass_filters(imported):
    notes = Frames(Results(imported), Request(algo=("fast",))).notes
    assert [note for note in notes if "curves (csv)" in note] == [
        "6 imported curves (csv) are not verified: jbench has not run the agents. Imported curves "
        "are in no claim."
    ]


def test_training_and_evaluation_of_label_are_one_configuration(tmp_path):
    path = tmp_path / "imported"
    add(path, "fast", RETURNS["fast"])
    add(path, "fast", {0: 900, 1: 910}, "--returns", "evaluation")
    rows = Frames(Results(path)).configurations.set_index("returns")
    assert rows["median"].to_dict() == {"training": 825, "evaluation": 905}
    assert "4 of 6 seeds have no evaluation" in rows.loc["evaluation", "note"]
    assert rows["configuration"].nunique() == 1


def test_longest_import_of_seed_is_used(tmp_path):
    path = tmp_path / "imported"
    add(path, "fast", RETURNS["fast"])
    add(path, "fast", {0: 500}, episodes=12)
    found = Frames(Results(path))
    assert sorted(found.seeds["final"]) == [500, 810, 820, 830, 840, 850]
    assert any(note.startswith("1 imported curve is not used") for note in found.notes)


def test_seeds_with_points_at_different_control_steps_are_noted(tmp_path):
    path, file = tmp_path / "imported", tmp_path / "curves.csv"
    file.write_text("seed,steps,return\n0,1000,10\n0,2000,20\n1,1300,30\n1,2200,40\n")
    typed = ("--from", "csv", "--task", "face_direction", "--algo", "td3")
    assert main(["import", *typed, "--results", str(path), str(file)]) == 0
    (row,) = Frames(Results(path)).configurations.to_dict("records")
    assert "its seeds were logged at different control steps" in row["note"]
    assert "its curve of training returns ends at 2,000 control steps" in row["note"]


def test_imports_change_no_number_or_claim_of_runs(demo, imported):
    request = Request(claims=True)
    alone = Frames(Results(demo), request)
    assert main(["merge", str(imported), "--results", str(demo)]) == 0
    add(demo, "td3", {0: 999.0, 1: 999.0}, "--representation", "dae12")
    both = Frames(Results(demo), request)
    own = both.configurations[both.configurations["source"] == "own"].reset_index(drop=True)
    pd.testing.assert_frame_equal(own, alone.configurations, check_dtype=False)
    for name in ("claims", "verdicts", "pairs"):
        one, other = getattr(both, name), getattr(alone, name)
        pd.testing.assert_frame_equal(one, other, check_dtype=False)


def test_baseline_is_drawn_like_published_curves(imported):
    found = Frames(Results(imported), Request(baseline="slow"))
    assert set(found.curves["algo"]) == {"fast"}
    baseline = found.published[found.published["source"] == IMPORTED]
    assert set(baseline["algo"]) == {"slow"}
    assert set(baseline["median"]) == {425}
    assert set(found.configurations["algo"]) == {"fast", "slow"}
    (curves,) = (chart for chart in charts(found) if chart.name == "algorithms")
    assert [*curves.legend] == ["imported: fast", "imported"]


def test_paper_is_cited_only_for_curves_of_its_own(imported, undrawn):
    typed = ["--baseline", "slow", "--format", "svg", "--results", str(imported)]
    pages = {}
    for published in ("yes", "no"):
        assert main(["report", "--published", published, *typed]) == 0
        pages[published] = (imported / "report" / "index.html").read_text()

    assert "Published curves:" in pages["yes"]
    assert "Published curves:" not in pages["no"]


@pytest.mark.parametrize(
    ("typed", "says"),
    [
        (["--baseline", "sac"], "type one of fast, slow"),
        (["--baseline", "slow", "--algo", "slow"], "no other curves to draw it beside"),
        (["--baseline", "slow", "--compare", "a=1", "b=2"], "exclude each other"),
        (["--algo", "ddpg"], "There are no runs"),
    ],
)
def test_requests_without_curves_are_refused(typed, says, imported, capsys):
    assert main(["report", "--results", str(imported), *typed]) == 2
    assert says in capsys.readouterr().err


def test_imports_that_are_damaged_or_lack_their_length_are_skipped_and_reported(imported):
    part = min(imported.rglob("import_points-*.parquet"))
    part.write_bytes(b"cut")
    manifest = max(imported.rglob("manifest.json"))
    manifest.write_text(json.dumps({**json.loads(manifest.read_text()), "summary": {}}))
    found = Frames(Results(imported))
    assert len(found.problems) == 2
    for says in (str(part), "lacks a label, a seed, its kind of return or its length"):
        assert sum(says in problem for problem in found.problems) == 1
    assert found.configurations["seeds"].tolist() == [5, 5]


def test_curves_of_opened_results_include_imports(imported):
    curves = jbench.open(imported).curves(algo="fast", returns="training")
    assert set(curves["source"]) == {IMPORTED}
    assert set(curves["q50"]) == {825}
