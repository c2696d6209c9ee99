"""The file requirements.txt of an archive: the versions of the packages that repeat its runs."""

import importlib.metadata

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

_NO_EXTRA = ""

_HEAD = """\
# The versions with which this archive was written, but for jbench (README.txt).
"""


def requirements_text() -> str:
    """Returns a file for pip with the installed versions of all packages that jbench needs."""
    versions = _needed("jbench")
    versions.pop("jbench", None)
    lines = [f"{name}=={_public(version)}\n" for name, version in sorted(versions.items())]
    return _HEAD + "".join(lines)


def _needed(package: str) -> dict[str, str]:
    """Returns the installed version of a package and of each that it needs, by name.

    A requirement may ask for extras of a package, which need further packages.
    """
    versions: dict[str, str] = {}
    seen = set[tuple[str, str]]()
    waiting = [(package, _NO_EXTRA)]
    while waiting:
        name, extra = waiting.pop()
        if (name, extra) in seen:
            continue

        seen.add((name, extra))
        try:
            distribution = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue

        versions[name] = distribution.version
        for text in distribution.requires or []:
            requirement = Requirement(text)
            marker = requirement.marker
            if marker is None or marker.evaluate({"extra": extra}):
                required = canonicalize_name(requirement.name)
                waiting += [(required, asked) for asked in (_NO_EXTRA, *requirement.extras)]

    return versions


def _public(version: str) -> str:
    """Returns a version as a package index has it: 2.13.0 where 2.13.0+cpu is installed."""
    try:
        public = Version(version).public
    except InvalidVersion:
        return version

    if public == version:
        return version
    return f"{public}  # here {version}"
