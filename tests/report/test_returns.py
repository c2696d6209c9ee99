"""Tests of evaluation and training returns: cells, curves, statistics, claims and files of both."""

import numpy as np
import pytest

from jbench.report import contents
from jbench.report.analysis.comparisons import within
from jbench.report.analysis.examine import examine
from jbench.report.analysis.scores import scores_of, summaries
from jbench.report.data.returns import EVALUATION, TRAINING
from jbench.report.document import TableItem
from jbench.report.figures import heat_map, learning_curves
from jbench.report.report import gather, write_report
from jbench.report.request import Request
from jbench.report.tables import files

pytestmark = pytest.mark.usefixtures("undrawn")

FLAT = np.full(40, 500.0)
RISING = {10_000: 100.0, 20_000: 300.0, 30_000: 600.0, 40_000: 950.0}


def evaluated(last):
    """Returns the mean returns of four evaluations, of which the last is `last`."""
    return {**RISING, 40_000: last}


def table(data, name):
    (found,) = [t for t in contents.tables(contents.document(data)) if t.name == name]
    return found


class TestCells:
    def test_point_is_evaluation_at_its_control_steps(self, fabric):
        for seed in range(3):
            fabric.run(FLAT, seed, evaluated=evaluated(900.0 + 10 * seed))
        (cell,), _ = fabric.cells(EVALUATION)
        assert cell.control_steps.tolist() == [[*RISING]] * 3
        # Each evaluation has two episodes, 5 above and 5 below its mean.
        assert cell.returns[:, 0].tolist() == [100, 100, 100]
        assert scores_of(cell).final.tolist() == [900, 910, 920]
        assert scores_of(cell).area[0] == (100 + 300 + 600 + 900) / 4
        (curve,) = (item.curve for item in fabric.learned(kind=EVALUATION))
        assert curve.control_steps.tolist() == [*RISING]
        assert curve.quantile(50).tolist() == [100, 300, 600, 910]
        (training,), _ = fabric.cells(TRAINING)
        assert scores_of(training).final.tolist() == [500] * 3
        assert training.key == cell.key

    def test_seeds_are_aligned_by_control_steps(self, fabric):
        fabric.run(FLAT, 0, evaluated={10_000: 1.0, 30_000: 3.0})
        fabric.run(FLAT, 1, evaluated={20_000: 20.0, 30_000: 30.0})
        fabric.run(FLAT, 2)
        (cell,), _ = fabric.cells(EVALUATION)
        assert cell.seeds.tolist() == [0, 1]
        np.testing.assert_equal(cell.returns, [[1, np.nan, 3], [np.nan, 20, 30]])
        assert scores_of(cell).final.tolist() == [3, 30]
        assert scores_of(cell, 25_000).final.tolist() == [1, 20]
        assert cell.notes == (
            "1 of 3 seeds have no evaluation",
            "seeds were evaluated after different numbers of control steps",
        )

    def test_nan_evaluation_is_ignored_and_noted(self, fabric):
        for seed, last in enumerate((np.nan, 910.0)):
            fabric.run(FLAT, seed, evaluated=evaluated(last))
        (cell,), _ = fabric.cells(EVALUATION)
        assert scores_of(cell).final.tolist() == [910]
        assert cell.notes == ("1 evaluation of seed 0 is not finite and left out",)


class TestStatistics:
    def test_evaluations_have_same_statistics_as_training(self, fabric, published):
        for seed in range(3):
            fabric.run(FLAT, seed, evaluated=evaluated(900.0 + 10 * seed))
        (summary,) = summaries(fabric.learned(kind=EVALUATION), published)
        one = summary.get("final_return", "median")
        assert (one.estimate.value, one.estimate.low, one.estimate.high) == (910, 900, 920)
        assert summary.get("steps_to_solved", "median").estimate.value == 40_000
        # Published returns are training returns and give no threshold for evaluations.
        assert summary.get("steps_to_half_best", "median") is None

    def test_cells_are_compared_at_last_common_step(self, fabric):
        for seed in range(3):
            fabric.run(FLAT, seed, evaluated=evaluated(950.0))
            short = {10_000: 150.0, 20_000: 350.0}
            fabric.run(FLAT[:20], seed, representation="dae12", evaluated=short)
        (one,) = within(fabric.cells(EVALUATION)[0])
        assert (one.control_steps, one.cut) == (20_000, 20_000)
        assert one.difference.value == -50 if one.ours.representation == "full" else 50

    def test_training_is_compared_over_last_quarter_before_common_step(self, fabric):
        ramp = np.arange(40.0)
        for seed in range(3):
            fabric.run(ramp, seed)
            fabric.run(np.zeros(20), seed, representation="dae12")
        (one,) = within(fabric.cells()[0])
        assert one.control_steps == 20_000
        # The last quarter of the first 20 episodes is 15 to 19, with mean 17.
        assert abs(one.difference.value) == 17


class TestClaims:
    def test_verdicts_that_differ_between_returns_are_reported(self, fabric):
        for seed in range(6):
            fabric.run(FLAT + seed, seed, evaluated=evaluated(950.0 + seed))
        data = gather(fabric.results, Request(claims=True, formats=("svg",)))
        ours = {f.returns: f for f in data.findings if (f.claim, f.source) == ("g", "ours")}
        assert {kind: f.verdict for kind, f in ours.items()} == {
            "evaluation": "supported",
            "training": "contradicted",
        }
        printed = contents.document(data).summary
        (solved,) = [s for s in printed if "disagree on whether 900 is reached" in s]
        assert "face_direction TD3 full (evaluation 952" in solved
        (claim,) = [s for s in printed if "disagree on (g)" in s]
        assert "supported by evaluation returns, contradicted by training returns" in claim
        frame = table(data, "verdicts").frame
        (solved,) = [row for row in frame.to_dict("records") if row["claim"].startswith("(g)")]
        assert solved["ours, evaluation"].text == "\N{CHECK MARK} supported"
        assert solved["ours, training"].text == "\N{BALLOT X} contradicted"

    def test_no_disagreement_is_reported_if_verdicts_agree(self, fabric):
        for seed in range(6):
            fabric.run(FLAT + seed, seed, evaluated=evaluated(400.0 + seed))
        printed = contents.document(gather(fabric.results, Request(claims=True))).summary
        assert not [sentence for sentence in printed if "disagree" in sentence]

    def test_seeds_needed_name_power_or_six_seed_rule(self, fabric):
        for seed, final in enumerate((700.0, 800.0, 1000.0)):
            fabric.run(np.full(40, final), seed)
            fabric.run(FLAT, seed, algo="sac", evaluated=evaluated(400.0 + seed))
        request = Request(claims=True)
        data = gather(fabric.results, request)
        needed = {f.compared.split()[1]: f.seeds_needed for f in examine(fabric.cells()[0])}
        # The median of TD3 is 100 below 900 with a large spread; all seeds of SAC are equal.
        assert needed["td3"].rule == "80% power"
        assert needed["td3"].seeds > 6
        rows = files.to_markdown(table(data, "claims"))
        assert f"{needed['td3'].seeds} (80% power)" in rows
        # Evaluation returns of 400 to 402 are so far below 900 that power needs fewer than six.
        assert "6 (six-seed rule)" in rows


class TestReport:
    @pytest.fixture
    def both(self, fabric):
        for seed in range(3):
            fabric.run(FLAT, seed, algo="ddpg", evaluated=evaluated(900.0))
            more = {"representation": "dae12", "evaluated": evaluated(800.0)}
            fabric.run(FLAT, seed, algo="ddpg", **more)
        fabric.run(FLAT, 0, algo="sac")
        return fabric

    def test_report_has_both_returns_and_evaluations_first(self, both, out):
        report = write_report(both.results, out, Request(formats=("svg",)))
        names = {path.name for path in report.files}
        assert {"evaluations.svg", "figure9.svg", "evaluations-face_direction-ddpg.svg"} <= names
        assert {"final_returns.csv", "final_returns-training.csv"} <= names
        assert set(report.data.aggregate["returns"]) == {"evaluation", "training"}
        ddpg = report.data.table[report.data.table["algo"] == "ddpg"]
        assert ddpg["evaluation_return_median"].tolist() == [900, 800]
        assert ddpg["training_return_median"].tolist() == [500, 500]
        (note,) = [note for note in report.data.notes if "have no evaluations" in note]
        assert "face_direction sac full" in note
        assert "evaluation return of the deterministic policy" in (out / "index.html").read_text()

    def test_published_curves_are_drawn_only_with_training_returns(self, both, published):
        for kind, dashed in ((EVALUATION, 0), (TRAINING, 2)):
            learned = both.learned(window=4, kind=kind)
            figure = learning_curves.grid_figure(learned, published, Request(window=4))
            panel = figure.panels[0]
            assert panel.y.label == kind.axis
            assert len([x for x in panel.series if x.style.dash == "--"]) == dashed
            assert kind.long in figure.caption
            assert ("Published" in figure.caption) == bool(dashed)

    def test_every_caption_names_its_return(self, both):
        document = contents.document(gather(both.results, Request(window=4)))
        for section in document.sections:
            if section.title.startswith(("Final", "Learning", "Comparisons")):
                for item in section.items:
                    caption = item.caption if isinstance(item, TableItem) else item.figure.caption
                    assert ("evaluation" in caption) != ("training" in item.title), item.name


class TestLengths:
    def test_only_cells_of_equal_steps_are_colored(self, fabric):
        for algo, episodes in (("ddpg", 120), ("sac", 40), ("td3", 40)):
            fabric.run(np.full(episodes, 500.0), algo=algo)
        cells = fabric.cells()[0]
        drawn = heat_map.matrix_figure(cells).panels[0].heat_map
        assert np.isnan(drawn.values[:, 0]).tolist() == [True, False, False]
        assert [cell.framed for cell in drawn.texts] == [True, False, False]
        assert drawn.texts[0].text == "500\n120k steps\nn = 1"
        assert "Only cells of 40k control steps are colored" in heat_map.caption(cells)

    def test_tables_have_control_steps(self, fabric):
        fabric.run(FLAT, algo="sac")
        fabric.run(np.full(30, 500.0), algo="td3", status="unfinished", steps=99_000)
        fabric.run(np.full(300, 500.0), 1, algo="td3")
        data = gather(fabric.results, Request())
        for name in ("final_returns", "statistics"):
            column = table(data, name).frame["control steps"]
            assert [value.text for value in column] == ["40k", "30k\N{EN DASH}300k"]
            assert column[1].data == {"least": 30_000, "most": 300_000}
