"""Tests of durations and commands in messages; `tests/words.py` checks the words of all texts."""

from pathlib import Path

import pytest

from jbench.wording import directory_name, duration, with_results


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.4, "0 s"),
        (59.4, "59 s"),
        (59.7, "1 min 0 s"),
        (119.8, "2 min 0 s"),
        (725, "12 min 5 s"),
        (3599.9, "1 h 0 min"),
        (86399.6, "1 d 0 h"),
        (273700, "3 d 4 h"),
    ],
)
def test_durations_are_rounded_before_they_are_divided_into_units(seconds, text):
    assert duration(seconds) == text


def test_directory_has_its_name_wherever_it_is_named_from(tmp_path, monkeypatch):
    place = tmp_path / "my results"
    (place / "runs").mkdir(parents=True)
    monkeypatch.chdir(place)
    names = [directory_name(Path(path)) for path in (".", "runs/..", place, "runs", "/")]
    assert names == ["my results", "my results", "my results", "runs", "results"]


def test_suggested_command_has_results_unless_they_are_the_default():
    assert with_results("jbench report", Path("results")) == "jbench report"
    assert with_results("jbench report", Path("a")) == "jbench report --results a"
    assert with_results("jbench runs", Path("a b")) == "jbench runs --results 'a b'"
