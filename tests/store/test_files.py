"""Tests of atomic writes: a file is complete or absent, and no temporary file remains."""

import pytest

from jbench.errors import WorkError
from jbench.store.files import write_atomic
from tests.store.store_rows import names

OLD, NEW = b"old" * 100, b"new" * 10_000


@pytest.mark.parametrize("before", [None, OLD, NEW * 2])
def test_write_replaces_file_and_leaves_no_temporary(tmp_path, before):
    path = tmp_path / "file"
    if before is not None:
        path.write_bytes(before)
    write_atomic(path, NEW)
    assert path.read_bytes() == NEW
    assert names(tmp_path) == {"file"}


def test_file_is_readable_by_other_users(tmp_path):
    write_atomic(tmp_path / "file", NEW)
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o644


def test_write_over_directory_is_refused_and_leaves_no_temporary(tmp_path):
    (tmp_path / "there").mkdir()
    with pytest.raises(WorkError, match="there can't be written"):
        write_atomic(tmp_path / "there", NEW)
    assert names(tmp_path) == {"there"}
