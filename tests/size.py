"""Checks that code and documentation keep to their size: `python tests/size.py`, by `make lint`.

Limits of code are in lines, blank ones and comments included. A function's are those of its
statements, without signature and docstring. Lower a limit when its text has become shorter.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

FILE = 250
FUNCTION = 50
TOTAL = 28_000
WORDS = 24_000
"""Of README and docs/."""

ROOT = Path(__file__).resolve().parents[1]


def sizes() -> Iterator[tuple[str, int, int]]:
    """Yields each file, function and total with its size and its limit."""
    total = 0
    for path in sorted((ROOT / "jbench").rglob("*.py")):
        text, file = path.read_text("utf-8"), path.relative_to(ROOT).as_posix()
        lines = len(text.splitlines())
        total += lines
        yield file, lines, FILE
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                yield f"{file}: {node.name}", statements(node), FUNCTION
    yield "jbench/", total, TOTAL
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    yield "README and docs/", sum(len(page.read_text("utf-8").split()) for page in pages), WORDS


def statements(function: ast.FunctionDef) -> int:
    """Returns the number of lines of a function from its first statement to its end."""
    first, *more = function.body
    if more and ast.get_docstring(function) is not None:
        first = more[0]
    return (function.end_lineno or first.lineno) - first.lineno + 1


if __name__ == "__main__":
    excesses = [
        f"{name}: {size:,}; {limit:,} are permitted."
        for name, size, limit in sizes()
        if size > limit
    ]
    sys.exit("\n".join(excesses) or None)
