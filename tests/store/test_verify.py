"""Tests of verify: each fault is reported with its record, and no file is changed."""

import re
import shutil

import pytest

from jbench.errors import WorkError
from jbench.settings.base import settings_hash
from jbench.store import Results, query
from jbench.store.manifest import Manifest
from jbench.store.verify import examine, verify
from tests.store.store_faults import Script, run_script
from tests.store.store_rows import alter_manifest, listed, manifest_of, numbers, put_in_place
from tests.store.store_whole import add, add_chain, add_whole_run, snapshot
from tests.store.test_damage import DAMAGES


def assert_one(results, sort, record, says):
    (found,) = verify(results, 2).findings
    assert (found.sort, found.kind, found.id) == (sort, record.kind, record.id)
    assert says in str(found), str(found)


def test_intact_results_have_no_findings_and_are_counted(results):
    records = add_chain(results)
    add_whole_run(results, finish=False, seed=1)
    found = verify(results, 2)
    paths = [record.path / name for record in records for name in listed(record)]
    assert (found.records, found.findings, found.faults) == (5, [], [])
    assert found.files == len(paths) + 1
    assert found.bytes > sum(path.stat().st_size for path in paths)


@pytest.mark.parametrize(("damage", "reason"), DAMAGES)
@pytest.mark.parametrize("name", ["episodes", "policy"])
def test_damaged_file_is_reported(results, name, damage, reason):
    add_chain(results)
    run = add_whole_run(results, seed=5)
    (path,) = run.path.glob(f"{name}*")
    damage(path)
    (found,) = (finding for finding in verify(results, 2).findings if finding.sort == "damaged")
    assert (found.kind, found.id, found.path) == ("run", run.id, path)
    assert str(found).startswith(f"{path} is damaged (")
    assert reason in str(found)
    assert examine(results, "run", run.id)[1] == [found]


@pytest.mark.parametrize(
    ("content", "entry", "says"),
    [
        (b"PAR1 but not really PAR1", {}, "is damaged ("),
        (None, {"rows": 4}, "is damaged (3 rows, not 4)"),
    ],
)
def test_invalid_file_with_matching_manifest_is_reported(results, content, entry, says):
    run = add_whole_run(results)
    put_in_place(run, content or (run.path / listed(run)[0]).read_bytes(), **entry)
    assert_one(results, "damaged", run, says)
    with pytest.raises(WorkError, match=re.escape(f"{listed(run)[0]} {says}")):
        results.find("run", run.id).read("episodes")


def test_table_without_required_column_is_reported(results):
    settings = {"seed": 0}
    record = results.create("run", f"s00-{settings_hash(settings)}", settings)
    record.append({"episodes": numbers(1), "mine": numbers(2)})
    assert_one(results, "damaged", record, "is damaged (it has no column run: another version")
    with pytest.raises(WorkError, match="it has no column run: another version of jbench wrote it"):
        record.read("episodes")
    assert "it has no column run" in query.query_results(results, "FROM episodes")[1][0]


def test_id_that_contradicts_settings_is_reported(results):
    run = add_whole_run(results)
    altered = {**manifest_of(run)["settings"], "seed": 1}
    alter_manifest(run, settings=altered)
    assert_one(results, "damaged", run, f"has settings of the hash {settings_hash(altered)}")
    alter_manifest(run, settings={**altered, "seed": "zero"})
    assert_one(results, "damaged", run, "has invalid settings (")


def test_directory_whose_name_is_no_id_is_reported(results):
    run = add_whole_run(results)
    run.path.rename(run.path.parent / "my copy")
    (found,) = verify(results, 2).findings
    assert (found.sort, "is not an id" in found.problem) == ("damaged", True)


def test_leftover_files_are_reported_in_every_directory(results):
    run = add_whole_run(results)
    expected = []
    for path in (
        run.path / ".writing-x1",
        run.path / "episodes-00007-0badc0de.parquet",
        run.path / "notes.txt",
        run.path.parent / "stray.json",
        results.path / "runs" / "stray",
        results.path / "runs" / "gone" / "episodes-00000-0badc0de.parquet",
    ):
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"left")
        expected.append(f"{path} is listed by no manifest.")
    before = snapshot(results.path)
    found = verify(results, 2).findings
    assert sorted(map(str, found)) == sorted(expected)
    assert {finding.sort for finding in found} == {"leftover"}
    assert snapshot(results.path) == before


def test_locks_and_files_outside_kinds_are_no_leftovers(results):
    run = add_whole_run(results)
    with run.folder.lock():
        pass
    (results.path / "report").mkdir()
    for path in (results.path / "README.md", results.path / "report" / "index.html"):
        path.write_text("mine")
    assert verify(results, 2).findings == []


def test_link_is_reported_and_not_followed(tmp_path, results):
    run = add_whole_run(results)
    other = add_whole_run(Results(tmp_path / "other"), seed=9)
    (results.path / "runs" / "out").symlink_to(tmp_path / "other" / "runs")
    (finding,) = verify(results, 2).findings
    assert str(finding) == f"{results.path}/runs/out is listed by no manifest."
    (results.path / "runs" / "out").unlink()
    (run.path / "manifest.json").unlink()
    (run.path / "manifest.json").symlink_to(other.path / "manifest.json")
    assert_one(results, "damaged", run, "manifest.json can't be read (a link to another place).")


def test_missing_reference_is_warning_and_no_fault(results):
    dataset, encoder, run, evaluation = add_chain(results)
    for lost, user in ((encoder, run), (run, evaluation)):
        shutil.move(lost.path, moved := results.path / "moved")
        found = verify(results, 2)
        assert [(f.sort, f.id) for f in found.findings] == [("warning", user.id)]
        assert f"names the {lost.kind} {lost.id}, which is not intact" in str(found.findings[0])
        assert found.faults == []
        shutil.move(moved, lost.path)
    shutil.rmtree(dataset.path)
    assert verify(results, 2).findings == []  # a finished encoder needs nothing but itself
    alter_manifest(encoder, status="unfinished")
    assert f"names the dataset {dataset.id}" in str(verify(results, 2).findings[0])


def test_evaluation_of_shipped_policy_needs_no_run(results):
    for policy, warnings in (("reference/face_direction/td3/full/s00-1", 0), ("face/s00-1", 1)):
        settings = {"task": "face_direction", "policy": policy, "seed": 0}
        add(results, "evaluation", "face_direction/policy", settings)
        assert len(verify(results, 2).findings) == warnings


@pytest.mark.parametrize(
    ("date", "says"),
    [
        ("2999-01-01T00:00:00+00:00", "in the future"),
        ("2020-01-01T00:00:00", "no date with a time zone"),
        ("long ago", "no date"),
    ],
)
def test_impossible_date_is_warning(results, date, says):
    run = add_whole_run(results)
    alter_manifest(run, created=date)
    assert_one(results, "warning", run, f"was created '{date}': {says}")


def test_locked_record_has_no_leftovers(results):
    run = add_whole_run(results, finish=False)
    (run.path / ".writing-x1").write_bytes(b"half a fi")
    with run.folder.lock():
        assert verify(results, 2).findings == []
    assert_one(results, "leftover", run, "is listed by no manifest")


WRITING = """
with results.folder("run", sys.argv[2]).lock():
    record = results.find("run", sys.argv[2])
    print("begun", flush=True)
    while True:
        record = results.create("run", record.id, record.settings)
        for n in range(3):
            record.append({"t": numbers(n)}, {"checkpoint.json": b"%d" % n})
        record.finish({}, {"policy.json": b"{}"})
"""


@pytest.mark.slow
def test_record_during_writing_is_never_reported_as_damaged(results):
    run = add_whole_run(results, finish=False)
    with Script(results, WRITING, run.id) as writer:
        assert writer.stdout.readline() == "begun\n"
        found = [finding for _ in range(30) for finding in verify(results, 2).findings]
        assert writer.poll() is None
        writer.kill()
    assert found == []


@pytest.mark.slow
def test_memory_is_independent_of_file_size(results):
    run = add_whole_run(results, (), finish=False)
    size = 300_000_000
    path = run.path / "policy.safetensors"
    with path.open("wb") as file:
        file.truncate(size)
    entry = {"name": path.name, "table": None, "rows": 0, "bytes": size, "sha256": "0" * 64}
    alter_manifest(run, files=[entry])
    script = """
import resource
from jbench.store.verify import verify
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
(found,) = verify(results, 2).findings
print(found.problem, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
    (printed,) = run_script(results, script)
    problem, _, kilobytes = printed.rpartition(" ")
    assert problem == "is damaged (its checksum differs)"
    assert int(kilobytes) < 50_000


def test_settings_keep_hash_through_manifest_round_trip(tmp_path):
    numbers = [0.1 + 0.2, 1e-300, -1.5e300, 2**63 - 1, -(2**63), True, None]
    values = {"é|<=^%~-\"'": 'é"', "numbers": numbers, "deep": {"a": [{"b": [[]]}], "c": {}}}
    manifest = Manifest(kind="run", id="a", settings=values, created="", updated="")
    (path := tmp_path / "manifest.json").write_bytes(manifest.to_bytes())
    assert Manifest.read(path).settings == values
    assert settings_hash(Manifest.read(path).settings) == settings_hash(values)


def test_directory_without_records_is_not_called_intact(tmp_path, run_command):
    code, out, err = run_command("verify", results=tmp_path)
    assert (code, err) == (0, "")
    assert out == f"There are no records in {tmp_path}, so nothing was checked.\n"
