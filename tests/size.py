"""Checks that functions and files stay readable: `python tests/size.py`, by `make lint`.

Limits are in lines, blank ones and comments included. A function's are those of its statements,
without signature and docstring. No total is limited.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

FILE = 300
FUNCTION = 50

ROOT = Path(__file__).resolve().parents[1]


def sizes() -> Iterator[tuple[str, int, int]]:
    """Yields each file and function with its size and its limit."""
    for path in sorted((ROOT / "jbench").rglob("*.py")):
        text = path.read_text("utf-8")
        file = path.relative_to(ROOT).as_posix()
        yield file, len(text.splitlines()), FILE

        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                yield f"{file}: {node.name}", statements(node), FUNCTION


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
