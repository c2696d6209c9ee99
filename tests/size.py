"""Checks that code and documentation keep to their size: `python tests/size.py`, by `make lint`.

Limits of code are in lines, blank ones and comments included. A function's are those of its
statements, without signature and docstring. Lower the total when code has become shorter.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

FILE = 250
FUNCTION = 50
TOTAL = 39_100
WORDS = 24_000
"""Of README and docs/."""

ROOT = Path(__file__).resolve().parents[1]


def excesses() -> Iterator[str]:
    """Yields a sentence for each limit that is exceeded."""
    total = 0
    for path in sorted((ROOT / "jbench").rglob("*.py")):
        text, name = path.read_text("utf-8"), path.relative_to(ROOT)
        lines = len(text.splitlines())
        total += lines
        if lines > FILE:
            yield f"{name} has {lines} lines; {FILE} are permitted."
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef) and (length := statements(node)) > FUNCTION:
                place = f"{name}:{node.lineno}: {node.name}"
                yield f"{place} has {length} lines; {FUNCTION} are permitted."
    if total > TOTAL:
        yield f"jbench/ has {total:,} lines; {TOTAL:,} are permitted."
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    words = sum(len(page.read_text("utf-8").split()) for page in pages)
    if words > WORDS:
        yield f"README and docs/ have {words:,} words; {WORDS:,} are permitted."


def statements(function: ast.FunctionDef) -> int:
    """Returns the number of lines of a function from its first statement to its end."""
    first, *more = function.body
    if more and ast.get_docstring(function) is not None:
        first = more[0]
    return (function.end_lineno or first.lineno) - first.lineno + 1


if __name__ == "__main__":
    sys.exit("\n".join(excesses()) or None)
