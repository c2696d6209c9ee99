"""The code that users write: which files it has, and a checksum of each.

A result of a user's task, encoder, update rule, agent or policy depends on its module and on the
modules that this one imports. Of those, the code of the user are the ones beside the module and in
its package. Comments, formatting and docstrings are left out of a checksum, which is one of the
syntax tree. Data files count if the code names them: a text in it, such as `"weights.npz"`, is the
path of a file beside the module or in the working directory. What MuJoCo reads is not among them,
since the robot's compiled model is compared (`tasks/robot_checksum.py`).

Not seen: modules elsewhere, such as installed libraries, whose versions are in the provenance;
modules imported under a computed name; and files whose names are computed.
"""

import ast
import hashlib
import importlib.util
import json
import os
import sys
from collections.abc import Iterator, Mapping
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from types import ModuleType
from weakref import WeakKeyDictionary

from jbench import installed
from jbench.syntax import CHECKSUM_DIGITS, named_files, syntax_tree, tree_checksum

_INSTALLED = frozenset({"site-packages", "dist-packages"})
_OURS = "jbench"


_known: WeakKeyDictionary[ModuleType, dict[str, str]] = WeakKeyDictionary()


def source_files(module_name: str) -> dict[str, str]:
    """Returns a checksum for each file of the code behind a module, its own file first.

    The names are relative to the directory of the module, or of its top-level package. There are
    none for Python's own modules, for an installed library that offers nothing to jbench, for a
    module without a file, and for one that does not exist.

    A module that is not imported is found, but not imported. Those of an imported one are read once
    in a process, so that the checksums are those of the code that it runs.
    """
    module = sys.modules.get(module_name)
    if module is None:
        return _read(module_name, module_file(module_name))
    if module not in _known:
        file = getattr(module, "__file__", None)
        _known[module] = _read(module_name, None if file is None else Path(file))
    return _known[module]


def checksum(files: Mapping[str, str]) -> str | None:
    """Returns one checksum of all files of `source_files`; None for none."""
    if not files:
        return None
    content = json.dumps(sorted(files.items()))
    return hashlib.sha256(content.encode()).hexdigest()[:CHECKSUM_DIGITS]


def file_checksum(path: Path) -> str:
    """Returns the checksum of a file: of the syntax tree of Python code, else of its bytes."""
    if path.suffix == ".py":
        tree = syntax_tree(path)
        if tree is not None:
            return tree_checksum(tree)
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:CHECKSUM_DIGITS]


def module_file(module_name: str) -> Path | None:
    """Returns the file of a module, without importing it or its packages; None without one."""
    top, *parts = module_name.split(".")
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return None

    if spec is None or not parts:
        return None if spec is None or spec.origin is None else Path(spec.origin)

    for directory in spec.submodule_search_locations or ():
        path = Path(directory).joinpath(*parts)
        for candidate in (path / "__init__.py", path.with_name(f"{path.name}.py")):
            if candidate.is_file():
                return candidate

    return None


def _read(module_name: str, path: Path | None) -> dict[str, str]:
    """Returns the checksums of the files of a module of the user, by name."""
    top = module_name.partition(".")[0]
    if path is None or not path.is_file() or top in sys.stdlib_module_names or top == _OURS:
        return {}

    depth = module_name.count(".") + (path.stem == "__init__")
    root = path.parents[depth]
    is_installed = root.name in _INSTALLED
    if is_installed and _is_library(top):
        return {}

    code = _Code(root, only=_of_same_distribution(top) if is_installed else None)
    code.add_with_packages(path)
    return code.checksums


def _is_library(package: str) -> bool:
    """Returns whether an installed package was neither made for jbench nor from a local directory.

    Its versions are in the provenance, and separate no results.
    """
    for name in installed.packages().get(package, ()):
        try:
            found = distribution(name)
        except PackageNotFoundError:
            continue
        groups = {point.group for point in found.entry_points}
        return not (any(g.startswith(f"{_OURS}.") for g in groups) or _is_local(found))
    return False


def _of_same_distribution(package: str) -> set[str]:
    """Returns the packages that were installed together with one."""
    packages = installed.packages()
    mine = set(packages.get(package, ()))
    return {package, *(name for name, owners in packages.items() if mine.intersection(owners))}


def _is_local(found: Distribution) -> bool:
    """Returns whether a distribution was installed from a folder of this machine."""
    try:
        url = json.loads(found.read_text("direct_url.json") or "{}").get("url", "")
    except (ValueError, AttributeError):
        return False
    return str(url).startswith("file:")


class _Code:
    """Files below a directory, found from one of them by its imports."""

    def __init__(self, root: Path, only: set[str] | None) -> None:
        """Begins without files; `only` are the top-level names that count, None for all."""
        self.checksums: dict[str, str] = {}
        self._root = root
        self._only = only

    def add_with_packages(self, path: Path) -> None:
        """Adds a file, the packages that Python imports before it, and all that they import."""
        waiting = [path, *self._packages_above(path)]
        while waiting:
            path = waiting.pop(0)
            name = path.relative_to(self._root).as_posix()
            if name in self.checksums:
                continue
            self.checksums[name] = file_checksum(path)
            if path.suffix != ".py":
                continue
            tree = syntax_tree(path)
            if tree is None:
                continue
            waiting += self._imported(path, tree)
            self._add_data(path, tree)

    def _imported(self, path: Path, tree: ast.AST) -> Iterator[Path]:
        """Yields the files that a module imports, also inside functions."""
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    yield from self._found(self._root, alias.name.split("."), path)
            elif isinstance(node, ast.ImportFrom):
                parts = []
                if node.module:
                    parts = node.module.split(".")

                start = self._root
                if node.level > len(path.parents):  # which Python can't import
                    continue
                if node.level:
                    start = path.parents[node.level - 1]
                if not start.is_relative_to(self._root):
                    continue
                yield from self._found(start, parts, path)
                for alias in node.names:  # a module of the package, perhaps
                    yield from self._found(start, [*parts, alias.name], path)

    def _found(self, start: Path, parts: list[str], importer: Path) -> Iterator[Path]:
        """Yields the file of a module and those of its packages, if they are of this code."""
        if start == self._root and parts:
            if parts[0] == _OURS or (self._only is not None and parts[0] not in self._only):
                return
            beside = importer.parent
            if not _exists(start, parts[0]) and str(beside) in sys.path:
                start = beside  # as Python finds the modules beside a script

        directory = start.joinpath(*parts)
        candidates = [directory / "__init__.py"]
        if parts:
            candidates.append(directory.with_name(f"{parts[-1]}.py"))
            if directory.parent.is_dir():
                candidates += sorted(directory.parent.glob(f"{parts[-1]}.*.so"))
                candidates += sorted(directory.parent.glob(f"{parts[-1]}.*.pyd"))

        for candidate in candidates:
            if candidate.is_file():
                yield candidate
                yield from self._packages_above(candidate)
                return

    def _packages_above(self, path: Path) -> Iterator[Path]:
        """Yields the `__init__.py` of the packages around a file."""
        for directory in path.parents:
            if directory == self._root or not directory.is_relative_to(self._root):
                return
            package = directory / "__init__.py"
            if package.is_file():
                yield package

    def _add_data(self, path: Path, tree: ast.AST) -> None:
        """Adds the files that code names, such as a model in XML."""
        for text in named_files(tree):
            for directory in (path.parent, Path.cwd()):
                file = directory / text
                found = _checksum_of_data(file)
                if found is None:
                    continue

                name = text
                if file.resolve().is_relative_to(self._root.resolve()):
                    name = os.path.relpath(file.resolve(), self._root.resolve())
                self.checksums.setdefault(Path(name).as_posix(), found)
                break


def _checksum_of_data(file: Path) -> str | None:
    """Returns the checksum of a file that a text may name; None if there is none to be read.

    A text may be a sentence, longer than the names of files, or name what others may read.
    """
    try:
        if file.is_file():
            return file_checksum(file)
    except OSError:
        pass
    return None


def _exists(directory: Path, name: str) -> bool:
    """Returns whether a directory has a module or package of a name."""
    return (directory / f"{name}.py").is_file() or (directory / name).is_dir()
