"""Classes and functions of other packages: by entry point, or as MODULE:NAME.

Encoders (`jbench.encoders`), agents (`jbench.agents`), update rules (`jbench.rules`) and policies
(`jbench.policies`) are entry point groups.
"""

import importlib.util
import inspect
import os
import re
import sys
from collections.abc import Callable, Collection, Mapping
from hashlib import sha256
from importlib.metadata import EntryPoint, version
from pathlib import Path
from typing import Any

from jbench import installed, sources
from jbench.errors import ERRORS_OF_OTHERS, RequestError, WorkError, sentence_of_failure
from jbench.typed_values import closest

_IMPORTED = re.compile(r"[A-Za-z_][A-Za-z0-9_.]*:[A-Za-z_][A-Za-z0-9_]*")

_IN_A_FILE = re.compile(r"(?P<path>.+\.py):(?P<name>[A-Za-z_][A-Za-z0-9_]*)")
"""What some type for MODULE:NAME, such as lab/robots.py:walker."""


def offered(group: str, pattern: re.Pattern[str], taken: Collection[str]) -> dict[str, EntryPoint]:
    """Returns the entry points of a group by name, but for invalid names and those of jbench."""
    return {
        point.name: point
        for point in installed.offered(group)
        if pattern.fullmatch(point.name) and point.name not in taken
    }


def load(what: str, point: EntryPoint) -> Any:
    """Returns what an entry point names; raises a WorkError if it can't be, or is named twice."""
    others = [other for other in installed.offered(point.group) if other.name == point.name]
    packages = sorted({distribution(other) or other.value for other in others})
    if len(packages) > 1:
        raise WorkError(
            f"The {what} {point.name} is offered by {' and '.join(packages)}; uninstall all but "
            "one of them."
        )
    subject = f"The {what} {point.name} can't be loaded from {point.value}"
    return _attempt(point.load, subject, ", or uninstall the package that offers it")


def distribution(point: EntryPoint) -> str | None:
    """Returns the name of the distribution that offers an entry point."""
    if point.dist is None:
        return None
    return point.dist.name


def first_line(documented: object) -> str:
    """Returns the first line of the docstring of a class, function or object; "" without one."""
    text = getattr(documented, "__doc__", None)
    if not isinstance(text, str):
        return ""

    lines = text.strip().splitlines()
    if not lines:
        return ""
    return lines[0].strip()


def parameters(function: Callable[..., Any]) -> Mapping[str, inspect.Parameter] | None:
    """Returns the parameters of a function or a class; None for one in C that does not say them."""
    try:
        return inspect.signature(function).parameters
    except ValueError:
        return None


def is_imported(name: str) -> bool:
    """Returns whether a name is of the form MODULE:NAME."""
    return _IMPORTED.fullmatch(name) is not None


def imported(what: str, name: str) -> Any:
    """Returns MODULE:NAME; a module in the working directory is found, too.

    Raises a RequestError if there is no such module or attribute, and a WorkError if the module
    raises an error.
    """
    module_name, _, attribute = name.partition(":")
    find_working_directory()
    subject = f"The {what} {name} can't be loaded"
    exists = _attempt(lambda: _is_found(module_name), subject)

    if not exists:
        refuse_path(name)
        raise RequestError(
            f"The {what} {name} can't be imported: there is no module {module_name}; install its "
            "package, or run jbench in the directory that contains the module, or set PYTHONPATH."
        )

    module = _attempt(lambda: importlib.import_module(module_name), subject)
    if not hasattr(module, attribute):
        close = closest(attribute, [public for public in vars(module) if public[0] != "_"])
        advice = "use a name that is in it."
        if close is not None:
            advice = f"did you mean {module_name}:{close}?"
        raise RequestError(f"The module {module_name} has no {attribute}; {advice}")

    return getattr(module, attribute)


def _is_found(module: str) -> bool:
    """Returns whether there is a module; its parent packages are imported, and may raise any error.

    A package that is missing among them is none of the module's own.
    """
    try:
        return module in sys.modules or importlib.util.find_spec(module) is not None
    except ModuleNotFoundError as error:
        if not is_missing(module, error):
            raise
        return False


def is_missing(module: str, error: BaseException) -> bool:
    """Returns whether an error says that a module, or a package that it is in, is not there.

    A module may itself import one that is missing, whose name may be the beginning of its own.
    """
    if not isinstance(error, ModuleNotFoundError) or error.name is None:
        return False
    return f"{module}.".startswith(f"{error.name}.")


def refuse_path(name: str) -> None:
    """Raises a RequestError for a name with the path of a Python file, with the MODULE:NAME."""
    match = _IN_A_FILE.fullmatch(name)
    if match is None:
        return

    module, where = module_in_file(match["path"])
    raise RequestError(f"{name} has the path of a file; type {module}:{match['name']}{where}.")


def module_in_file(path: str) -> tuple[str, str]:
    """Returns the name of the module in a Python file, and in words where else it is found.

    The words are empty for a file below the working directory.
    """
    file = Path(path.replace("\\", "/")).with_suffix("")
    package = file
    if file.name == "__init__":
        package = file.parent
    if all(part.isidentifier() for part in package.parts):
        return ".".join(package.parts), ""

    return package.name, f" in the directory {package.parent}, or with it in PYTHONPATH"


def is_module(name: str) -> bool:
    """Returns whether a name is that of a module that can be imported; imports no package."""
    if name in sys.modules:  # also `__main__`, which may have no file
        return True

    find_working_directory()
    is_name = all(part.isidentifier() for part in name.split("."))
    return is_name and sources.module_file(name) is not None


def find_working_directory() -> None:
    """Lets Python import modules of the working directory, as where `python -m` began."""
    directory = os.getcwd()
    if directory not in sys.path and "" not in sys.path:
        sys.path.insert(0, directory)


def made_with(package: str | None) -> dict[str, str | None]:
    """Returns provenance of an installed distribution: its version; none for None."""
    if package is None:
        return {}
    return {"package": f"{package} {version(package)}"}


def code_provenance(what: str, name: str, points: Mapping[str, EntryPoint]) -> dict[str, Any]:
    """Returns provenance of the code of others: what is installed, and checksums of its files.

    It is the version of a distribution, or the checksum of a module's bytes, and `source_files`.
    The name is one among the entry points, or MODULE:NAME, which is imported, and raises as
    `imported` and `load`.
    """
    if is_imported(name):
        imported(what, name)
        module = name.partition(":")[0]
        origin: dict[str, Any] = {**where_from(module)}
    else:
        load(what, points[name])
        module = points[name].module
        origin = {**made_with(distribution(points[name]))}

    files = sources.source_files(module)
    if files:
        origin["sources"] = files
    return origin


def files_at_hand(name: str, points: Mapping[str, EntryPoint]) -> dict[str, Any]:
    """Returns what `provenance` does of files, without importing them; {} if there are none.

    The name may be that of anything: another person may have recorded it.
    """
    find_working_directory()
    if name in points:
        return {"sources": sources.source_files(points[name].module)}
    if not is_imported(name):
        return {}

    module = name.partition(":")[0]
    path = sources.module_file(module)
    if path is None or not path.is_file():
        return {}

    made: dict[str, Any] = {"source_sha256": sha256(path.read_bytes()).hexdigest()}
    return {**made, "sources": sources.source_files(module)}


def where_from(module: str) -> dict[str, str | None]:
    """Returns provenance of an imported module: its distribution, or a checksum of its bytes."""
    packages = installed.packages().get(module.partition(".")[0])
    if packages:
        return made_with(packages[0])

    file = getattr(sys.modules[module], "__file__", None)
    if file is None:
        return {}
    return {"source_sha256": sha256(Path(file).read_bytes()).hexdigest()}


def _attempt(load_it: Callable[[], Any], subject: str, otherwise: str = "") -> Any:
    """Loads code of others; what it raises is a WorkError, which says how to go on."""
    try:
        return load_it()
    except ERRORS_OF_OTHERS as error:
        reason = sentence_of_failure(error)
        raise WorkError(f"{subject} ({reason}); fix it{otherwise}.") from None
