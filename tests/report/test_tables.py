"""Tests of tables in Markdown, LaTeX and CSV, and of the wording of their values."""

import csv
import io
import math

import pandas as pd
import pytest

from jbench.report import formatting
from jbench.report.analysis.scores import Statistic
from jbench.report.analysis.statistics import Estimate
from jbench.report.document import TableItem, Value
from jbench.report.tables import files, values


def item(**columns):
    return TableItem("final_returns", "Final & last", "50% of_them.", pd.DataFrame(columns))


PLAIN = item(
    task=["a_b", "c|d"],
    median=[Value("668 [659, 676], n = 2", 668.0), Value("9", 9.0, best=True)],
    rest=[1.25, None],
)


def test_markdown_table_has_best_in_bold():
    lines = files.to_markdown(PLAIN).splitlines()
    assert lines[0] == "Final &amp; last. 50% of_them."
    assert lines[2:] == [
        "| task | median | rest |",
        "| --- | ---: | ---: |",
        "| a_b | 668 [659, 676], n = 2 | 1.25 |",
        r"| c\|d | **9** |  |",
    ]


def test_markdown_escapes_tags_links_and_newlines():
    (row,) = files.to_markdown(item(name=["<b>x</b>\n| [a](http://b) *"])).splitlines()[4:]
    assert row == r"| \<b>x\</b> \| [a]\(http://b) \* |"


def test_latex_table_uses_booktabs_with_best_in_bold():
    text = files.to_latex(PLAIN)
    assert r"\caption{Final \& last. 50\% of\_them.}" in text
    assert r"\begin{tabular}{lrr}" in text
    for rule in (r"\toprule", r"\midrule", r"\bottomrule"):
        assert text.count(rule) == 1
    assert r"a\_b & 668 [659, 676], n = 2 & 1.25 \\" in text
    assert r"c\textbar{}d & \textbf{9} &  \\" in text


@pytest.mark.parametrize(
    ("name", "written"),
    [
        (r"\input{x}", r"\textbackslash{}input\{x\}"),
        ("$a^2_b$ #1 ~ %", r"\$a\textasciicircum{}2\_b\$ \#1 \textasciitilde{} \%"),
        ("\N{CHECK MARK} yes, \N{BALLOT X} no", r"$\surd$ yes, $\times$ no"),
        ("1\N{EN DASH}2 <>", r"1--2 \textless{}\textgreater{}"),
    ],
)
def test_latex_escapes_commands_in_names(name, written):
    assert rf"{written} & 1 \\" in files.to_latex(item(name=[name], n=[1]))


def test_latex_protects_bracket_at_start_of_row():
    assert r"{}[1, 2] & 3 \\" in files.to_latex(item(band=["[1, 2]"], n=[3]))


def test_csv_has_numbers_instead_of_formatted_text():
    ends = {"": 668.25, "low": 659.5, "high": None, "n": 2}
    table = item(
        task=["a_b", "c|d"],
        median=[Value("668 [660, not reached], n = 2", 668.25, numbers=ends), None],
        steps=[Value("300k", 300_000), Value("1M", 1_000_000)],
        remark=[Value("text", "sorted"), Value("more", "by")],
        rest=[1.25, None],
    )
    (first, second) = csv.DictReader(io.StringIO(files.to_csv(table)))
    assert first == {
        **{"task": "a_b", "median": "668.25", "median low": "659.5", "median high": ""},
        **{"median n": "2", "steps": "300000", "remark": "text", "rest": "1.25"},
    }
    assert set(second.values()) == {"c|d", "", "1000000", "more"}


class TestWording:
    @pytest.mark.parametrize(
        ("found", "printed"),
        [
            (Estimate(668.4, 640.2, 690.6, 1.0), "668 [640, 691]"),
            (Estimate(668.4, math.nan, math.nan, math.nan), "668"),
            (Estimate(1234567.0, 10.0, math.inf, math.nan), "1,234,567 [10, no upper bound]"),
            (Estimate(math.inf, 10.0, math.inf, math.nan), "infinite [10, no upper bound]"),
        ],
    )
    def test_estimate_is_written_with_interval(self, found, printed):
        assert values.estimate(found).text == printed

    def test_infinite_limits_are_worded_by_kind_of_value(self):
        end = Estimate(math.inf, math.inf, math.inf, math.nan)
        late = Estimate(123_456.0, 9000.0, math.inf, math.nan)
        assert values.estimate(end, formatting.steps).text == "not reached"
        assert values.estimate(late, formatting.steps).text == "123k [9k, not reached]"
        wide = Estimate(0.87, 0.0, math.inf, math.nan)
        assert values.estimate(wide, formatting.ratio).text == "0.87 [0.00, no upper bound]"
        assert values.estimate(wide, formatting.ratio).data == {
            "": 0.87,
            "low": 0.0,
            "high": math.inf,
        }

    def test_missing_estimate_has_no_text(self):
        assert values.estimate(Estimate(math.nan, math.nan, math.nan, math.nan)) is None
        assert values.reached(None) is None

    def test_differences_have_sign_and_no_minus_zero(self):
        assert [formatting.signed(x) for x in (12.4, -12.4, 0.2, -0.2)] == ["+12", "-12", "0", "0"]
        assert formatting.whole(-0.3) == "0"

    @pytest.mark.parametrize(
        ("steps", "printed"),
        [(500, "500"), (22_500, "22.5k"), (300_000, "300k"), (999_900, "1M"), (2_154_321, "2.15M")],
    )
    def test_steps_are_abbreviated(self, steps, printed):
        assert formatting.steps(steps) == printed

    def test_spread_has_seeds_and_needs_two_seeds(self, fabric):
        for seed in range(11):
            fabric.run([10.0 * seed], seed)
        fabric.run([7.0], algo="sac")
        fabric.run([math.nan], algo="ddpg")
        nothing, one, several = map(values.spread, fabric.cells()[0])
        assert several.text == "50 [10, 90], n = 11"
        assert several.data == {"": 50, "10th percentile": 10, "90th percentile": 90, "n": 11}
        assert one.text == "7, n = 1"
        assert nothing is None

    def test_number_of_seeds_that_reach_threshold(self):
        nothing = Estimate(math.inf, math.inf, math.inf, math.nan)
        one = Statistic("steps_to_solved", "median", nothing, 10, 3, 900.0, 40)
        assert values.reached(one).text == "3 of 10"
