"""Tests of tables: at any width no number is cut, no word broken, and no line too long."""

import re

import pandas as pd
import pytest
from rich.cells import cell_len

from jbench import task_specs
from jbench.cli import main
from jbench.commands import demo, encoder_tables, output
from jbench.report import figures
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.report.tables import tables
from jbench.store import Results
from tests.demo_results import ENCODER

RUN = "face_direction/td3/planar12/s00-3d410709"
OTHER = "face_direction/td3/planar12/s01-3d410700"
ERROR = "OSError: there is no room left on the device of /home/somebody/with/a/long/path/results"
WIDTHS = (60, 80, 100, 150)
WHOLE = "… stands for a part of a name: a wider terminal, or --json, shows it whole."
"""What follows a table of shortened names."""

RETURNS = ["run", "status", "episodes", "created", "variant", "training return"]
RETURNS += ["evaluation return"]


@pytest.fixture
def printed(monkeypatch, capsys):
    """Returns a function that prints a table at a width (None: in a pipe); returns its lines."""
    table = output.table  # which a test may replace

    def lines(width, *arguments, **options):
        if width is None:
            monkeypatch.delenv("COLUMNS", raising=False)
        else:
            monkeypatch.setenv("COLUMNS", str(width))
        capsys.readouterr()
        table(*arguments, **options)
        return capsys.readouterr().out.splitlines()

    return lines


@pytest.fixture
def check(printed):
    """Returns a function that prints a table at every width and checks what is printed."""

    def check_all(title, header, rows, spare=(), below=()):
        rows = [list(row) for row in rows]
        for width in (*WIDTHS, None):
            lines = printed(width, title, header, rows, spare, below)
            _check(lines, width, title, header, rows, spare)

    return check_all


def _check(lines, width, title, header, rows, spare):
    text = " ".join(" ".join(lines).split())
    narrow = re.search(r"Too narrow for (.*?): a wider terminal, or --json, shows all\.", text)
    left_out = narrow[1].split(", ") if narrow else []
    assert set(left_out) <= set(spare)
    if width is None:
        assert not left_out
        assert "…" not in text or "…" in str(rows)
    else:
        assert max(map(cell_len, lines)) <= width

    cells = [
        output._short(cell)
        for row in rows
        for name, cell in zip(header, row, strict=True)
        if name not in left_out
    ]
    said = f"run : a wider terminal, or --json, shows all. Too narrow for {WHOLE}"
    known = " ".join((title, *header, *cells, *(f"{name}:" for name in header), said)).split()
    known += [f"{word}:" for word in known] + [f"{name}," for name in " ".join(header).split()]
    words = set(text.split())
    whole, short = set(known), {word for word in words - set(known) if "…" in word}
    assert words - whole - short - set("─") <= {word for word in words if set(word) <= {"─"}}
    for word in short:
        pieces = map(re.escape, word.rstrip(":").split("…"))
        # A number is not cut, not even within a long word.
        cut = re.compile(r"(?!(?<=\d)\d).+".join(pieces))
        assert any(cut.fullmatch(w) for w in whole)
    for value in re.findall(r"\[[^\[\]]*\]", " ".join(cells)):
        assert any(value in line for line in lines)
    for word in " ".join(cells).split():
        if re.fullmatch(r"[-+\[(]*[\d.,]+[\])%,kM]*", word):
            assert word in words


@pytest.mark.parametrize(("width", "is_list"), [(84, False), (70, False), (45, False), (30, True)])
def test_a_table_says_where_shortened_names_are_whole(width, is_list, printed):
    rows = [[id, "1,000,192 of 1,000,000", "2026-11-24 10:44"] for id in (RUN, OTHER)]
    lines = printed(width, "", ["run", "steps", "created"], rows, spare=("created",))
    said = WHOLE in " ".join(" ".join(lines).split())
    assert said == (width < 84)
    assert said == (RUN not in " ".join(lines))
    assert any(line.split()[:1] == ["steps"] for line in lines) == is_list


@pytest.mark.parametrize(
    "variant", ["", "learning_starts=20000, hidden_layers=[128, 128], tau=0.01"]
)
def test_numbers_are_whole_with_and_without_variant(variant, check, printed):
    rows = [[RUN, "finished", "100", "2026-11-24 10:44", variant, 12.25, 136]]
    rows += [[OTHER, "finished", "1,000", "2026-11-24 10:44", "", 97, 527.5]]
    check("Returns", RETURNS, rows, spare=("created", "variant", "episodes", "status"))
    check("Returns", RETURNS, rows)


def test_columns_give_way_in_the_stated_order(printed):
    """By hand: 84 characters, 66 with an id of 22, which cuts no number, and 30 is too narrow."""
    header, row = ["run", "steps", "created"], [RUN, "1,000,192 of 1,000,000", "2026-11-24 10:44"]

    def shown(width):
        lines = printed(width, "", header, [row, [OTHER, *row[1:]]], spare=("created",))
        return next(line.split() for line in lines if "1,000,192" in line)

    whole = [RUN, "1,000,192", "of", "1,000,000", "2026-11-24", "10:44"]
    assert shown(84) == whole
    for width in (83, 66):
        id, *others = shown(width)
        assert others == whole[1:]
        assert len(id) <= 40 - (84 - width)
        # What tells runs apart comes after the task.
        task, _, rest = id.partition("…/")
        assert RUN.startswith(task)
        assert RUN.endswith(f"/{rest}") or rest.endswith("-3d410709")
    assert shown(65)[1:] == whole[1:4]
    id, *others = shown(40)
    assert others == whole[1:4]
    assert len(id) <= 14
    narrow = printed(30, "", header, [row], spare=("created",))
    assert [line.split()[0] for line in narrow if line.strip()][:3] == header


def test_ids_that_would_become_equal_are_shortened_less(printed):
    ids = [f"openrlbenchmark/cleanrl-with-the-name-{name}-of-a-method" for name in ("aa", "bb")]
    lines = printed(60, "", ["method", "return"], [[id, 10.5] for id in ids])
    names = [line.split()[0] for line in lines if "10.5" in line]
    assert len(set(names)) == 2


def test_one_failed_run_makes_no_list_of_the_others(printed):
    rows = [[RUN, "finished", "", 136.0], [OTHER, "failed", ERROR, 5.0]]
    for width in (60, 80):
        header = ["run", "status", "error", "evaluation return"]
        lines = printed(width, "", header, rows, below=("error",))
        (first,) = (line for line in lines if line.split()[-1:] == ["136"])
        assert first.split()[1] == "finished"
        printed_text = " ".join(" ".join(lines).split())
        assert "OSError: there is no room left" in printed_text
        assert all(len(line) <= width for line in lines)


def test_width_of_a_pipe_is_that_of_columns_and_its_tables_are_whole(printed):
    rows = [("word " * 20, "word " * 20)]
    assert max(map(len, printed(60, "a title", ["one", "two"], rows))) <= 60
    assert 150 <= max(map(len, printed(None, "a title", ["one", "two"], rows))) <= 200
    wide = printed(None, "a title", [f"column{i}" for i in range(20)], [[RUN] * 20])
    (row,) = (line for line in wide if RUN in line)
    assert row.split() == [RUN] * 20


def test_row_of_many_columns_is_a_list(printed):
    names = [f"column{i}" for i in range(20)]
    lines = printed(80, "a title", names, [[RUN] * 20, ["other"] * 20])
    assert [line.split() for line in lines if RUN in line] == [[name, RUN] for name in names]
    assert sum("other" in line for line in lines) == 20
    assert all(len(line) <= 80 for line in lines)


LONGEST = ("dmc:manipulator-insert_ball", "dmc:humanoid_CMU-stand", "dmc:quadruped-escape")
"""Tasks of the suite that are listed: those with the longest names and numbers."""

AGENTS = demo._AGENTS.split()
VERBS = [
    ["runs"],
    ["runs", "--returns"],
    ["datasets"],
    ["query", "FROM runs"],
    ["query", "SELECT run, control_steps, episode_return FROM evaluations LIMIT 9"],
    ["algorithms"],
    ["algorithms", "td3"],
    ["tasks"],
    ["tasks", "face_direction"],
    ["leaderboard"],
    [*AGENTS, "--encoder", "none"],
    [*AGENTS, "--encoder", "none", "--dry-run"],
    ["sweep", "question", "--until-decided", "--dry-run", "planar/full"],
    ["report", "--claims", "--format", "png", "--returns", "training"],
    ["report", "--compare", "encoder=full", "encoder=dae14", "--format", "png"],
]


@pytest.mark.parametrize("arguments", VERBS, ids=lambda arguments: " ".join(arguments)[:30])
def test_tables_of_every_verb(arguments, demo_results, check, monkeypatch, tmp_path):
    monkeypatch.setattr(task_specs, "SUITE_TASKS", LONGEST)
    monkeypatch.setattr(figures, "charts", lambda frames: [])  # a report's are not needed here
    seen = []
    monkeypatch.setattr(output, "table", lambda *args, **options: seen.append((args, options)))
    where = [] if arguments[0] in ("algorithms", "tasks") else ["--results", demo_results.path]
    if arguments[0] == "report":
        where += ["--out", tmp_path]
    assert main([*arguments, *map(str, where)]) == 0
    assert seen
    for args, options in seen:
        check(*args, **options)


def test_tables_of_encoders_and_demo(demo_results, check, monkeypatch):
    seen = []
    monkeypatch.setattr(output, "table", lambda *args, **options: seen.append((args, options)))
    record = Results(demo_results.path).find("encoder", ENCODER)
    encoder_tables.show_explained([record, record])
    encoder_tables.show_errors(record)
    curves = pd.DataFrame({"representation": ["full", "dae14"], "learning curve": ["▁▂▃▄▅▆▇█"] * 2})
    output.frame("Evaluation returns", curves.assign(seeds=2, extremes="488 and 501"))
    assert len(seen) >= 3
    for args, options in seen:
        check(*args, **options)


def test_spare_columns_are_columns(demo_results):
    """A heading that was renamed would never be left out."""
    frames = Frames(demo_results, Request(claims=True))
    spared = [table for table in tables(frames) if table.spare]
    assert {table.name for table in spared} >= {"final_returns", "claims", "leaderboard"}
    for table in spared:
        assert set(table.spare) <= {column.title for column in table.columns}


def test_narrow_leaderboard_keeps_the_seeds_longest(printed):
    """By hand: 90 characters with all columns, 84 without ranks, 77 without steps, too."""
    header = ["task", "rank", "entry", "algorithm", "representation", "median", "n", "steps"]
    row = ["move_in_direction", "1", "published", "TD3", "planar", "774 [652, 812]", "10", "100k"]
    for width, left_out in ((90, []), (84, ["rank"]), (77, ["rank", "steps"])):
        lines = printed(width, "", header, [row], spare=("rank", "steps", "n"))
        named = next(line for line in lines if "task" in line).split()
        assert named == [name for name in header if name not in left_out]
