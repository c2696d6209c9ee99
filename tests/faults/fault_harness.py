"""Runs jbench commands with one failing system call, and checks the results.

    python -m tests.faults.fault_harness '{"verbs": {"collect": 8, "merge": null}}'

A number is that of faults drawn at random; null means all. "every_error": true tries each call with
each error, and "calls": [...] names the kinds of calls that fail. Tests start `main` as a process.

For each command that writes, one run without a fault counts its calls below the results directory.
Then, for the k-th call of each kind and each errno (or one, alternating), the command starts from
the same results with that fault, and its output and results are checked; see `problems`. Commands
and their workers are processes forked from this one, which has imported all modules. Episodes have
`EPISODE` control steps.

It prints a JSON line for each case: {"verb", "call", "fault", "code", "problems"}.
"""

import errno
import hashlib
import json
import os
import random
import re
import shutil
import sys
import tempfile
from pathlib import Path

import pyarrow as pa

from jbench.datasets import fixed
from jbench.errors import WorkError
from jbench.store import Results
from jbench.store.manifest import KINDS
from jbench.store.schema import TIMES
from jbench.sweeps import executors
from jbench.training import speed
from tests.faults.fault_injection import CALLS, Fault
from tests.faults.fault_verbs import FILES, VERBS
from tests.faults.forked_commands import ForkedWorker, run_command
from tests.fork_server import import_all
from tests.short_episodes import shorten_episodes

EPISODE = 20
"""Control steps of an episode."""

LASTING = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
"""Persistent errors: each is tried once alone, and once with all later calls failing."""

ERRORS = (*LASTING, errno.EIO, errno.EMFILE)


def content(path):
    """Returns status and digests of each record, without times.

    Reports and exports are compared by file names, files set aside by digests, each once: a file
    that was not moved yet may have a second name there, and another one in the next repair.
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
    found["report"] = sorted(file.name for file in report.rglob("*"))
    found["exported"] = sorted(str(file.relative_to(path)) for file in (path / "minari").rglob("*"))
    digests = {
        hashlib.sha256(file.read_bytes()).hexdigest()
        for file in path.glob("set-aside/**/*")
        if file.is_file()
    }
    found["set aside"] = sorted(digests)
    return json.loads(json.dumps(found))


def _digest(record, table):
    rows = pa.concat_tables([record.read_part(entry) for entry in record.parts(table)])
    rows = rows.drop_columns([name for name in TIMES if name in rows.column_names])
    return hashlib.sha256(repr(rows.to_pylist()).encode()).hexdigest()


def problems(verb, ended, path, expected):
    """Yields a message for each guarantee that a command with a fault violated.

    The command is repeated, and `expected` is then the `content` of the results.
    """
    errors = [line for line in ended.output.splitlines() if line.startswith("Error: ")]
    if "Traceback" in ended.output or ended.code not in (0, 1, 2):
        yield f"exit code {ended.code}: {ended.output[-1500:]}"
    elif len(errors) != (ended.code != 0):
        yield f"exit code {ended.code} with {len(errors)} sentences: {ended.output[-500:]}"
    first = run_command(("verify", "--threads", "1"), path)
    wrong = [line for line in first.output.splitlines() if line.startswith("  ")]
    damaged = [line for line in wrong if "is listed by no manifest" not in line]
    if damaged and verb != "repair":
        yield f"verify: {damaged}"
    command = VERBS[verb].command + (VERBS[verb].again if ended.code else ())
    again = run_command(command, path)
    exists = verb == "export" and ended.code == 0  # which is not overwritten
    if again.code != (2 if exists else 0):
        yield f"repeated, exit code {again.code}: {again.output[-1500:]}"
    after = run_command(("verify", "--threads", "1"), path)
    if after.code != 0:
        yield f"verify, after the repeated command: {after.output}"
    try:
        found = content(path)
    except WorkError as error:
        yield f"repeated, the results can't be read: {error}"
        return
    if verb == "merge":  # the second merge also sets aside records replaced before the fault
        found["set aside"] = expected["set aside"] = []
    differences = [name for name in {**found, **expected} if found.get(name) != expected.get(name)]
    if differences:
        yield f"repeated, other content than without a fault: {differences}"


def faults(counts, calls, every_error):
    """Returns the faults of a command with these counts of calls: one per call or per error."""
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
    """Returns a copy of the results that a command starts from."""
    start = folder / re.sub(r"\W", "_", name) / "start"
    if not start.exists():
        start.mkdir(parents=True)
        for file, text in FILES.items():
            (start.parent / file).write_text(text)
        for step in VERBS[name].before:
            if callable(step):
                step(start)
            else:
                ended = run_command(step, start)
                assert ended.code == 0, ended.output
    path = start.parent / "path"
    shutil.rmtree(path, ignore_errors=True)
    shutil.copytree(start, path)
    return path


def without_fault(name, folder):
    """Runs a command without a fault; returns its counts of calls and its results."""
    path = prepared(name, folder)
    ended = run_command(VERBS[name].command, path)
    assert ended.code == 0, ended.output
    checked = run_command(("verify", "--threads", "1"), path)
    assert checked.code == 0, checked.output
    return ended.counts, content(path)


def cases(verbs, calls, every_error, folder):
    """Yields (command, fault, content without a fault) for all faults, or a sample."""
    draw = random.Random(0)
    for name, sample in verbs.items():
        counts, expected = without_fault(name, folder)
        all_faults = faults(counts, calls, every_error)
        few = all_faults if sample is None else draw.sample(all_faults, sample)
        for fault in few:
            yield name, fault, expected


def run(request):
    """Runs the cases of a request; yields a dictionary for each."""
    shorten_episodes(steps=EPISODE)
    speed.seconds_per_step = lambda *_, **__: 1e-3
    executors.subprocess = type("Forking", (), {"Popen": ForkedWorker, "PIPE": -1})
    fixed.PART_EPISODES = 4
    calls, every_error = request.get("calls", CALLS), request.get("every_error", False)
    with tempfile.TemporaryDirectory() as folder:
        for name, fault, expected in cases(request["verbs"], calls, every_error, Path(folder)):
            path = prepared(name, Path(folder))
            ended = run_command(VERBS[name].command, path, fault)
            about = {"verb": name, "call": fault.call, "fault": str(fault), "code": ended.code}
            yield {**about, "problems": list(problems(name, ended, path, expected))}


def main(request):
    """Prints the cases of a request; returns the exit code."""
    for case in run(request):
        print(json.dumps(case), flush=True)
    return 0


if __name__ == "__main__":
    os.environ |= {"MUJOCO_GL": "disable", "OMP_NUM_THREADS": "1"}
    import_all()
    main(json.loads(sys.argv[1]))
    os._exit(0)  # at a normal exit, DuckDB prints a page of errors
