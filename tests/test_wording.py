"""Tests of wording: singular and plural in messages, and one word for one thing in all texts."""

import ast
import re
from pathlib import Path

import pytest
from typer.main import get_command

from jbench.cli import app
from jbench.wording import duration, with_results
from tests.documentation import PAGES, ROOT

EVERYWHERE = re.compile(
    r"\b(ends? (lower|higher|above one)|ended (lower|higher)|"
    r"spread (of|across|between)|the spread|interim looks?|all looks|last returns|"
    r"(is|are) (not )?(shown|decided) (to|whether)|the heuristic's|say little)\b",
    re.IGNORECASE,
)
IN_PAGES = re.compile(rf"{EVERYWHERE.pattern}|\b(cells?|spreads?|--encoder \d+)\b", re.IGNORECASE)
"""Words that CONTRIBUTING.md replaces by another one."""


def used(words, text):
    return [found[0] for found in words.finditer(" ".join(text.split()))]


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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_use_one_word_for_one_thing(page):
    text = page.read_text()
    # Without names of code and the table of CONTRIBUTING.md.
    prose = re.sub(r"(?ms)`Cell`|^ *\| term .*?\n\S", "", text)
    assert used(IN_PAGES, prose) == []


def test_help_uses_one_word_for_one_thing(capsys):
    for name, command in get_command(app).commands.items():
        context = command.make_context(name, [], resilient_parsing=True)
        command.get_help(context)
        assert used(IN_PAGES, capsys.readouterr().out) == []


def texts(path):
    """Yields the texts of a module that are no docstrings, with their lines."""
    tree = ast.parse(path.read_text())
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if is_text and id(node) not in docstrings:
            yield node.lineno, node.value


def test_messages_use_one_word_for_one_thing():
    found = [
        (path.name, line, words)
        for path in (ROOT / "jbench").rglob("*.py")
        for line, text in texts(path)
        if (words := used(EVERYWHERE, text))
    ]
    assert found == []


def test_suggested_command_has_results_unless_they_are_the_default():
    assert with_results("jbench report", Path("results")) == "jbench report"
    assert with_results("jbench report", Path("a")) == "jbench report --results a"
    assert with_results("jbench runs", Path("a b")) == "jbench runs --results 'a b'"
