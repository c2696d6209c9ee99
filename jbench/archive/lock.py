"""The versions of the packages that repeat runs."""

import importlib.metadata

from packaging.requirements import Requirement


def lock() -> str:
    """Returns the installed versions of jbench and of all that it needs, for pip."""
    versions: dict[str, str] = {}
    waiting = ["jbench"]
    while waiting:
        name = waiting.pop()
        try:
            distribution = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue

        if name in versions:
            continue
        versions[name] = distribution.version
        for text in distribution.requires or []:
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                waiting.append(requirement.name.lower().replace("_", "-"))

    lines = [f"{name}=={version}" for name, version in sorted(versions.items())]
    return "# The versions with which this archive was written.\n" + "\n".join(lines) + "\n"
