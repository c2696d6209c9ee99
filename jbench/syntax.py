"""Syntax trees of users' code: a checksum of what it does, and the data files that it names."""

import ast
import hashlib
import re
from pathlib import Path

CHECKSUM_DIGITS = 16
"""Hexadecimal digits of a checksum of code."""

_DATA_NAMES = """
.bin .ckpt .csv .h5 .hdf5 .joblib .json .mat .npy .npz .onnx .parquet .pickle .pkl .pt .pth
.safetensors .toml .yaml .yml
"""
_DATA = frozenset(_DATA_NAMES.split())
"""Endings of data files that code may read; meshes and XML are in the compiled model."""

_WRITES = re.compile(r"save|write|dump|to_[a-z]+$|touch|mkdir|unlink|remove")


def syntax_tree(path: Path) -> ast.Module | None:
    """Returns the syntax tree of a file; None if Python can't import it."""
    try:
        return ast.parse(path.read_bytes())
    except (SyntaxError, ValueError, RecursionError, MemoryError):  # of expressions too deep
        return None


def tree_checksum(tree: ast.AST) -> str:
    """Returns a checksum of a syntax tree without positions, docstrings and empty fields.

    Newer versions of Python add fields, which are empty for the code that older ones can read.
    """
    digest = hashlib.sha256()
    stack: list[object] = [tree]
    while stack:
        item = stack.pop()
        if isinstance(item, ast.AST):
            digest.update(f"{type(item).__name__}(".encode())
            stack.append(_END)
            for name, value in reversed([*ast.iter_fields(item)]):
                if name not in ("ctx", "kind", "type_comment") and value not in (None, []):
                    stack.append(value)
                    stack.append(_Field(name))
        elif isinstance(item, list):
            stack.append(_END)
            stack += [part for part in reversed(item) if not _is_comment(part)]
        else:
            digest.update(f"{item!r};".encode(errors="backslashreplace"))

    return digest.hexdigest()[:CHECKSUM_DIGITS]


class _Field(str):
    """The name of a field of a syntax tree."""


_END = _Field(")")


def _is_comment(node: object) -> bool:
    """Returns whether a statement is a text, such as a docstring."""
    is_constant = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return is_constant and isinstance(node.value.value, str)  # type: ignore[attr-defined]


def named_files(tree: ast.AST) -> list[str]:
    """Returns the texts in code that may name a data file which it does not write."""
    written = set[int]()
    texts = list[tuple[int, str]]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            if _is_writing(node):
                written |= {id(part) for part in ast.walk(node)}
            arguments = [str(part.value) for part in node.args if isinstance(part, ast.Constant)]
            texts.append((id(node), "/".join(arguments)))  # os.path.join(here, "a", "b")
        elif isinstance(node, ast.Constant):
            texts.append((id(node), str(node.value)))
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
            texts.append((id(node), _joined(node)))  # here / "a" / "b"

    return [
        text
        for node_id, text in texts
        if node_id not in written
        and len(text) < 200
        and text.isprintable()
        and Path(text).suffix.lower() in _DATA
    ]


def _joined(node: ast.AST) -> str:
    """Returns the path that constants joined by `/` make."""
    parts = list[str]()
    while isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
        if isinstance(node.right, ast.Constant) and isinstance(node.right.value, str):
            parts.insert(0, node.right.value)
        node = node.left
    return "/".join(parts)


def _is_writing(call: ast.Call) -> bool:
    """Returns whether a call writes a file, by its name and mode."""
    function = call.func
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    if name == "open":
        modes = [*call.args[1:2], *(k.value for k in call.keywords if k.arg == "mode")]
        return any(isinstance(m, ast.Constant) and set(str(m.value)) & set("wax+") for m in modes)
    return _WRITES.match(name) is not None
