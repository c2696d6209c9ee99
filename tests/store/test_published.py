"""Tests of the paper's published learning curves against values read from its figures."""

import pytest

from jbench.store import query

# Median [10%, 90%] at the end of Figure 9's curves, read from the paper by eye and by hand.
FIGURE_9 = {
    "move_from_origin": "933 633 967 | 713 147 943 | 973 959 979 | 971 950 978",
    "face_direction": "808 693 881 | 239 24 863 | 959 932 969 | 963 908 985",
    "move_in_direction": "632 369 711 | 174 41 390 | 799 733 834 | 824 749 853",
    "move_to_position": "579 312 733 | 4 0 212 | 794 601 889 | 555 167 788",
    "move_to_pose": "232 23 522 | 0 0 20 | 64 12 179 | 1 0 28",
}
CELLS = [
    (task, algo, [float(number) for number in cell.split()])
    for task, cells in FIGURE_9.items()
    for algo, cell in zip(("ddpg", "ppo", "sac", "td3"), cells.split("|"), strict=True)
]


@pytest.fixture(scope="module")
def tables():
    return {"published": query.published()}


def fetch(tables, sql):
    return [tuple(row) for row in query.run_sql(sql, tables).to_numpy()]


@pytest.mark.parametrize(("task", "algo", "expected"), CELLS)
def test_figure_9_final_quantiles_match_paper(tables, task, algo, expected):
    sql = f"""
        select arg_max(episode_return, control_steps) from published
        where figure = 'fig9' and task = '{task}' and algo = '{algo}'
        group by quantile order by quantile
    """
    low, median, high = (value for (value,) in fetch(tables, sql))
    assert [median, low, high] == pytest.approx(expected, abs=1)


def test_representations_have_names_used_by_runs(tables):
    sql = """
        select distinct representation, figure = 'augmented-sac' from published order by all
    """
    # The sequence of ten robots is the only one that none of our runs uses.
    expected = [("dae12", False), ("full", False), ("full-augmented-sequence", True)]
    assert fetch(tables, sql) == expected
