"""Writes the report of a results directory: a page, a folder of figures and a folder of tables.

`report.json` lists the files of a report with their SHA-256. A file is removed only if it is in the
list but not in the next report, and its content is unchanged. Files that someone else created or
changed are kept.
"""

import contextlib
import gc
import io
import json
import re
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from jbench.names import LISTING, PAGE
from jbench.report.frames import DEFAULT, Frames
from jbench.report.latex import to_latex
from jbench.report.request import Request
from jbench.report.table import to_csv, to_markdown
from jbench.report.tables import for_paper, notes, tables
from jbench.store.database import Results
from jbench.store.files import make_directory, open_plain, remove, sha256, write_atomic

_NAME = re.compile(r"((figures|tables)/)?[A-Za-z0-9_][A-Za-z0-9_.-]*")
_MAX_LISTING = 1 << 22  # bytes
_GLYPH = re.compile(r"Glyph (\d+) ")
"""Beginning of matplotlib's warning of a character that a font lacks."""


class WrittenReport(NamedTuple):
    """A report that was written to a directory.

    Attributes:
        frames: what it shows.
        files: the written ones.
        notes: the sentences of the page, and one on files that were kept.
    """

    frames: Frames
    files: list[Path]
    notes: list[str]


def write_report(results: Results | None, out: Path, request: Request = DEFAULT) -> WrittenReport:
    """Aggregates all runs over their seeds and writes a page, figures and tables to a directory.

    Results are None if the request is on a file of curves.

    Raises:
        RequestError: if there are no runs, none passes the filters, or `out` is not writable.
        WorkError: if there are runs but none can be read, or the disk is full.
    """
    gc.disable()  # which takes 5 to 8% of the time of 200 runs and frees nearly nothing

    try:
        frames = Frames(results, request)
        on_page = notes(frames)  # before anything is written, since it may raise an error
        pa.default_memory_pool().release_unused()  # memory of the rows that were read
        make_directory(out, "--out")  # before anything is drawn, since it may raise an error
        with _missing_characters() as missing:
            files = _contents(frames)
        paths, kept = _write(out, files)
    finally:
        gc.enable()

    boxes = []
    if missing and not request.watched:
        characters = " ".join(sorted(missing))
        boxes = [f"The font of the figures' files lacks {characters}, which are boxes there."]
    return WrittenReport(frames, paths, [*on_page, *boxes, *kept])


def _contents(frames: Frames) -> dict[str, bytes]:
    """Returns the content of each file, by its name."""
    from jbench.report.figures import charts  # matplotlib takes a second
    from jbench.report.page import render
    from jbench.report.style import image

    request = frames.request
    texts = {} if request.watched else dict(table_files(frames))
    made = charts(frames)
    files = {PAGE: render(frames, made).encode()}
    if request.watched:
        return files

    for chart in made:
        drawn = chart.figure(request.columns)
        for ending in request.formats:
            files[f"figures/{chart.name}.{ending}"] = image(drawn, ending)

    for name, text in texts.items():
        files[f"tables/{name}"] = text.encode()

    curves = pa.Table.from_pandas(frames.curves, preserve_index=False, nthreads=1)
    sink = io.BytesIO()
    pq.write_table(curves, sink, compression="zstd")
    files["tables/curves.parquet"] = sink.getvalue()
    return files


@contextlib.contextmanager
def _missing_characters() -> Iterator[set[str]]:
    """Yields a set that has in the end the characters that a font lacks, of which matplotlib warns.

    Other warnings are shown at the end.
    """
    missing: set[str] = set()
    with warnings.catch_warnings(record=True) as caught:
        warnings.filterwarnings("always", _GLYPH.pattern)
        yield missing

    for one in caught:
        if match := _GLYPH.match(str(one.message)):
            missing.add(chr(int(match[1])))
        else:
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)


def table_files(frames: Frames) -> Iterator[tuple[str, str]]:
    """Yields the name and the text of each file of tables."""
    for table in tables(frames):
        numbers = table.frame.drop(columns=["settings", "provenance"], errors="ignore")
        yield f"{table.name}.csv", to_csv(table.frame if table.name == "encoders" else numbers)
        for ending, write in (("md", to_markdown), ("tex", to_latex)):
            if table.name != "runs":
                shown = for_paper(table, frames) if ending == "tex" else table
                yield f"{table.name}.{ending}", write(shown)

    for name in (
        "configurations",
        "seeds",
        "curves",
        "published",
        "baselines",
        "pairs",
        "profiles",
        "predictions",
        "kept",
        "processor",
        "motor",
        "positions",
        "sequences",
    ):  # frames of figures
        frame = getattr(frames, name)
        if len(frame):
            yield f"{name}.csv", to_csv(frame)


def _write(out: Path, contents: Mapping[str, bytes]) -> tuple[list[Path], list[str]]:
    """Writes files, removes those of an earlier report; returns them, and a note on kept ones."""
    before = _listed(out)
    new = {name: sha256(content) for name, content in contents.items()}
    # The list has the files of both reports until all are written, in case the process is killed.
    write_atomic(out / LISTING, _listing({**before, **new}))
    for folder in {name.partition("/")[0] for name in new if "/" in name}:
        make_directory(out / folder, "--out")

    for name, content in contents.items():
        write_atomic(out / name, content)

    changed = [name for name in before.keys() - new if not _remove(out / name, before[name])]
    write_atomic(out / LISTING, _listing(new))
    kept = f"{', '.join(sorted(changed))} in {out} belong to an earlier report, but were changed"
    notes = [f"{kept} since; kept."] if changed else []
    return [*(out / name for name in contents), out / LISTING], notes


def _remove(path: Path, digest: str) -> bool:
    """Removes a file unless it has changed; returns whether it is gone."""
    try:
        with open_plain(path) as file:
            same = sha256(file.read()) == digest
    except OSError as error:
        return isinstance(error, FileNotFoundError)
    remove([path] if same else [])
    return same


def _listed(out: Path) -> dict[str, str]:
    """Returns the files in an existing report's list, without names that no file of one has."""
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
    """Returns the content of the list of files: the SHA-256 of each."""
    what = "The files of the last report; jbench removes those that the next one does not have."
    return (json.dumps({"what": what, "files": dict(files)}, indent=1) + "\n").encode()
