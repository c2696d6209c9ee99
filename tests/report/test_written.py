"""Files of an earlier report are removed; those of other programs are kept."""

import json

import pytest

from jbench.report.output_directory import LISTING, write


def names(out):
    return {path.name for path in out.iterdir()}


def test_files_that_the_new_report_does_not_have_are_removed(out):
    write(out, {"a.png": b"1", "b.png": b"2"})
    paths, notes = write(out, {"b.png": b"3", "c.png": b"4"})
    assert names(out) == {"b.png", "c.png", LISTING}
    assert sorted(paths) == sorted(out.iterdir())
    assert notes == []
    assert (out / "b.png").read_bytes() == b"3"


def test_what_is_not_ours_or_was_changed_is_left(out):
    write(out, {"a.png": b"1", "b.png": b"2", "gone.png": b"3"})
    (out / "notes.txt").write_text("mine")
    (out / "a.png").write_bytes(b"mine")
    (out / "gone.png").unlink()
    _, (note,) = write(out, {"c.png": b"4"})
    assert names(out) == {"a.png", "c.png", "notes.txt", LISTING}
    assert note.startswith("a.png in ")
    # It is left for good, and not reported again.
    assert write(out, {"c.png": b"4"})[1] == []


def test_a_report_without_a_list_loses_nothing(out):
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
    ],
)
def test_a_list_that_says_anything_harms_nothing(out, listing):
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
