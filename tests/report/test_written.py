"""Tests of the output directory: files of an earlier report are removed, other files are kept."""

import json

import pytest

from jbench.errors import RequestError
from jbench.report import contents
from jbench.report.output_directory import LISTING, write
from jbench.report.report import write_report


def names(out):
    return {path.name for path in out.iterdir()}


def test_files_missing_from_new_report_are_removed(out):
    out.mkdir()
    write(out, {"a.png": b"1", "b.png": b"2"})
    paths, notes = write(out, {"b.png": b"3", "c.png": b"4"})
    assert names(out) == {"b.png", "c.png", LISTING}
    assert sorted(paths) == sorted(out.iterdir())
    assert notes == []
    assert (out / "b.png").read_bytes() == b"3"


def test_foreign_and_changed_files_are_kept(out):
    out.mkdir()
    write(out, {"a.png": b"1", "b.png": b"2", "gone.png": b"3"})
    (out / "notes.txt").write_text("mine")
    (out / "a.png").write_bytes(b"mine")
    (out / "gone.png").unlink()
    _, (note,) = write(out, {"c.png": b"4"})
    assert names(out) == {"a.png", "c.png", "notes.txt", LISTING}
    assert note.startswith("a.png in ")
    # The file is kept and not reported again.
    assert write(out, {"c.png": b"4"})[1] == []


def test_file_in_place_of_directory_is_refused_before_drawing(fabric, out, monkeypatch):
    fabric.run([500.0] * 4)
    out.write_text("mine")
    monkeypatch.setattr(contents, "document", None)  # calling it would be a TypeError
    with pytest.raises(RequestError, match="is a file, or lies in one; name a directory"):
        write_report(fabric.results, out)
    assert out.read_text() == "mine"


def test_report_without_listing_keeps_all_files(out):
    out.mkdir()
    (out / "figure9.png").write_bytes(b"of an older jbench")
    write(out, {"c.png": b"4"})
    assert names(out) == {"figure9.png", "c.png", LISTING}


@pytest.mark.parametrize(
    "listing",
    [
        "{",
        "[]",
        '{"files": []}',
        '{"files": {"../outside": 1}}',
        '{"files": {"../outside": "DIGEST", "..": "x", "link": "DIGEST"}}',
        '{"files": {"a\\u0000b": "x", "a\\ud800b": "x", "": "x"}}',
    ],
)
def test_invalid_or_hostile_listing_is_harmless(out, listing):
    digest = "6b86b273ff34fce19d6b804eff5a3f5747ada4eaa22f1d49c01e52ddb7875b4b"  # of "1"
    out.mkdir()
    outside = out.parent / "outside"
    outside.write_bytes(b"1")
    (out / "link").symlink_to(outside)
    (out / LISTING).write_text(listing.replace("DIGEST", digest))
    write(out, {"c.png": b"4"})
    assert outside.read_bytes() == b"1"
    assert (out / "link").is_symlink()
    assert list(json.loads((out / LISTING).read_text())["files"]) == ["c.png"]
