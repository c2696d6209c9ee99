"""Writing an archive: records without checkpoints, a report of them, what repeats them, one zip."""

import io
import re
import tempfile
import zipfile
from collections.abc import Iterator, Mapping, Set
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet as pq

from jbench import __version__
from jbench.archive.blind import Blinder, Form, Verbatim
from jbench.archive.requirements import requirements_text
from jbench.archive.words import found_in, words_of_this_machine
from jbench.errors import RequestError, WorkError
from jbench.report.report import write_report
from jbench.report.request import Request
from jbench.revision import git_revision
from jbench.store import Record, Results, files
from jbench.store.manifest import RecordKind
from jbench.store.verify import verify
from jbench.studies.rebuilt_matrix import matrix_text
from jbench.wording import counted

_KINDS: tuple[RecordKind, ...] = ("encoder", "run", "evaluation", "import")
"""Kinds in an archive, those that others refer to first. Datasets are left out: encoders have
what they learned."""

_EPOCH = (1980, 1, 1, 0, 0, 0)  # the time of every entry

_README = """\
A results directory of jbench, a report of it, and what repeats it.

Written by jbench {version}. Install it from a checkout (pip install .) or from its wheel.

    pip install -r requirements.txt     the packages that it needs, in the same versions
    jbench verify --results results     every file against its checksum
    jbench report --results results     the report, made again; the original is report/index.html
    jbench sweep matrix.toml            trains these runs

{runs}; failed or left out: {missing}.
"""


class Archived(NamedTuple):
    """What an archive has: numbers of records and bytes, and the records that are left out."""

    path: Path
    records: int
    bytes: int
    left_out: list[str]


_ELEMENT = re.compile(r"</?[A-Za-z][\w:.-]*")
"""The name of an element of XML or HTML, such as cc:Work, which names nobody."""


def write_archive(results: Results, out: Path, blind: bool = False) -> Archived:
    """Writes a zip file with the finished and failed records of results; see `_README`.

    If `blind`, without names; see `blind.py`.

    Raises:
        RequestError: if there are no runs, or `out` can't be written.
        WorkError: if a record is damaged, or a name is left in a blind archive.
    """
    files.check_output(out)
    selection = _selection(results)
    records = selection.records
    left_out = selection.left_out
    if not any(record.kind in ("run", "import") for record in records):
        raise RequestError(f"{results.name} has no finished run; train or import some first.")

    form: Form = Verbatim()
    if blind:
        form = Blinder(words_of_this_machine(results.path, out))

    form.learn([*records, *left_out])
    with tempfile.TemporaryDirectory(prefix="jbench-archive-") as folder:
        root = Path(folder)
        target = Results(root / "results", Path("results"))
        for record in records:
            _copy(record, target, form)

        faults = verify(target, 1).faults
        if faults:
            raise WorkError(f"The archive would be damaged: {faults[0]}")

        write_report(target, root / "report", Request(claims=_has_claims(records)))
        datasets = settings_of_datasets(results, form)
        _write_texts(root, target, _lines(left_out, form), datasets, _version(blind))
        content = _zipped(root)

    for entry, word in leaks(content, form.words):
        raise WorkError(
            f"The archive would have the word {word!r}, which names something of yours (a "
            f"module, a path, a host, a user), in {entry}; nothing is written. Rename what has "
            "it, or leave the record out."
        )

    files.write_atomic(out, content)
    return Archived(out, len(records), len(content), _lines(left_out, Verbatim()))


class _Selection(NamedTuple):
    """The records of an archive, and the unfinished ones, which are left out."""

    records: list[Record]
    left_out: list[Record]


def _selection(results: Results) -> _Selection:
    """Returns which records of results an archive has; a WorkError if one can't be read."""
    selection = _Selection([], [])
    for kind in _KINDS:
        records, problems = results.scan(kind)
        if problems:
            raise WorkError(problems[0])
        for record in records:
            if record.status == "unfinished":
                selection.left_out.append(record)
            else:
                selection.records.append(record)

    return selection


def _lines(left_out: list[Record], form: Form) -> list[str]:
    """Returns a line for each record that is left out."""
    return [f"{record.kind} {form.id(record)}: unfinished" for record in left_out]


def _has_claims(records: list[Record]) -> bool:
    """Returns whether there are runs, without which no claim can be tested."""
    return any(record.kind == "run" for record in records)


def _copy(record: Record, target: Results, form: Form) -> None:
    """Copies a record without its checkpoints."""
    copied = target.folder(record.kind, form.id(record))
    files.make_directory(copied.path)
    entries = []
    for entry in record.manifest.files:
        if entry.role is not None:
            continue

        content = form.content(record, entry, record.read_file(entry.name))
        digest = files.sha256(content)
        name = entry.name.replace(entry.sha256[:8], digest[:8])
        files.write_atomic(copied.path / name, content)
        changes = {"name": name, "bytes": len(content), "sha256": digest}
        entries.append(entry.model_copy(update=changes))

    Record.begin(copied, form.manifest(record, tuple(entries)))


def settings_of_datasets(results: Results, form: Form) -> dict[str, Any]:
    """Returns the settings of datasets by id, as encoders in the archive call it.

    An archive has no datasets, but its matrix makes them again.
    """
    datasets, _ = results.scan("dataset")
    return {form.settings({"dataset": each.id})["dataset"]: each.settings for each in datasets}


def _version(blind: bool) -> str:
    """Returns the version of jbench and, unless it may name a user's branch, its git revision."""
    revision = git_revision()
    if blind or revision is None:
        return __version__
    return f"{__version__} (git revision {revision})"


def _write_texts(
    root: Path, target: Results, left_out: list[str], datasets: Mapping[str, Any], version: str
) -> None:
    """Writes the README, the matrix that trains the runs again, and the versions of packages.

    Args:
        root: directory of the archive.
        target: its records.
        left_out: a line for each record that it does not have.
        datasets: settings of the datasets of its encoders, by id.
        version: of jbench.
    """
    runs = target.scan("run")[0]
    encoders = {record.id: record.settings for record in target.scan("encoder")[0]}
    failed = [f"run {run.id}: failed" for run in runs if run.status == "failed"]
    missing = "; ".join([*failed, *left_out]) or "none"
    text = _README.format(version=version, runs=counted(len(runs), "run"), missing=missing)
    texts = {
        "README.txt": text,
        "matrix.toml": matrix_text([run.settings for run in runs], encoders, datasets),
        "requirements.txt": requirements_text(),
    }
    for name, content in texts.items():
        (root / name).write_text(content, encoding="utf-8")


def _zipped(root: Path) -> bytes:
    """Returns a zip file whose entries have no time, owner or system."""
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w") as archive:
        for path in sorted(root.rglob("*")):
            if path.is_file():
                entry = zipfile.ZipInfo(path.relative_to(root).as_posix(), _EPOCH)
                entry.external_attr = 0o644 << 16
                entry.create_system = 3
                entry.compress_type = zipfile.ZIP_DEFLATED
                if path.suffix == ".parquet":  # compressed already
                    entry.compress_type = zipfile.ZIP_STORED
                archive.writestr(entry, path.read_bytes())

    return sink.getvalue()


def leaks(archive: bytes, words: Set[str]) -> Iterator[tuple[str, str]]:
    """Yields entries and the words that they have, in their names, texts, columns and metadata."""
    if not words:
        return

    with zipfile.ZipFile(io.BytesIO(archive)) as content:
        for entry in content.infolist():
            text = "\n".join((entry.filename, *_texts(entry.filename, content.read(entry))))
            for word in found_in(sorted(words), text):
                yield entry.filename, word


def _texts(name: str, content: bytes) -> Iterator[str]:
    """Yields all texts of a file, decompressed; those of a page or drawing without its markup."""
    for text in (content.decode("latin-1"), content.decode(errors="replace")):
        if name.endswith((".svg", ".html")):
            text = _ELEMENT.sub("<", text)
        yield text

    if name.endswith(".parquet"):
        rows = pq.ParquetFile(io.BytesIO(content))
        yield str(rows.schema_arrow.metadata)
        yield from (str(field.metadata) for field in rows.schema_arrow)
        yield str(rows.read(use_threads=False).to_pydict())

    if name.endswith(".png"):
        from PIL import Image

        with Image.open(io.BytesIO(content)) as picture:
            yield str(picture.info)
