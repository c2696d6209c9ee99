"""Writes the files of a report, and removes those of an earlier report in the same directory.

`report.json` lists the files of the report with their SHA-256. A file is removed only if it is in
the list but not in the new report, and its content is unchanged. Files that someone else created or
changed are kept.
"""

import json
import re
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from jbench.store.files import open_plain, remove, sha256, write_atomic

LISTING = "report.json"

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
_MAX_LISTING = 1 << 22  # bytes
_WRITERS = 16  # files written at a time


def write(out: Path, contents: Mapping[str, bytes]) -> tuple[list[Path], list[str]]:
    """Writes the files of a report.

    Args:
        out: an existing directory.
        contents: content of each file by name.

    Returns:
        The files written, and a sentence on kept files of an earlier report, if any.

    Raises:
        WorkError: if writing fails, such as on a full disk.
    """
    before = _listed(out)
    new = {name: sha256(content) for name, content in contents.items()}
    # The list has the files of both reports until all are written, in case the process is killed.
    write_atomic(out / LISTING, _listing({**before, **new}))
    with ThreadPoolExecutor(_WRITERS) as pool:
        # Several at a time, because each one waits for the disk.
        list(pool.map(write_atomic, [out / name for name in contents], contents.values()))
    old = {name: digest for name, digest in before.items() if name not in new}
    changed = [name for name, digest in old.items() if not _remove(out / name, digest)]
    write_atomic(out / LISTING, _listing(new))
    notes = []
    if changed:
        names = ", ".join(sorted(changed))
        notes = [f"{names} in {out} belong to an earlier report, but were changed since; kept."]
    return [*(out / name for name in contents), out / LISTING], notes


def _remove(path: Path, digest: str) -> bool:
    """Removes a file if it is unchanged; returns False if it has changed."""
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
    """Returns the files in the list of the existing report, if it has one.

    The list is untrusted: names that no file of a report has, such as paths, are ignored.
    """
    try:
        with open_plain(out / LISTING) as file:
            listed = json.loads(file.read(_MAX_LISTING))["files"]
        return {
            name: digest
            for name, digest in listed.items()
            if isinstance(digest, str) and _NAME.fullmatch(name)
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def _listing(files: Mapping[str, str]) -> bytes:
    what = "The files of the last report; jbench removes those that the next one does not have."
    return (json.dumps({"what": what, "files": dict(files)}, indent=1) + "\n").encode()
