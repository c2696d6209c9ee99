"""Collects datasets in processes that are repeatedly killed (SIGKILL) at random moments.

    python -m tests.datasets.killed_collections DIRECTORY KILLS

Prints a JSON document: the number of committed episodes at each kill, and the paths of the finished
collections, that of an uninterrupted one first.
"""

import json
import os
import random
import signal
import sys
import time
from pathlib import Path

from jbench.datasets import collect, fixed
from jbench.settings.records import DatasetSettings
from jbench.store import Results
from tests.short_episodes import shorten_episodes

# Two short episodes per file, so that most kills interrupt a write.
fixed.PART_EPISODES = 2
shorten_episodes(steps=20)
SETTINGS = DatasetSettings(seed=3, steps=30 * 20)


def begin(path: Path, threads: int) -> int:
    """Returns the id of a process that collects."""
    process = os.fork()
    if process == 0:
        try:
            collect(SETTINGS, Results(path), threads)
        except BaseException as error:
            print(repr(error), file=sys.stderr, flush=True)
            os._exit(1)
        os._exit(0)
    return process


def finished(process: int) -> bool:
    """Waits for a process; returns whether it ended without a kill, and so without an error."""
    _, status = os.waitpid(process, 0)
    code = os.waitstatus_to_exitcode(status)
    assert code in (0, -signal.SIGKILL), code
    return code == 0


def kill(process: int, path: Path, moments: random.Random) -> None:
    """Kills a process a random short time after a random number of new files."""
    expected = files(path) + moments.randrange(7)
    if_ended = os.WEXITED | os.WNOHANG | os.WNOWAIT
    while files(path) < expected and os.waitid(os.P_PID, process, if_ended) is None:
        time.sleep(0.001)
    time.sleep(moments.uniform(0, 0.03))
    os.kill(process, signal.SIGKILL)


def files(path: Path) -> int:
    return sum(1 for _ in path.rglob("*.parquet"))


def check(path: Path) -> int:
    """Reads all that a killed collection has committed; returns its number of episodes."""
    record = Results(path).find("dataset", SETTINGS.id)
    if record is None:
        return 0
    for entry in record.manifest.files:
        record.read_file(entry.name)
    return record.rows("dataset_episodes")


def main(directory: str, expected: int) -> None:
    root = Path(directory)
    paths = [root / "whole"]
    assert finished(begin(paths[0], 1))
    moments = random.Random(0)
    committed: list[int] = []
    while len(committed) < expected:
        paths.append(root / f"killed-{len(paths)}")
        before = 0
        while True:
            process = begin(paths[-1], moments.choice([1, 2, 3]))
            kill(process, paths[-1], moments)
            if finished(process):
                break
            committed.append(check(paths[-1]))
            assert committed[-1] >= before, "it started over"
            before = committed[-1]
    print(json.dumps({"committed": committed, "paths": [str(path) for path in paths]}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
