"""Makes the k-th open, write, rename or other system call below a directory fail.

Python calls an audit hook before each `open`, `mkdir`, `rename`, `link`, `unlink`, `flock` and
listing of a directory, and the hook may raise; `read`, `write`, `fsync` and `close` are wrapped.
This needs no compiler, ptrace or privileges. Files that C++ and Rust code opens are not seen;
jbench reads and writes results only through Python's files.
"""

import errno
import fcntl
import io
import mmap
import os
import struct
import sys
from pathlib import Path
from typing import NamedTuple

CALLS = (
    "open",
    "write",
    "fsync",
    "rename",
    "link",
    "flock",
    "unlink",
    "mkdir",
    "listdir",
    "read",
    "close",
)
"""The calls that can fail. `open` includes temporary files and locks."""

_EVENTS = {
    "open": "open",
    "os.rename": "rename",
    "os.link": "link",
    "os.remove": "unlink",
    "os.mkdir": "mkdir",
    "os.listdir": "listdir",
    "os.scandir": "listdir",
    "fcntl.flock": "flock",
}


class Fault(NamedTuple):
    """The `number`-th call of a kind, counted from 1 over a command and its workers, that fails.

    With `lasting`, all later calls of this kind fail as well, as on a disk that stays full.
    """

    call: str
    number: int
    code: int
    lasting: bool = False

    def __str__(self):
        more = " and all after it" if self.lasting else ""
        return f"{self.call} {self.number}{more}: {errno.errorcode[self.code]}"


class Injector:
    """Counts the calls below a directory and makes one fail, in this process and its children."""

    def __init__(self, root, fault=None):
        """Installs the hooks in this process, permanently; calls outside of `root` do not fail."""
        self._root, self._fault = str(Path(root).resolve()), fault
        # Shared with the processes that are forked from this one.
        self._counts = mmap.mmap(-1, 8 * len(CALLS))
        self._os = {name: getattr(os, name) for name in ("fsync", "fdopen", "close")}
        os.fsync, os.fdopen, os.close = self._fsync, self._fdopen, self._close
        sys.addaudithook(self._audit)

    def counts(self):
        """Returns how often each call was made."""
        return dict(zip(CALLS, struct.unpack(f"{len(CALLS)}q", self._counts[:]), strict=True))

    def check(self, call, path):
        """Counts a call; raises the error if it is the one that fails."""
        if not self._is_below(path):
            return
        offset = 8 * CALLS.index(call)
        number = struct.unpack_from("q", self._counts, offset)[0] + 1
        struct.pack_into("q", self._counts, offset, number)
        fault = self._fault
        if fault is None or fault.call != call:
            return
        if number == fault.number or (fault.lasting and number > fault.number):
            raise OSError(fault.code, os.strerror(fault.code), str(path))

    def _is_below(self, path):
        if isinstance(path, int):
            try:
                path = os.readlink(f"/proc/self/fd/{path}")
            except OSError:
                return False
        path = os.path.abspath(os.fsdecode(path))
        return path == self._root or path.startswith(self._root + os.sep)

    def _audit(self, event, arguments):
        call = _EVENTS.get(event)
        # A descriptor in an event of `open` is a file that was opened, and counted, before.
        if call is None or (call == "open" and not isinstance(arguments[0], str | bytes | Path)):
            return
        if call == "flock" and arguments[1] & fcntl.LOCK_UN:
            return
        self.check(call, arguments[0])

    def _fsync(self, handle):
        self.check("fsync", handle)
        self._os["fsync"](handle)

    def _close(self, handle):
        below = self._is_below(handle)
        path = os.readlink(f"/proc/self/fd/{handle}") if below else None
        self._os["close"](handle)
        if below:
            self.check("close", path)

    def _fdopen(self, handle, mode="r", *more, **options):
        if mode not in ("rb", "wb") or not self._is_below(handle):
            return self._os["fdopen"](handle, mode, *more, **options)
        raw = _File(self, handle, mode, **options)
        return io.BufferedReader(raw) if mode == "rb" else io.BufferedWriter(raw)


class _File(io.FileIO):
    """A file whose reading, writing and closing may fail; a failing write leaves half its bytes."""

    def __init__(self, injector, handle, mode, closefd=True):
        super().__init__(handle, mode, closefd)
        self._injector = injector
        self._path = os.readlink(f"/proc/self/fd/{handle}")

    def write(self, content):
        try:
            self._injector.check("write", self._path)
        except OSError:
            super().write(memoryview(content)[: len(content) // 2])
            raise
        return super().write(content)

    def readinto(self, buffer):
        self._injector.check("read", self._path)
        return super().readinto(buffer)

    def readall(self):
        self._injector.check("read", self._path)
        return super().readall()

    def close(self):
        was_open = not self.closed and self.closefd
        super().close()
        if was_open:
            self._injector.check("close", self._path)
