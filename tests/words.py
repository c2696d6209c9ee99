"""Checks that all texts have one word for one thing: `python -m tests.words`, by `make lint`."""

import ast
import io
import re
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path

from typer.main import get_command

from jbench.cli import app
from tests.documentation import PAGES, ROOT

EVERYWHERE = re.compile(
    r"\b(ends? (lower|higher|above one)|ended (lower|higher)|"
    r"spread (of|across|between)|the spread|interim looks?|all looks|last returns|"
    r"(is|are) (not )?(shown|decided) (to|whether)|the heuristic's|say little)\b",
    re.IGNORECASE,
)
IN_PAGES = re.compile(rf"{EVERYWHERE.pattern}|\b(cells?|spreads?|--encoder \d+)\b", re.IGNORECASE)
"""Words that CONTRIBUTING.md replaces by another one."""


def used(words: re.Pattern[str], text: str) -> list[str]:
    """Returns the words that a text has, on one line or across two."""
    return [found[0] for found in words.finditer(" ".join(text.split()))]


def prose(page: Path) -> str:
    """Returns the text of a page without names of code and the table of CONTRIBUTING.md."""
    return re.sub(r"(?ms)`Cell`|^ *\| term .*?\n\S", "", page.read_text("utf-8"))


def helps() -> Iterator[tuple[str, str]]:
    """Yields each verb and its help."""
    for name, command in get_command(app).commands.items():
        context = command.make_context(name, [], resilient_parsing=True)
        with redirect_stdout(io.StringIO()) as printed:
            returned = command.get_help(context)
        yield name, f"{printed.getvalue()}{returned}"


def messages(path: Path) -> Iterator[tuple[int, str]]:
    """Yields the texts of a module that are no docstrings, with their lines."""
    tree = ast.parse(path.read_text("utf-8"))
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if is_text and id(node) not in docstrings:
            yield node.lineno, node.value


def mistakes() -> Iterator[str]:
    """Yields a sentence for each text with a word that has a better one."""
    for page in PAGES:
        for word in used(IN_PAGES, prose(page)):
            yield f"{page.name}: '{word}'; see the table in CONTRIBUTING.md."

    for verb, text in helps():
        if not text.strip():
            yield f"jbench {verb} --help: nothing is read; this check is blind."
        for word in used(IN_PAGES, text):
            yield f"jbench {verb} --help: '{word}'; see the table in CONTRIBUTING.md."

    for path in sorted((ROOT / "jbench").rglob("*.py")):
        for line, text in messages(path):
            for word in used(EVERYWHERE, text):
                yield f"{path.name}:{line}: '{word}'; see the table in CONTRIBUTING.md."


if __name__ == "__main__":
    sys.exit("\n".join(mistakes()) or None)
