"""What the two sides of a comparison are called: what differs, and once what they share."""

from pathlib import Path
from typing import NamedTuple

from jbench.report.data.source_names import directory_source
from jbench.report.request import is_directory, setting, settings_typed, typed_settings


class Sides(NamedTuple):
    """The names of two sides.

    Attributes:
        first, second: what only this side has: settings, or the end of the path of a directory.
        common: the settings of both; empty if there are none.
    """

    first: str
    second: str
    common: str = ""

    @property
    def together(self) -> str:
        """Both names, such as `engine=sb3 against engine=batched (both: algo=td3)`."""
        return f"{self.first} against {self.second}{self.in_brackets}"

    @property
    def in_brackets(self) -> str:
        """What both sides share, with a space before it; empty if there is nothing."""
        return f" (both: {self.common})" if self.common else ""


def named_sides(compare: tuple[str, str]) -> Sides:
    """Returns the names of the sides that a user has typed; see `Request.compare`."""
    directories = [is_directory(side) for side in compare]
    if all(directories):
        return _named_directories(*compare)
    if any(directories):
        names = [directory_source(side) if is_directory(side) else side for side in compare]
        return Sides(*names)

    return _named_settings(*compare)


def _named_settings(first: str, second: str) -> Sides:
    """Returns the settings that differ; all that were typed if one side has no other ones."""
    typed = [settings_typed(side) for side in (first, second)]
    shared = typed_settings(first) & typed_settings(second)
    ours, theirs = ([part for part in parts if setting(part) not in shared] for parts in typed)
    if not (shared and ours and theirs):
        return Sides(first, second)

    common = [part for part in typed[0] if setting(part) in shared]
    return Sides(", ".join(ours), ", ".join(theirs), common=", ".join(common))


def _named_directories(first: str, second: str) -> Sides:
    """Returns the paths without the folders that both begin with."""
    ours = list(Path(first).parts)
    theirs = list(Path(second).parts)
    while len(ours) > 1 and len(theirs) > 1 and ours[0] == theirs[0]:
        del ours[0], theirs[0]

    if len(ours) == len(Path(first).parts):  # as typed
        return Sides(directory_source(first), directory_source(second))

    short = (directory_source(str(Path(*parts))) for parts in (ours, theirs))
    return Sides(*short)
