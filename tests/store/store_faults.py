"""Fault injection for child processes: dropped privileges, a full disk.

The kernel itself rejects each operation, also for root, whom file permissions do not restrict.
"""

import ctypes
import resource
import signal
import struct
import sys

import pytest

from jbench.cli import main
from tests.forking import Piped

PREAMBLE = """
import sys, time
from pathlib import Path
from tests.store import store_faults
from jbench.errors import RequestError, WorkError
from jbench.store import Record, Results, schema
from tests.store.store_rows import ROWS, numbers, read
results = Results(Path(sys.argv[1]))
"""

CANNOT = 77
"""Exit code of a process that could not inject its fault."""


class Script(Piped):
    """A child process that runs a script on a results directory."""

    def __init__(self, results, script, *arguments):
        """Starts it; `arguments` follow the directory on its command line."""
        typed = [str(results.path), *map(str, arguments)]
        super().__init__("tests.store.store_faults:execute", [script, typed])


def execute(script, arguments):
    """Runs a script in this process."""
    sys.argv = ["-c", *arguments]
    exec(PREAMBLE + script, {"__name__": "__main__"})  # noqa: S102


def run_script(results, script):
    """Runs a script on a results directory; returns the lines that it printed."""
    with Script(results, script) as process:
        lines = process.stdout.read().splitlines()
    if process.returncode == CANNOT:
        pytest.skip("this system can't be made to refuse")
    assert process.returncode == 0
    return lines


def drop_privileges():
    """Drops all capabilities, so that permissions also restrict a process of root."""
    version, this_process = 0x20080522, 0
    header = struct.pack("Ii", version, this_process)
    nothing = struct.pack("6I", *[0] * 6)
    if ctypes.CDLL(None, use_errno=True).capset(header, nothing):
        sys.exit(CANNOT)


def limit_file_size(largest):
    """Limits the size of files in bytes: a larger write fails as on a full disk."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))


def run_limited(largest, *arguments):
    """Runs a command with a limit on the size of files; returns its exit code."""
    limit_file_size(largest)
    return main([*arguments])
