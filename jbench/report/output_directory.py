"""The files of a report: written whole, and those of an earlier report in the same place removed.

`report.json` lists the files of the report with their SHA-256. A file is removed only if the list
names it, the new report has none of its name, and its content is still what was written: what
someone else put there, or changed, is left.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path

from jbench.store.files import make_directory, open_plain, remove, sha256, write_atomic

LISTING = "report.json"

_LARGEST_LISTING = 1 << 22  # bytes


def write(out: Path, contents: Mapping[str, bytes]) -> tuple[list[Path], list[str]]:
    """Writes the files of a report.

    Args:
        out: directory; made if need be.
        contents: of the files by name.

    Returns:
        The files written, and a sentence on files of an earlier report that were left, if any.

    Raises:
        RequestError: if nothing can be written there.
        WorkError: if the disk is full or refuses.
    """
    make_directory(out)
    before = _listed(out)
    new = {name: sha256(content) for name, content in contents.items()}
    # Of both reports until all is done: a kill in between leaves no file that no list names.
    write_atomic(out / LISTING, _listing({**before, **new}))
    for name, content in contents.items():
        write_atomic(out / name, content)
    old = {name: digest for name, digest in before.items() if name not in new}
    changed = [name for name, digest in old.items() if not _remove(out / name, digest)]
    write_atomic(out / LISTING, _listing(new))
    told = (
        [
            f"{', '.join(sorted(changed))} in {out} are of an earlier report, but were changed "
            "since; they are left."
        ]
        if changed
        else []
    )
    return [*(out / name for name in contents), out / LISTING], told


def change(out: Path, name: str, new: Callable[[bytes], bytes]) -> None:
    """Changes a file of the report that is there; if someone else did before, it stays theirs.

    Args:
        out: directory of the report.
        name: of the file.
        new: given the content, returns what it shall be.
    """
    files = _listed(out)
    try:
        with open_plain(out / name) as file:
            before = file.read()
    except OSError:
        return
    after = new(before)
    write_atomic(out / name, after)
    if sha256(before) == files.get(name):
        write_atomic(out / LISTING, _listing({**files, name: sha256(after)}))


def _remove(path: Path, digest: str) -> bool:
    """Removes a file if it is what was written; returns False if it is there and another."""
    try:
        with open_plain(path) as file:
            same = sha256(file.read()) == digest
    except FileNotFoundError:
        return True
    except OSError:
        return False
    if same:
        remove([path])
    return same


def _listed(out: Path) -> dict[str, str]:
    """Returns the files of the report that is there, by the list that it has; none if it has none.

    A list may come from a stranger and say anything: names that lead elsewhere are no names.
    """
    try:
        with open_plain(out / LISTING) as file:
            listed = json.loads(file.read(_LARGEST_LISTING))["files"]
        return {
            name: digest
            for name, digest in listed.items()
            if isinstance(digest, str) and Path(name).name == name
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def _listing(files: Mapping[str, str]) -> bytes:
    said = "The files of the last report; jbench removes those that the next one does not have."
    return (json.dumps({"what": said, "files": dict(files)}, indent=1) + "\n").encode()
