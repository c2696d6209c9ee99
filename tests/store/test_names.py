"""Tests of untrusted manifests and tables: hostile names, texts and sizes are refused."""

import pyarrow as pa
import pytest

from jbench.errors import RequestError
from jbench.store import parquet, query
from jbench.store.listing import list_runs
from jbench.store.verify import verify
from tests.store.store_rows import (
    RUN_SETTINGS,
    alter_manifest,
    listed,
    manifest_of,
    put_in_place,
)
from tests.store.store_whole import add_chain, add_whole_run

HOSTILE = (
    "=cmd|' /C calc'!A0",
    "@SUM(A1)",
    "+1",
    "\x1b[2J",
    "<script>",
    "a\nb",
    "a|b",
    "",
    "\u202e",
)


def alter_settings(record, **changes):
    alter_manifest(record, settings={**manifest_of(record)["settings"], **changes})


@pytest.mark.parametrize("text", HOSTILE)
@pytest.mark.parametrize("name", ["task", "algo", "representation", "engine", "encoder"])
def test_run_with_hostile_name_is_reported_and_skipped(results, name, text):
    good, bad = add_whole_run(results), add_whole_run(results, seed=1)
    alter_settings(bad, **{name: text})
    loaded = query.load(results)
    assert loaded.tables["runs"]["run"].to_pylist() == [good.id]
    (problem,) = loaded.problems
    assert problem.startswith(f"{bad.path}/manifest.json is not a manifest that can be read (")
    lines, problems = list_runs(results, {})
    assert ([line.run for line in lines], problems) == ([good.id], [problem])
    (finding,) = verify(results, 1).findings
    assert (finding.severity, finding.id) == ("damaged", bad.id)


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        ("encoder", {"kind": "=1+1"}),
        ("encoder", {"options": {"a": {"<b>": 1}}}),
        ("evaluation", {"policy": "@SUM"}),
        ("run", {"hyperparameters": {"=x": 1}}),
        ("run", {"hyperparameters": {"activation": "<script>"}}),
        ("run", {"hyperparameters": {"layers": ["\x1b"]}}),
    ],
)
def test_hostile_text_anywhere_in_settings_is_refused(results, kind, settings):
    add_chain(results)
    (record,) = results.scan(kind)[0]
    alter_settings(record, **settings)
    assert results.scan(kind)[0] == []


@pytest.mark.parametrize(
    "changes",
    [
        {"created": "<script>"},
        {"updated": "\x1b[2J"},
        {"provenance": {"processor": "\x1b[2J"}},
        {"provenance": {"processor": "<script>"}},
        {"provenance": {"command": ["=cmd|' /C calc'!A0"]}},
        {"provenance": {"packages": {"@SUM": "1"}}},
        {"provenance": {"processor": "-2+cmd|' /C calc'!A0"}},
    ],
)
def test_hostile_date_or_provenance_is_refused(results, changes):
    run = add_whole_run(results)
    alter_manifest(run, **changes)
    assert results.scan("run")[0] == []


@pytest.mark.parametrize("algo", ["cleanrl-td3", "sb3_contrib:TQC", "td-mpc2", "a.b+c"])
def test_names_of_third_party_algorithms_and_engines_are_read(results, algo):
    record = results.create("run", "a/b", {**RUN_SETTINGS, "algo": algo, "engine": algo})
    assert query.load(results).tables["runs"]["algo"].to_pylist() == [algo]
    assert record.settings["engine"] == algo


def test_record_with_unreadable_settings_is_not_created(results):
    with pytest.raises(RequestError, match=r"saved \('=1' can't be the setting algo\)"):
        results.create("run", "a/b", {**RUN_SETTINGS, "algo": "=1"})
    assert results.find("run", "a/b") is None


@pytest.mark.parametrize("where", ["settings", "summary", "provenance"])
def test_integer_larger_than_any_column_type_is_refused(results, where):
    good, bad = add_whole_run(results), add_whole_run(results, seed=1)
    alter_manifest(bad, **{where: {**manifest_of(bad)[where], "seed": 10**4000}})
    for lines, problems in (list_runs(results, {}), results.scan("run")):
        assert [getattr(line, "run", None) or line.id for line in lines] == [good.id]
        assert "is not a manifest that can be read" in problems[0]


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_setting_that_is_not_finite_is_refused(results, number):
    good, bad = add_whole_run(results), add_whole_run(results, seed=1)
    alter_manifest(bad, settings={**manifest_of(bad)["settings"], "hyperparameters": [number]})
    lines, problems = list_runs(results, {})
    assert [line.run for line in lines] == [good.id]
    assert "is not a manifest that can be read" in problems[0]
    (found,) = verify(results, 1).findings
    assert (found.severity, found.id) == ("damaged", bad.id)


def test_missing_dataset_column_is_reported(results):
    dataset = add_chain(results)[0]
    entry = dataset.parts("steps")[0]
    content = parquet.to_bytes(dataset.rows_of(entry).drop_columns(["motor_velocity"]))
    assert listed(dataset)[0] == entry.name
    put_in_place(dataset, content)
    (finding,) = (f for f in verify(results, 1).findings if f.severity == "damaged")
    assert str(finding).endswith("is damaged (it has no column motor_velocity).")


def test_repeated_large_texts_are_refused():
    rows = 4_000
    text = pa.DictionaryArray.from_arrays(pa.array([0] * rows), pa.array(["x" * 1_000_000]))
    content = parquet.to_bytes(pa.table({"run": text}))
    assert len(content) < 40_000
    with pytest.raises(ValueError, match="its texts are larger than 512 MiB"):
        parquet.from_bytes(content, rows)


def test_file_that_decompresses_to_more_than_limit_is_refused(monkeypatch):
    content = parquet.to_bytes(pa.table({"x": [float(n) for n in range(200_000)]}))
    monkeypatch.setattr(parquet, "_MAX_BYTES", 1 << 20)
    with pytest.raises(ValueError, match="it unpacks to 1 MiB"):
        parquet.from_bytes(content, 200_000)


def test_nested_column_is_refused():
    content = parquet.to_bytes(pa.table({"x": [[1.0] * 10]}))
    with pytest.raises(ValueError, match="the column x is nested"):
        parquet.from_bytes(content, 1)


def test_text_columns_survive_parquet_round_trip():
    table = pa.table({"run": ["a", None, "a", ""], "n": [1, 2, 3, 4]})
    assert parquet.from_bytes(parquet.to_bytes(table), 4).equals(table)
    coded = parquet.from_bytes(parquet.to_bytes(table), 4, ["run"])
    assert pa.types.is_dictionary(coded.schema.field("run").type)
    with pytest.raises(ValueError, match="4 rows, not 5"):
        parquet.from_bytes(parquet.to_bytes(table), 5)
