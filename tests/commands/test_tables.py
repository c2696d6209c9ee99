"""Tests of tables on narrow and wide terminals."""

import pytest

from jbench.commands import output

RUN = "face_direction/td3/planar12/s00-3d410709"


@pytest.fixture
def printed(monkeypatch, capsys):
    """Returns a function that prints a table at a width and returns its lines."""

    def lines(width, header, *rows):
        monkeypatch.setenv("COLUMNS", str(width))
        output.table("a title", header, rows)
        return capsys.readouterr().out.splitlines()

    return lines


def test_width_of_a_pipe_is_that_of_columns(monkeypatch, capsys):
    rows = [("word " * 20, "word " * 20)]
    for columns, least, most in ((None, 150, 200), ("60", 40, 60)):
        if columns is not None:
            monkeypatch.setenv("COLUMNS", columns)
        else:
            monkeypatch.delenv("COLUMNS", raising=False)
        output.table("a title", ["one", "two"], rows)
        longest = max(map(len, capsys.readouterr().out.splitlines()))
        assert least <= longest <= most


def test_cells_are_wrapped_between_words_if_words_fit(printed):
    lines = printed(55, ["run", "error"], [RUN, "no room left"])
    (first,) = [i for i, line in enumerate(lines) if RUN in line]
    assert lines[first].split() == [RUN, "no", "room"]
    assert lines[first + 1].split() == ["left"]
    assert all(len(line) <= 55 for line in lines)


def test_row_is_one_line_if_words_do_not_fit(printed):
    lines = printed(60, ["run", "status", "created"], [RUN, "finished", "2026-11-24 10:44"])
    (row,) = [line.split() for line in lines if RUN in line]
    assert row == [RUN, "finished", "2026-11-24", "10:44"]


def test_row_much_wider_than_terminal_has_a_line_for_each_cell(printed):
    names = [f"column{i}" for i in range(20)]
    lines = printed(80, names, [RUN] * 20, ["other"] * 20)
    assert [line.split() for line in lines if RUN in line] == [[name, RUN] for name in names]
    assert sum("other" in line for line in lines) == 20
    assert all(len(line) <= 80 for line in lines)
