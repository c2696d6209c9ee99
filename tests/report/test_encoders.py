"""Tests of the frame of encoders, with made-up encoders."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from jbench.errors import RequestError
from jbench.report.encoders import encoder_frame, kept_frame
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.store import Results, record_files, schema
from jbench.store.tables import read_tables
from tests.store.store_rows import alter_manifest

EXPLAINED = {"pca": 0.9, "random": 0.5, "heuristic": 0.4, "pca_heuristic": 0.3}
EXPLAINED["random_heuristic"] = 0.2


def add(results, kind, latents, explained, *, task="face_direction", seed=0, **options):
    """A finished encoder that explains this fraction of the variance."""
    settings = {"kind": kind, "task": task, "latents": latents, "seed": seed, "dataset": "d"}
    id = f"{task}/{kind}{latents}/s{seed}" + "".join(f"-{name}{options[name]}" for name in options)
    record = results.create("encoder", id, {**settings, "options": options})
    row = {"encoder": id, "test_mse": 1 - explained, "test_explained": explained}
    row |= {f"{name}_explained": value for name, value in EXPLAINED.items()}
    record.append({"encoder_errors": pa.Table.from_pylist([row], schema.TABLES["encoder_errors"])})
    record.finish({"test_mse": 1 - explained})
    return record


def table_of(results, task=None):
    tables = read_tables(results).tables.items()
    return encoder_frame({name: table.to_pandas() for name, table in tables}, task)


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results")


def test_row_holds_medians_across_seeds_of_kind_and_size(results):
    for seed, explained in enumerate((0.5, 0.6, 0.9)):
        add(results, "dae", 4, explained, seed=seed)
    add(results, "pca", 4, 0.9)
    table = table_of(results)
    assert table["kind"].tolist() == ["dae", "pca"]
    first = table.iloc[0]
    assert (first["latents"], first["seeds"], first["settings"]) == (4, 3, "")
    assert first["test_mse"] == pytest.approx(0.4)
    fractions = first[["test", "pca", "random", "heuristic", "pca_heuristic"]].tolist()
    assert fractions == pytest.approx([0.4, 0.1, 0.5, 0.6, 0.7])


def test_encoders_of_changed_code_are_rows_named_by_code_and_date(results):
    for code, hour in (("3f2a91aa", "09"), ("07c4d5bb", "17")):
        record = results.create(
            "encoder",
            f"face_direction/mine6/s0-{code}",
            {
                "kind": "mine",
                "task": "face_direction",
                "latents": 6,
                "seed": 0,
                "dataset": "d",
                "sources": code,
            },
        )
        row = {"encoder": record.id, "test_mse": 0.1, "test_explained": 0.9}
        row |= {f"{name}_explained": value for name, value in EXPLAINED.items()}
        errors = pa.Table.from_pylist([row], schema.TABLES["encoder_errors"])
        record.append({"encoder_errors": errors})
        record.finish({"test_mse": 0.1})
        alter_manifest(record, created=f"2026-11-28T{hour}:05:00+00:00")

    table = table_of(results)
    assert table["settings"].tolist() == [
        "code 07c4d5 of 2026-11-28 17:05",
        "code 3f2a91 of 2026-11-28 09:05",
    ]
    assert table["seeds"].tolist() == [1, 1]


def test_rows_are_ordered_by_task_kind_and_size(results):
    for task in ("move_to_pose", "face_direction"):
        for kind in ("random", "zeta", "pca", "dae", "alpha"):
            for latents in (10, 2):
                add(results, kind, latents, 0.5, task=task)
    table = table_of(results)
    found = list(table[["task", "kind", "latents"]].itertuples(index=False, name=None))
    assert found == [
        (task, kind, latents)
        for task in ("face_direction", "move_to_pose")
        for kind in ("dae", "pca", "random", "alpha", "zeta")
        for latents in (2, 10)
    ]
    assert set(table_of(results, "move_to_pose")["task"]) == {"move_to_pose"}


def test_encoders_with_other_options_are_separate_lines(results):
    for horizon in (1, 5):
        for latents in (2, 4):
            add(results, "ddae", latents, 0.5, horizon=horizon, noise=0.1)
    table = table_of(results)
    assert table["settings"].tolist() == ["horizon=1"] * 2 + ["horizon=5"] * 2


def test_report_without_runs_has_encoders(results):
    for latents, explained in ((2, 0.5), (4, 0.75)):
        add(results, "vae", latents, explained)
    found = Frames(results)
    assert found.encoders["test"].tolist() == pytest.approx([0.5, 0.25])
    assert found.encoders["representation"].tolist() == ["vae2", "vae4"]
    assert found.headline == "There are no returns yet."
    with pytest.raises(RequestError, match="There are no runs"):
        Frames(results, Request(task="move_to_pose"))


def test_measured_predictions_stand_beside_errors(results):
    for seed, yaw_rate in enumerate((0.2, 0.4, 0.9)):
        record = add(results, "dae", 4, 0.5, seed=seed)
        r2 = {"yaw_rate": yaw_rate, "tilt_rate": 0.5, "forward_speed": -0.2, "reward": None}
        rows = pd.DataFrame({"encoder": record.id, "target": [*r2], "r2": [*r2.values()]})
        rows = record_files.to_table(
            rows.assign(effective_rank=3.5), schema.TABLES["encoder_predictions"]
        )
        record.append({"encoder_predictions": rows})
        record.finish({"effective_rank": 3.5})
    add(results, "pca", 4, 0.9)
    table = table_of(results)
    assert table["kind"].tolist() == ["dae", "pca"]
    np.testing.assert_allclose(table["yaw_rate"], [0.4, np.nan])
    np.testing.assert_allclose(table["effective_rank"], [3.5, np.nan])
    assert table["reward"].isna().all()


def test_kept_features_are_medians_of_the_draws():
    """Encoders that keep all features, or have more than one layer, are left out."""
    ids = [f"face_direction/dae1/s0{seed}-1a2b3c4d" for seed in range(3)]
    whole = "face_direction/scaled2/s00-1a2b3c4d"
    deep = "face_direction/vae1/s00-1a2b3c4d"
    shares = {ids[0]: (0.5, 0.5), ids[1]: (1.0, 0.0), ids[2]: (0.9, 0.1), whole: (1, 1)}
    rows = [
        {"encoder": id, "feature": feature, "kept": share}
        for id, pair in {**shares, deep: (None, None)}.items()
        for feature, share in zip("yx", pair, strict=True)
    ]
    encoders = pd.DataFrame({"encoder": [*shares, deep], "task": "face_direction"})
    tables = {"encoders": encoders, "encoder_features": pd.DataFrame(rows)}

    found = kept_frame(tables)

    assert found["representation"].tolist() == ["dae1", "dae1"]
    assert found["feature"].tolist() == ["y", "x"]  # in the order of the observation
    assert found["kept"].tolist() == pytest.approx([0.9, 0.1])
    assert found["seeds"].tolist() == [3, 3]
    assert kept_frame(tables, "move_to_pose").empty
