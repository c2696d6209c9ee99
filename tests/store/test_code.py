"""What has changed between the recorded and the present code."""

import pytest

from jbench.store.code import changed_files, with_data_read

BEFORE = {"task.py": "1", "helper.py": "2", "goal.npy": "3"}


@pytest.mark.parametrize(
    ("now", "changed"),
    [
        ({}, []),
        ({"helper.py": "9"}, ["helper.py"]),
        ({"goal.npy": "9", "task.py": "9"}, ["goal.npy", "task.py"]),
        ({"goal.npy": None}, ["goal.npy (not found)"]),
        # The code does not name it any more.
        ({"goal.npy": None, "task.py": "9"}, ["goal.npy", "task.py"]),
        ({"helper.py": None, "task.py": "9"}, ["helper.py", "task.py"]),
        ({"other.csv": "4"}, ["other.csv"]),
    ],
)
def test_changed_files_are_named(now, changed):
    files = {name: value for name, value in {**BEFORE, **now}.items() if value is not None}
    assert changed_files({"sources": BEFORE}, {"sources": files}) == changed


def test_encoder_does_not_need_the_data_that_its_kind_has_read():
    before = {"sources": BEFORE}
    code = {"task.py": "1", "helper.py": "2"}
    assert with_data_read({"sources": code}, before) == before
    edited = with_data_read({"sources": {**code, "helper.py": "9"}}, before)
    assert changed_files(before, edited) == ["helper.py"]
    without_module = with_data_read({"sources": {"task.py": "1"}}, before)
    assert changed_files(before, without_module) == ["helper.py"]
    # Of code that is not here, nothing is known.
    assert with_data_read({}, before) == {}
