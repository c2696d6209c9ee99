"""Tests of locks: looking at one refuses no writer, holding one does."""

import threading

import pytest

from jbench.errors import ElsewhereError
from jbench.store import locks


def test_looking_at_a_lock_refuses_no_writer(tmp_path):
    has_ended = threading.Event()

    def look():
        while not has_ended.is_set():
            locks.is_held(tmp_path)

    with locks.hold(tmp_path, "the run a"):
        assert locks.is_held(tmp_path)

    readers = [threading.Thread(target=look) for _ in range(2)]
    for reader in readers:
        reader.start()

    try:
        for _ in range(1000):
            with locks.hold(tmp_path, "the run a"):
                pass
    finally:
        has_ended.set()
        for reader in readers:
            reader.join()

    assert not locks.is_held(tmp_path)


def test_lock_of_a_writer_has_the_exit_code_of_work_that_is_done_elsewhere(tmp_path):
    sentence = "Another process is writing the run a; wait for it or stop it."
    with locks.hold(tmp_path, "the run a"), pytest.raises(ElsewhereError) as refused:  # noqa: SIM117
        with locks.hold(tmp_path, "the run a"):
            pass

    assert str(refused.value) == sentence
    assert refused.value.exit_code == 3
