"""Tests of singular and plural in messages."""

from pathlib import Path

from jbench.wording import are, counted, with_results


def test_nouns_and_verbs_agree_with_number():
    assert counted(0, "run") == "0 runs"
    assert counted(1, "run") == "1 run"
    assert counted(1200, "run") == "1,200 runs"
    assert counted(1, "process", "processes") == "1 process"
    assert counted(2, "process", "processes") == "2 processes"
    assert [are(number) for number in (0, 1, 2)] == ["are", "is", "are"]


def test_suggested_command_has_results_unless_they_are_the_default():
    assert with_results("jbench report", Path("results")) == "jbench report"
    assert with_results("jbench report", Path("a")) == "jbench report --results a"
    assert with_results("jbench runs", Path("a b")) == "jbench runs --results 'a b'"
