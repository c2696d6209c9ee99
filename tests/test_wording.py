"""Tests of singular and plural in messages."""

from jbench.wording import are, counted


def test_nouns_and_verbs_agree_with_number():
    assert counted(0, "run") == "0 runs"
    assert counted(1, "run") == "1 run"
    assert counted(1200, "run") == "1,200 runs"
    assert counted(1, "process", "processes") == "1 process"
    assert counted(2, "process", "processes") == "2 processes"
    assert [are(number) for number in (0, 1, 2)] == ["are", "is", "are"]
