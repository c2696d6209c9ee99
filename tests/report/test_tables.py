"""Tests of tables in Markdown, LaTeX and CSV, and of the wording of numbers."""

import csv
import io
import math
import re
import shutil
import subprocess

import numpy as np
import pandas as pd
import pytest

from jbench import numbers
from jbench.report.frames import Frames
from jbench.report.latex import to_latex
from jbench.report.table import Table, number, plain, to_csv, to_markdown, with_ends
from jbench.report.tables import tables
from jbench.report.texts import clean


def table(columns=None, **values):
    frame = pd.DataFrame(values)
    shown = tuple(columns or map(plain, frame))
    return Table("final_returns", "Final & last", "50% of_them.", frame, shown)


PLAIN = table(
    [plain("task"), with_ends("median", "median"), number("n", "n", str)],
    task=["a_b", "c|d"],
    median=[668.2, np.nan],
    median_low=[659.0, np.nan],
    median_high=[676.4, np.nan],
    n=[2, 1],
)


def test_markdown_aligns_numbers_and_keeps_cells_apart():
    lines = to_markdown(PLAIN).splitlines()
    assert lines[0] == "Final &amp; last. 50% of_them."
    assert lines[2:] == [
        "| task | median | n |",
        "| --- | ---: | ---: |",
        "| a_b | 668 [659, 676] | 2 |",
        r"| c\|d |  | 1 |",
    ]


def test_markdown_escapes_tags_and_newlines():
    (row,) = to_markdown(table(name=["<b>x</b>\n| *"])).splitlines()[4:]
    assert row == r"| &lt;b>x&lt;/b> \| \* |"


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("face_direction a__b", r"face_direction a\_\_b"),
        ("_mine_ ~~old~~", r"\_mine\_ \~\~old\~\~"),
        ("$a$ and $b$", "&#36;a&#36; and &#36;b&#36;"),
        ("[x](https://x.org) 6 [5, 7]", r"[x]\(https://x.org) 6 [5, 7]"),
    ],
)
def test_names_are_no_emphasis_formula_or_link_in_markdown(name, written):
    (row,) = to_markdown(table(name=[name])).splitlines()[4:]
    assert row == f"| {written} |"


def test_latex_table_uses_booktabs():
    text = to_latex(PLAIN)
    assert r"\caption{Final \& last. " in text
    assert r"\begin{tabular}{@{}r@{ }lr@{}}" in text
    for rule, count in ((r"\toprule", 1), (r"\midrule", 2), (r"\bottomrule", 1)):
        assert text.count(rule) == count
    assert (
        "\\multicolumn{2}{c}{median} & n \\\\\n\\midrule\n"
        "\\multicolumn{3}{@{}l}{\\emph{a\\_b}} \\\\\n668 & {[}659, 676] & 2 \\\\\n\\midrule\n"
        "\\multicolumn{3}{@{}l}{\\emph{c\\textbar{}d}} \\\\\n &  & 1 \\\\\n"
    ) in text


def latex_rows(made):
    """Returns the rows of a table in LaTeX, without its commands."""
    lines = to_latex(made).partition(r"\midrule")[2].partition(r"\bottomrule")[0].splitlines()
    return [re.split(r" & | \\\\", line)[:-1] for line in lines if "&" in line]


@pytest.mark.parametrize(
    ("values", "written"),
    [
        ([668.2, 12.0, 0.254], ["668.2", "12.0", "0.3"]),
        ([668.2, 12.4], ["668", "12"]),
        ([1000.0, 899.97], ["1,000.0", "899.9"]),  # below 900
        ([0.254, -0.031], ["0.254", "-0.031"]),
        ([12.0, 0.254], ["12.00", "0.25"]),
        ([5.2, -0.00001, np.nan], ["5.2", "0.0", ""]),
        ([7.26, np.inf], ["7.3", "infinite"]),
        ([1.234e-3, 1e-4], ["0.00123", "0.00010"]),
        ([2.5e-5, -1e-6], ["0.000025", "-0.000001"]),
    ],
)
def test_numbers_of_a_column_in_latex_have_as_many_decimals(values, written):
    made = table([plain("x"), number("median", "median")], x=[*"abc"[: len(values)]], median=values)
    assert [row[1] for row in latex_rows(made)] == written


def test_intervals_in_latex_have_the_decimals_of_their_numbers():
    columns = [plain("x"), number("difference", "by", numbers.signed, ("low", "high"))]
    made = table(columns, x=[*"ab"], by=[14.4, -6.84], low=[-3.14, np.nan], high=[32.0, np.nan])
    assert [row[1:] for row in latex_rows(made)] == [
        ["+14.4", "{[}-3.1, +32.0]"],
        ["-6.8", ""],
    ]


LONG_NAMES = ["dae12-whitened-epochs-800", "full, batch_size=64", "full"]


def test_long_names_in_latex_have_several_lines_in_what_is_left_of_the_line():
    text = to_latex(table(name=LONG_NAMES, n=[1, 2, 3]))
    assert text.startswith("% \\usepackage{booktabs,tabularx}\n\\begin{table}\n")
    assert "\n\\begin{tabularx}{\\linewidth}{@{}Xl@{}}\n" in text
    assert "\n\\end{tabularx}\n" in text
    assert "\\raggedright dae12-whitened-epochs-800 & 1 \\\\\n" in text
    assert "\\raggedright full, batch\\_\\allowbreak{}size=\\allowbreak{}64 & 2 \\\\\n" in text
    assert "\nfull & 3 \\\\\n" in text
    # Where it is last, \\ would end a line of it.
    assert text.count(r"\tabularnewline") == 0
    assert to_latex(table(n=[1, 2, 3], name=LONG_NAMES)).count(r"\tabularnewline") == 4


def test_long_names_in_latex_have_a_width_beside_more_columns_than_fit_a_line():
    # Of 90 characters, names need 14, and each column one more than its longest text.
    others = {f"c{i}": ["0123456789abcd"] * 3 for i in range(5)}
    assert r"{tabularx}" in to_latex(table(name=LONG_NAMES, **others))
    text = to_latex(table(name=LONG_NAMES, **others, n=[1, 2, 3]))
    assert text.startswith("% \\usepackage{booktabs}\n\\begin{table}\n")
    assert "\n\\begin{tabular}{@{}p{7em}llllll@{}}\n" in text


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="needs LaTeX")
@pytest.mark.parametrize("paper", ["onecolumn", "twocolumn"])
def test_latex_table_of_long_names_fits_the_columns_of_a_paper(tmp_path, paper):
    names = [*LONG_NAMES, "dae12-script, settings=figure8, normalize=none"]
    columns = [
        plain("task"),
        plain("algorithm"),
        plain("representation"),
        number("seeds", "seeds", str),
        with_ends("median", "median"),
    ]
    made = table(
        columns,
        task=["face_direction"] * 4,
        algorithm=["DDPG", "TD3", "random actions", "hand-written"],
        representation=names,
        seeds=[10] * 4,
        median=[1000.0, 899.6, 12.4, 0.3],
        median_low=[832.6] * 4,
        median_high=[990.5] * 4,
    )
    (tmp_path / "table.tex").write_text(to_latex(made))
    rules = "".join(rf"\newcommand\{name}rule{{\hline}}" for name in ("top", "mid", "bottom"))
    (tmp_path / "paper.tex").write_text(
        rf"\documentclass[{paper}]{{article}}\usepackage{{tabularx}}"
        rf"\IfFileExists{{booktabs.sty}}{{\usepackage{{booktabs}}}}{{{rules}}}"
        r"\begin{document}\input{table}\end{document}"
    )
    words = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper"]
    log = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert "Overfull" not in log


@pytest.mark.parametrize(
    ("name", "written"),
    [
        (r"\input{x}", r"\textbackslash{}input\{x\}"),
        ("$a^2_b$ #1 ~ %", r"\$a\textasciicircum{}2\_b\$ \#1 \textasciitilde{} \%"),
        ("\N{CHECK MARK} yes, \N{BALLOT X} no", r"$\surd$ yes, $\times$ no"),
        ("\u03b1 \u03c9 \u03c2 \u0394 a---b", r"$\alpha$ $\omega$ $\varsigma$ $\Delta$ a-{}-{}-b"),
        ("1\N{EN DASH}2 <>", r"1--2 \textless{}\textgreater{}"),
    ],
)
def test_latex_escapes_commands_in_names(name, written):
    assert rf"{written} & 1 \\" in to_latex(table(name=[name], n=[1]))


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("dae \N{ROCKET} fast", "dae U+1F680 fast"),
        ("\u6a21\u578bA", "U+6A21U+578BA"),
        ("Öl, caf\u00e9, cafe\u0301", r"\"{O}l, caf\'{e}, caf\'{e}"),
        ("Šø ő ą \u1ebf", r"\v{S}ø \H{o} U+0105 U+1EBF"),
        ("3 ± 1 µs → Γ…", r"3 $\pm$ 1 $\mu$s $\to$ $\Gamma$\ldots{}"),
    ],
)
def test_characters_that_pdflatex_lacks_are_replaced(name, written):
    text = to_latex(table(name=[name], n=[1]))
    assert rf"{written} & 1 \\" in text
    assert {c for c in text if not c.isascii()} <= {"ø"}


def test_control_characters_and_formulas_reach_no_file():
    hostile = "=cmd|' /C calc'!A0\x07\x1b[2J\u202ex\nnew"
    assert clean(hostile) == "=cmd|' /C calc'!A0\ufffd\ufffd[2J\ufffdx new"
    (row,) = csv.DictReader(io.StringIO(to_csv(pd.DataFrame({"name": [hostile], "x": [-1.5]}))))
    assert row["name"].startswith("'=cmd")
    assert row["x"] == "-1.5"  # a number is no formula
    assert "\x1b" not in to_markdown(table(name=[hostile])) + to_latex(table(name=[hostile]))


def test_csv_of_joined_frames_has_their_rows_alone():
    """pandas keeps the chunks of an empty frame, of which pyarrow would write its own memory."""
    empty = pd.DataFrame({"name": pd.Series([], dtype="str"), "x": pd.Series([], dtype=float)})
    full = pd.DataFrame({"name": ["a" * 30, "b"], "x": [1.5, 2.0]})
    for frames in ([empty, full], [full, empty], [full, empty, full], [empty, empty]):
        rows = [f'"{"a" * 30}",1.5\n"b",2\n' for frame in frames if len(frame)]
        assert to_csv(pd.concat(frames, ignore_index=True)) == "".join(["name,x\n", *rows])


def test_columns_without_text_are_left_out():
    shown = table([plain("a"), plain("b")], a=["x"], b=[None]).texts()
    assert list(shown) == ["a"]


@pytest.mark.parametrize(("seeds", "shown"), [(2, set()), (3, {"s", "detectable"})])
def test_variability_is_that_of_three_seeds_or_more(fabric, seeds, shown):
    for seed in range(seeds):
        fabric.run(np.full(40, 500.0), seed, evaluated={40_000: 800.0 + seed})
    table = next(one for one in tables(Frames(fabric.results)) if one.name == "final_returns")
    assert {"s", "detectable"} & {*table.texts()} == shown
    assert ("Detectable: " in table.explained(table.shown[0])) == bool(shown)


def test_policies_stand_beside_agents_and_labels_apart_from_algorithms_of_the_paper(fabric):
    fabric.flat([500] * 3, evaluated={40_000: 899.6})
    fabric.flat([500] * 3, algo="TD3", engine="external")
    found = Frames(fabric.results)
    texts = next(one for one in tables(found) if one.name == "final_returns").texts()
    assert texts["algorithm"].tolist() == ["TD3", "random actions", "hand-written"]
    # 899.6 must not read 900.
    assert texts["median"].tolist()[0] == "899.6 [899.6, 899.6]"
    # A policy is one agent: the mean of its episodes.
    assert texts["median"].tolist()[1:] == texts["IQM"].tolist()[1:]
    assert texts["median"].tolist()[1].startswith("246 [")
    assert texts["seeds"].tolist() == ["3", "", ""]
    assert set(found.configurations["algo"]) == {"TD3", "TD3 (label)"}


@pytest.mark.parametrize(
    ("row", "printed"),
    [
        ((668.4, 640.2, 690.6), "668 [640, 691]"),
        ((668.4, math.nan, math.nan), "668"),
        ((1234567.0, 10.0, math.inf), "1,234,567 [10, infinite]"),
        ((math.nan, math.nan, math.nan), ""),
    ],
)
def test_number_is_written_with_interval(row, printed):
    values = dict(zip(("x", "x_low", "x_high"), row, strict=True))
    assert with_ends("x", "x").text(values) == printed


@pytest.mark.parametrize(
    ("difference", "ends", "written"),
    [
        (-0.058, (-51.2, 60.9), ("0", "[-51, +61]")),
        (4.2, (-3.1, 12.0), ("+4", "[-3, +12]")),
        (-6.84, (-9.9, -0.2), ("-6.8", "[-9.9, -0.2]")),
        (0.3, (0.1, 0.52), ("+0.30", "[+0.10, +0.52]")),
        # The interval of a decided difference does not contain 0; one that begins there does.
        (25.4, (0.002, 51.0), ("+25", "[+0, +51]")),
        (25.4, (0.0, 51.0), ("+25", "[0, +51]")),
        (25.4, (-0.4, 51.0), ("+25", "[-0, +51]")),
        (25.4, (-math.inf, math.inf), ("+25", "[-infinite, +infinite]")),
    ],
)
def test_a_difference_and_its_interval_have_as_many_decimals_everywhere(difference, ends, written):
    assert numbers.texts(numbers.signed, difference, ends) == written
    if not np.isfinite(ends).all():
        return

    column = number("difference", "by", numbers.signed, ("low", "high"))
    low, high = ends
    made = table([plain("x"), column], x=["a"], by=[difference], low=[low], high=[high])
    both = " ".join(written)
    assert made.texts()["difference"].tolist() == [both]
    assert f"| a | {both} |" in to_markdown(made)
    assert latex_rows(made) == [["a", written[0], written[1].replace("[", "{[}")]]


def test_a_return_and_its_error_have_as_many_decimals():
    assert numbers.with_error(668.2, 3.14) == "668 ± 3"
    assert numbers.with_error(0.52, 0.031) == "0.52 ± 0.03"
    assert numbers.with_error(668.2, math.nan) == "668"


def test_differences_have_sign_and_no_minus_zero():
    assert [numbers.signed(x) for x in (12.4, -12.4, 1e-9, -1e-9)] == ["+12", "-12", "0", "0"]
    assert numbers.whole(-1e-9) == "0"
    assert numbers.ratio(-0.001) == "0.00"


def test_small_numbers_have_two_digits():
    # Returns of other environments may be from 0 to 1.
    assert [numbers.signed(x) for x in (0.234, -9.94, 9.96)] == ["+0.23", "-9.9", "+10"]
    assert [numbers.whole(x) for x in (0.234, -9.94, 9.96)] == ["0.23", "-9.9", "10"]
    large = 3.14159e20
    assert [numbers.whole(large), numbers.signed(-large)] == ["3.14e+20", "-3.14e+20"]
    assert [numbers.fixed(large, 0), numbers.fixed(large, 0, "+")] == ["3.14e+20", "+3.14e+20"]
    assert numbers.whole(1e12 - 1) == "999,999,999,999"


@pytest.mark.parametrize(
    ("steps", "printed"),
    [(500, "500"), (22_500, "22.5k"), (300_000, "300k"), (999_900, "1M"), (2_154_321, "2.15M")],
)
def test_steps_are_abbreviated(steps, printed):
    assert numbers.steps(steps) == printed
    values = {"x": steps, "x_low": steps, "x_high": math.inf}
    assert with_ends("x", "x", numbers.steps).text(values) == f"{printed} [{printed}, later]"


def test_numbers_that_are_not_finite_are_words():
    values = (np.inf, -np.inf, np.nan)
    assert [*map(numbers.signed, values)] == ["+infinite", "-infinite", "+nan"]
    assert [*map(numbers.whole, values)] == ["infinite", "-infinite", "nan"]
