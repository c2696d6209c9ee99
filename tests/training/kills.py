"""Trains a small batch of runs and kills it (SIGKILL) repeatedly until it has finished.

    python -m tests.training.kills '{"path": DIR, "runs": […], "at": "random", "kills": 20}'

DIR/whole holds the batch trained without kills; DIR/0, DIR/1 … hold batches with kills. Each
attempt is a fork of this process, which has imported all modules but started no thread. With
"at": "random" the parent kills it a random short time after a random number of further episodes,
in one directory after another, until the number of kills is reached. With "at": "writes" attempt n
kills itself at its n-th write point (with "every": m at point 1 + (n - 1) m) until one finishes.
Write points are before, within and after each write, and before and after each fsync and rename of
`jbench/store/files.py`, which does all writing. With "encoder": n the runs have an encoder of n
latents. With "shorter": n the runs with kills continue runs of n control steps, which are trained
without kills.

Episodes have 50 control steps, so that many are completed per second.

Prints JSON: {"kills": n, "folders": n, "steps": for each folder, after each kill, the control steps
of every run's last checkpoint, "problems": the findings of `jbench verify` after each kill}.
"""

import json
import os
import random
import signal
import sys
import time
import traceback
from pathlib import Path

import torch

from jbench.settings.run import RunSettings
from jbench.store import Results, files
from jbench.store.verify import verify
from jbench.training import batched_run
from jbench.training.batched_run import run_batch
from jbench.training.checkpoints import load
from tests.short_episodes import shorten_episodes
from tests.training.small_runs import TanhEncoder


class KillingModule:
    """Wraps `os`, and kills this process at one of the write points."""

    def __init__(self, at):
        self._left = at

    def __getattr__(self, name):
        return getattr(os, name)

    def point(self):
        self._left -= 1
        if self._left == 0:
            os.kill(os.getpid(), signal.SIGKILL)

    def fsync(self, handle):
        self.point()
        os.fsync(handle)
        self.point()

    def replace(self, source, target):
        self.point()
        os.replace(source, target)
        self.point()

    def fdopen(self, handle, mode, closefd):
        file = os.fdopen(handle, mode, 0 if mode == "wb" else -1, closefd=closefd)
        return KillingFile(file, self.point) if mode == "wb" else file


class KillingFile:
    """Wraps a file, and kills this process at one of the write points."""

    def __init__(self, file, point):
        self._file, self._point = file, point

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._file.close()

    def write(self, content):
        half = len(content) // 2
        for part in (content[:half], content[half:]):
            self._point()
            self._file.write(part)
        self._point()


class Killer:
    """Trains the batch of a request, with and without kills."""

    def __init__(self, request):
        self._path, self._at = Path(request["path"]), request["at"]
        self._wanted, self._every = request.get("kills", 0), request.get("every", 1)
        self._runs = [RunSettings(**run) for run in request["runs"]]
        shorter = request.get("shorter")
        self._shorter = [run.model_copy(update={"steps": shorter}) for run in self._runs if shorter]
        self._encoder = TanhEncoder(request["encoder"]) if request.get("encoder") else None
        self._draw = random.Random(0)
        self.kills, self.steps, self.problems = 0, [], []

    def whole(self):
        """Trains the batch without kills."""
        assert self._end(self._fork(self._path / "whole")) == 0

    def until_done(self, folder):
        path = self._path / folder
        self.steps.append([])
        if self._shorter:
            assert self._end(self._fork(path, runs=self._shorter, keep_state="whole")) == 0
        while True:
            if self._at == "writes":
                process = self._fork(path, self.kills * self._every + 1)
            else:
                process = self._fork(path)
                if self.kills < self._wanted:
                    self._kill(process, path)
            code = self._end(process)
            if code is not None:
                assert code == 0, code
                return
            self.kills += 1
            results = Results(path)
            self.steps[-1].append([committed_steps(run, results) for run in self._runs])
            findings = verify(results, 1).findings
            self.problems += [str(finding) for finding in findings if finding.sort == "damaged"]

    def _fork(self, path, write_point=None, runs=None, keep_state="no"):
        process = os.fork()
        if process:
            return process
        code = 1
        try:
            if self._encoder is not None:
                batched_run.load_run_encoder = lambda *_: self._encoder
            if write_point is not None:
                files.os = KillingModule(write_point)
            failures = run_batch(
                runs or self._runs, Results(path), checkpoint_every=0, keep_state=keep_state
            )
            code = 3 if failures else 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)

    def _kill(self, process, path):
        """Kills a process a random short time after a random number of further episodes."""
        wanted = self._episodes(path) + self._draw.randrange(2 * len(self._runs) + 1)
        if_ended = os.WEXITED | os.WNOHANG | os.WNOWAIT
        while self._episodes(path) < wanted and os.waitid(os.P_PID, process, if_ended) is None:
            time.sleep(0.002)
        time.sleep(self._draw.uniform(0, 0.03))
        os.kill(process, signal.SIGKILL)

    def _episodes(self, path):
        """Returns the number of committed episodes of all runs."""
        records = [Results(path).find("run", run.id) for run in self._runs]
        return sum(record.rows("episodes") for record in records if record is not None)

    def _end(self, process):
        """Waits for a process; returns its exit code, or None if it was killed."""
        _, status = os.waitpid(process, 0)
        return None if os.WIFSIGNALED(status) else os.waitstatus_to_exitcode(status)


def committed_steps(run, results):
    """Returns the control steps of a run's last checkpoint; a finished one has all."""
    record = results.find("run", run.id)
    if record is None:
        return 0
    if record.status == "finished":
        return run.steps
    checkpoint, refused = load(record)
    assert not refused
    return 0 if checkpoint is None else checkpoint.position.control_steps


def main(request):
    torch.set_num_threads(1)
    shorten_episodes()
    killer = Killer(request)
    killer.whole()
    folders = 0
    while folders == 0 or (request["at"] == "random" and killer.kills < request["kills"]):
        killer.until_done(str(folders))
        folders += 1
    answer = {"kills": killer.kills, "folders": folders}
    print(json.dumps({**answer, "steps": killer.steps, "problems": killer.problems}))


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
