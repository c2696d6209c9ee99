"""Types the verbs of jbench with a failing system call, and checks what is left.

    python tests/faults/fault_harness.py '{"verbs": {"collect": 8, "merge": null}}'

A number is that of faults drawn at random, null stands for all. "every_error": true tries each call
with each error, and "calls": [...] names the kinds of calls that fail.

For each verb that writes, one run without a fault counts its calls below the results directory.
Then, for the k-th call of each kind and each errno (or one errno, in turn), the verb starts from
the same results, meets that fault, and what it says and leaves is checked; see `problems`. Each
command is a process of its own, forked from this one, which has imported everything; so are the
workers that a verb starts. Episodes have 20 control steps.

It prints a JSON line for each case: {"verb", "call", "fault", "code", "problems"}.
"""

import contextlib
import errno
import gc
import hashlib
import importlib
import json
import os
import pkgutil
import random
import re
import shutil
import signal
import sys
import tempfile
import traceback
from pathlib import Path
from typing import NamedTuple

import short_episodes  # isort: skip  # noqa: F401 - before anything else has a copy of it

import pyarrow as pa
import torch
from fault_injection import CALLS, Fault, Injector

import jbench
from jbench.cli import main
from jbench.errors import WorkError
from jbench.store import Results
from jbench.store.manifest import KINDS
from jbench.store.merge import TIMES
from jbench.sweeps import executors
from jbench.training import speed, worker

LASTING = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
"""Errors that stay: each is tried once alone, and once with all later calls failing as well."""

ERRORS = (*LASTING, errno.EIO, errno.EMFILE)

SMALL = ("--set", "hidden_layers=[4]", "--set", "batch_size=4")
OFF_POLICY = ("--set", "learning_starts=20", "--set", "train_freq=10", "--set", "gradient_steps=1")
TRAIN = (
    *("train", "--algo", "td3", "--seeds", "0", "--steps", "60", "--jobs", "1"),
    *("--evaluate-every", "40", "--evaluate-episodes", "1", "--checkpoint-every", "0"),
    *SMALL,
    *OFF_POLICY,
)
RETRY = ("--retry-failed",)
COLLECT = ("collect", "--steps", "160", "--threads", "1")
TRAIN_DAE = ("train-dae", "--latent", "2", "--epochs", "2", "--batch", "64", "--device", "cpu")
EVALUATE = ("evaluate", "--episodes", "2", "--threads", "1")
SWEEP = """
tasks = ["face_direction"]
algos = ["td3"]
representations = ["full", "pca2"]
seeds = "0"
steps = 40

[evaluation]
every = 40
episodes = 1

[dataset]
steps = 160

[hyperparameters.td3]
hidden_layers = [4]
batch_size = 4
learning_starts = 20
train_freq = 10
gradient_steps = 1
"""


class Verb(NamedTuple):
    """A verb to try.

    Attributes:
        command: as it is typed, but for --results; `resume` is `train` that finds a checkpoint.
        before: what makes the results that it starts from: commands, or a function of their path.
        again: options that are added when it is typed again after a fault.
    """

    command: tuple[str, ...]
    before: tuple = ()
    again: tuple[str, ...] = ()


def resumable(path):
    """A training that stopped at a full disk, with a checkpoint to resume from."""
    assert typed(TRAIN, path, Fault("rename", 12, errno.ENOSPC, lasting=True)).code == 1
    assert list(path.rglob("checkpoint-*")), "the training has no checkpoint to resume from"


def another_machine(path):
    """Results to merge, and an unfinished run that theirs replaces."""
    for command in (COLLECT, EVALUATE, TRAIN):
        assert typed(command, path).code == 0
    path.rename(path.parent / "other")
    path.mkdir()
    (path.parent / "other").rename(path / "other")
    resumable(path)


def broken(path):
    """A damaged run, a record with leftovers beside its lock, and an intact one."""
    for command in (COLLECT, TRAIN, EVALUATE):
        assert typed(command, path).code == 0
    damaged = next((path / "runs").rglob("episodes-*.parquet"))
    damaged.write_bytes(damaged.read_bytes()[:-1])
    record = next((path / "evaluations").rglob("manifest.json")).parent
    assert (record / "lock").exists()
    (record / "policy_episodes-00009-12345678.parquet").write_bytes(b"left")


VERBS = {
    "collect": Verb(COLLECT),
    "train-dae": Verb(TRAIN_DAE, (COLLECT,)),
    "train-encoder": Verb(("train-encoder", "--kind", "pca", "--latent", "2"), (COLLECT,)),
    "train": Verb(TRAIN, again=RETRY),
    "resume": Verb((*TRAIN, *RETRY), (resumable,)),
    "sweep": Verb(
        ("sweep", "{path}/../small.toml", "--jobs", "1", "--checkpoint-every", "0"), again=RETRY
    ),
    "evaluate": Verb(EVALUATE),
    "merge": Verb(("merge", "{path}/other"), (another_machine,)),
    "repair": Verb(("repair", "--threads", "1"), (broken,)),
    "export": Verb(("export", "--out", "{path}/minari"), (COLLECT,)),
    "report": Verb(("report", "--window", "2", "--format", "svg"), (TRAIN,)),
}


class Ended(NamedTuple):
    """How a command ended: its exit code, what it said, and how often it made each call."""

    code: int
    said: str
    counts: dict


class ForkedWorker:
    """Stands in for `subprocess.Popen`: a worker forked from this process, with all its imports."""

    def __init__(self, command, **_):
        to_read, stdin = os.pipe()
        stdout, to_write = os.pipe()
        self.pid, self.returncode = os.fork(), None
        if self.pid == 0:
            _become(to_read, to_write, (stdin, stdout), command[3:])
        os.close(to_read)
        os.close(to_write)
        self.stdin, self.stdout = os.fdopen(stdin, "w"), os.fdopen(stdout)

    def poll(self):
        if self.returncode is None and os.waitpid(self.pid, os.WNOHANG)[0]:
            self.returncode = 0
        return self.returncode

    def wait(self):
        if self.returncode is None:
            _, status = os.waitpid(self.pid, 0)
            self.returncode = os.waitstatus_to_exitcode(status)
        for stream in (self.stdin, self.stdout):
            with contextlib.suppress(OSError):
                stream.close()
        return self.returncode

    def kill(self):
        if self.returncode is None:
            os.kill(self.pid, signal.SIGKILL)


def _become(stdin, stdout, others, arguments):
    """Becomes a worker with these descriptors; does not return."""
    code = 1
    try:
        os.dup2(stdin, 0)
        os.dup2(stdout, 1)
        for handle in (*others, stdin, stdout):
            os.close(handle)
        sys.stdin, sys.stdout = os.fdopen(0, closefd=False), os.fdopen(1, "w", closefd=False)
        code = worker.main(*arguments)
        sys.stdout.flush()
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)


def typed(command, path, fault=None):
    """Types a command in a process of its own, with a failing call or without."""
    with tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as counted:
        process = os.fork()
        if process == 0:
            _type(command, path, fault, said.fileno(), counted.fileno())
        _, status = os.waitpid(process, 0)
        said.seek(0)
        counted.seek(0)
        counts = json.loads(counted.read() or b"{}")
        return Ended(os.waitstatus_to_exitcode(status), said.read().decode(), counts)


def _type(command, path, fault, said, counted):
    """Types a command in this process, which ends."""
    code = 70
    try:
        os.dup2(said, 1)
        os.dup2(said, 2)
        sys.stdout, sys.stderr = (os.fdopen(n, "w", 1, closefd=False) for n in (1, 2))
        arguments = [word.format(path=path) for word in command]
        sys.argv = ["jbench", *arguments]
        injector = Injector(path, fault)
        code = main([*arguments, "--results", str(path)])
        os.write(counted, json.dumps(injector.counts()).encode())
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def content(path):
    """Returns the content of results without times: by record, its status and digests.

    Of a report and an export it has the names of the files, of files set aside the digests.
    """
    found = {}
    results = Results(path)
    for kind in KINDS:
        records, unreadable = results.scan(kind)
        found[kind] = unreadable
        for record in records:
            tables = dict.fromkeys(e.table for e in record.manifest.files if e.table)
            found[f"{kind} {record.id}"] = [
                record.status,
                {table: _digest(record, table) for table in tables},
                {e.name: e.sha256 for e in record.manifest.files if not e.table},
            ]
    report = path / "report"
    found["report"] = sorted(file.name for file in report.glob("*"))
    found["exported"] = sorted(str(file.relative_to(path)) for file in (path / "minari").rglob("*"))
    found["set aside"] = sorted(
        hashlib.sha256(file.read_bytes()).hexdigest()
        for file in path.glob("set-aside/**/*")
        if file.is_file()
    )
    return json.loads(json.dumps(found))


def _digest(record, table):
    rows = pa.concat_tables([record.rows_of(entry) for entry in record.parts(table)])
    rows = rows.drop_columns([name for name in TIMES if name in rows.column_names])
    return hashlib.sha256(repr(rows.to_pylist()).encode()).hexdigest()


def problems(verb, fault, ended, path, expected):
    """Yields a sentence for each promise that a verb broke when it met a fault.

    Args:
        verb: that was typed.
        fault: that it met.
        ended: how it ended.
        path: of the results, which change: the command is typed again.
        expected: `content` of results that no fault disturbed.
    """
    errors = [line for line in ended.said.splitlines() if line.startswith("Error: ")]
    if "Traceback" in ended.said or ended.code not in (0, 1, 2):
        yield f"exit code {ended.code}: {ended.said[-1500:]}"
    elif len(errors) != (ended.code != 0):
        yield f"exit code {ended.code} with {len(errors)} sentences: {ended.said[-500:]}"
    first = typed(("verify", "--threads", "1"), path)
    wrong = [line for line in first.said.splitlines() if line.startswith("  ")]
    damaged = [line for line in wrong if "is listed by no manifest" not in line]
    if damaged and verb != "repair":
        yield f"verify: {damaged}"
    command = VERBS[verb].command + (VERBS[verb].again if ended.code else ())
    again = typed(command, path)
    exists = verb == "export" and ended.code == 0  # and is not overwritten
    if again.code != (2 if exists else 0):
        yield f"typed again, exit code {again.code}: {again.said[-1500:]}"
    after = typed(("verify", "--threads", "1"), path)
    if after.code != 0:
        yield f"verify, after the command was typed again: {after.said}"
    try:
        found = content(path)
    except WorkError as error:
        yield f"typed again, the results can't be read: {error}"
        return
    if verb == "merge":  # what was replaced before the fault is set aside by the second merge too
        found["set aside"] = expected["set aside"] = []
    differences = [name for name in {**found, **expected} if found.get(name) != expected.get(name)]
    if differences:
        yield f"typed again, other content than without a fault: {differences}"


def faults(counts, calls, every_error):
    """Returns the faults of a verb with these counts of calls: one per call, or one per error."""
    made = []
    for call in calls:
        codes = {"read": (errno.EIO,), "close": (errno.EINTR,)}.get(call, ERRORS)
        for number in range(1, counts[call] + 1):
            each = [Fault(call, number, code) for code in codes]
            if len(codes) > 1:
                each += [Fault(call, number, code, lasting=True) for code in LASTING]
            made += each if every_error else [each[number % len(each)]]
    return made


def prepared(name, folder):
    """Returns a copy of the results that a verb starts from."""
    start = folder / re.sub(r"\W", "_", name) / "start"
    if not start.exists():
        start.mkdir(parents=True)
        (start.parent / "small.toml").write_text(SWEEP)
        for step in VERBS[name].before:
            if callable(step):
                step(start)
            else:
                ended = typed(step, start)
                assert ended.code == 0, ended.said
    path = start.parent / "path"
    shutil.rmtree(path, ignore_errors=True)
    shutil.copytree(start, path)
    return path


def undisturbed(name, folder):
    """Types a verb without a fault; returns how often it makes each call, and what came out."""
    path = prepared(name, folder)
    ended = typed(VERBS[name].command, path)
    assert ended.code == 0, ended.said
    checked = typed(("verify", "--threads", "1"), path)
    assert checked.code == 0, checked.said
    return ended.counts, content(path)


def cases(verbs, calls, every_error, folder):
    """Yields (verb, fault, content without a fault) for all faults of verbs, or a sample."""
    draw = random.Random(0)
    for name, sample in verbs.items():
        counts, expected = undisturbed(name, folder)
        all_faults = faults(counts, calls, every_error)
        few = all_faults if sample is None else draw.sample(all_faults, sample)
        for fault in few:
            yield name, fault, expected


def import_all():
    """Imports all of jbench, so that a forked process need not."""
    for module in pkgutil.walk_packages(jbench.__path__, "jbench."):
        with contextlib.suppress(ImportError):
            importlib.import_module(module.name)


def run(request):
    """Tries the cases of a request; yields a dictionary for each."""
    torch.set_num_threads(1)
    os.environ |= {"MUJOCO_GL": "disable", "OMP_NUM_THREADS": "1"}
    import_all()
    torch.optim.Adam(
        [torch.zeros(1, requires_grad=True)]
    )  # it imports the compiler when first used
    speed.seconds_per_step = lambda *_: 1e-3
    executors.subprocess = type("Forking", (), {"Popen": ForkedWorker, "PIPE": -1})
    collecting = importlib.import_module("jbench.datasets.collect")
    collecting._PART_EPISODES = 4
    calls, every_error = request.get("calls", CALLS), request.get("every_error", False)
    # A forked process need not copy what is never collected.
    gc.collect()
    gc.freeze()
    with tempfile.TemporaryDirectory() as folder:
        for name, fault, expected in cases(request["verbs"], calls, every_error, Path(folder)):
            path = prepared(name, Path(folder))
            ended = typed(VERBS[name].command, path, fault)
            found = list(problems(name, fault, ended, path, expected))
            yield {
                "verb": name,
                "call": fault.call,
                "fault": str(fault),
                "code": ended.code,
                "problems": found,
            }


if __name__ == "__main__":
    for case in run(json.loads(sys.argv[1])):
        print(json.dumps(case), flush=True)
    os._exit(0)  # DuckDB prints a page when an interpreter ends that has imported all of jbench
