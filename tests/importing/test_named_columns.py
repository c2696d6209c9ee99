"""Tests of the numbers and labels of curves in files whose columns or keys have usual names."""

import pytest

from jbench.importing.dialects import read_curves


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("c.csv", "method,task,seed,million_steps,return\nA,walk,0,0.000249,5\nA,walk,0,0.3,6\n"),
        (
            "c.json",
            '{"walk": {"A": {"seed_0": {"million_steps": [0.000249, 0.3], "return": [5, 6]}}}}',
        ),
    ],
    ids=["csv", "json"],
)
def test_millions_of_control_steps_become_whole_numbers(name, text, tmp_path):
    path = tmp_path / name
    path.write_text(text)
    assert 0.000249 * 1e6 < 249  # by rounding
    assert read_curves(path).points["steps"].tolist() == [249, 300_000]


def test_spaces_after_commas_are_no_part_of_a_label(tmp_path):
    path = tmp_path / "c.csv"
    path.write_text(
        "method, task, seed, steps, return\nA, walk, 0, 1000, 5\n A ,walk , 0, 2000, 6\n"
    )
    points = read_curves(path).points
    labels = points[["method", "task", "seed"]].drop_duplicates()
    assert labels.to_numpy().tolist() == [["A", "walk", 0]]
    assert points[["steps", "return"]].to_numpy().tolist() == [[1000, 5], [2000, 6]]
