"""Starts jbench commands on a terminal of their own, in which keys can be typed."""

import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios
import threading
from pathlib import Path

CTRL_C = b"\x03"


class OnTerminal:
    """A jbench command that is the foreground process of a pseudo-terminal."""

    def __init__(self, *arguments, cwd):
        """Starts the command in a new process, as a shell does."""
        self._keyboard, screen = pty.openpty()

        def take_terminal():
            fcntl.ioctl(0, termios.TIOCSCTTY, 0)
            # A background process of a script ignores it.
            signal.signal(signal.SIGINT, signal.SIG_DFL)

        self._process = subprocess.Popen(
            [sys.executable, "-m", "jbench", *map(str, arguments)],
            cwd=cwd,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            stdin=screen,
            stdout=screen,
            stderr=screen,
            start_new_session=True,
            preexec_fn=take_terminal,
        )
        os.close(screen)
        self.pid = self._process.pid
        self.poll = self._process.poll
        self._shown = bytearray()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for pid in self.processes():
            os.kill(pid, signal.SIGKILL)
        self._process.wait()
        self._reader.join()
        os.close(self._keyboard)

    def type(self, keys):
        """Types keys; those such as Ctrl-C reach every process of the command."""
        os.write(self._keyboard, keys)

    def ended(self, seconds=300):
        """Waits until the command ends; returns its exit code and all that was shown."""
        code = self._process.wait(seconds)
        self._reader.join(seconds)
        return code, self.communicate()[0]

    def communicate(self):
        """Returns what was shown so far, as `subprocess.Popen.communicate` does."""
        return self._shown.decode(errors="replace").replace("\r\n", "\n"), None

    def processes(self):
        """Returns the ids of the processes that were started on the terminal and have not ended."""
        found = []
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                about = (folder / "stat").read_text().rpartition(")")[2].split()
            except OSError:  # it has ended
                continue
            state, session = about[0], int(about[3])
            if session == self.pid and state != "Z":
                found.append(int(folder.name))
        return found

    def has_loaded(self, library):
        """Returns whether the command has loaded a shared library."""
        try:
            return library in Path(f"/proc/{self.pid}/maps").read_text()
        except OSError:  # it has ended
            return False

    def _read(self):
        """Keeps what is shown until all processes have closed the terminal."""
        while True:
            try:
                piece = os.read(self._keyboard, 4096)
            except OSError:  # Linux reports the end so
                return
            if not piece:
                return
            self._shown += piece
