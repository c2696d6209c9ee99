"""Tests of what is installed, which is read once."""

import os

from jbench import installed
from tests.test_plugins import GROUP, add_package


def test_what_is_installed_later_is_found(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    add_package(tmp_path, "one", "first = math:cos")
    os.utime(tmp_path, (0, 0))  # clocks of files may be too coarse for two changes in a row
    assert [point.name for point in installed.offered(GROUP)] == ["first"]
    assert "beside" not in installed.packages()

    add_package(tmp_path, "two", "second = math:sin")
    (tmp_path / "two-1.5.dist-info" / "top_level.txt").write_text("beside\n")
    assert {point.name for point in installed.offered(GROUP)} == {"first", "second"}
    assert installed.packages()["beside"] == ["two"]


def test_directory_in_which_nothing_is_installed_changes_nothing(tmp_path, monkeypatch):
    before = installed.packages()
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "module.py").write_text("")
    assert installed.packages() is before
    assert installed.offered(GROUP) == []
