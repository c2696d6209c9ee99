"""The report on agents of the matrix `authors`: their baseline raw, and two designs of encoders."""

import numpy as np
import pandas as pd
import pytest

from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.report.verdict_matrices import tables_of_verdicts, verdict_matrices
from jbench.settings.algorithms import algorithm_settings
from tests.report.conftest import FabricatedResults

ENCODER = "face_direction/dae12-script/s0{}-{:08d}"


def add_designs(fabric):
    """Adds ten seeds of each design of Figure 7, evaluated once, at the end."""
    settings = algorithm_settings("ddpg", "figure8").model_dump(mode="json")
    common = {
        "algo": "ddpg",
        "engine": "batched",
        "time_limit": "terminal",
        "hyperparameters": settings,
        "steps": 300_000,
        "evaluate_every": 20_000,
        "evaluate_episodes": 10,
    }
    spread = 10 * np.arange(10.0)
    for seed in range(10):
        own_encoder = ENCODER.format(seed, 2)
        designs = {
            "raw": (300 + 5 * spread[seed], {"representation": "raw16"}),
            "one": (600 + spread[seed], {"encoder": ENCODER.format(0, 1)}),
            "each": (500 + spread[seed], {"encoder": own_encoder, "encoder_draws": "ab"}),
        }
        for final, own in designs.values():
            more = {"representation": "dae12-script", **common, **own}
            fabric.run([final] * 300, seed, evaluated={300_000: final}, **more)


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    """Returns the frames of both designs of Figure 7, and of the observation in SI units."""
    fabric = FabricatedResults(tmp_path_factory.mktemp("designs") / "results")
    add_designs(fabric)
    return Frames(fabric.results, Request(claims=True))


def test_both_designs_are_compared_with_the_observation_in_si_units(frames):
    shown = frames.verdicts.query("returns == 'evaluation' and claim == 'a'")
    by_design = shown.set_index("words")
    assert {*shown["against"]} == {"raw"}
    assert by_design["value"].round().to_dict() == {"an encoder per agent": 20, "one encoder": 120}
    assert {*shown["corrected_by"]} == {"sequential test"}
    decided = frames.decisions.query("study == 'authors' and claim == 'a'").set_index("words")
    # Of means: 500 and 600 plus 45, and 300 plus 225.
    assert decided["difference"].to_dict() == {"an encoder per agent": 20, "one encoder": 120}
    assert {*frames.decisions["claim"]} == {"a", "c"}


def test_variability_is_judged_in_both_designs(frames):
    (text,) = {*frames.claims.query("claim == 'b' and source == 'own'")["verdict"]}
    assert text == "supported"  # a fifth of the standard deviation of raw
    compared = frames.claims.query("claim == 'b' and source == 'own'")["compared"]
    designs = ("an encoder per agent", "one encoder")
    names = {f"face_direction DDPG dae12-script, {design} against raw" for design in designs}
    assert {*compared} == names


def test_representations_without_a_common_baseline_have_tables_of_their_own(fabric):
    add_designs(fabric)
    for name in ("full", "dae12", "planar12", "pca12"):
        encoder = None if name == "full" else f"face_direction/{name}/s00-00000003"
        for seed in range(2):
            own = {"algo": "td3", "representation": name, "encoder": encoder}
            fabric.run([700], seed, evaluated={1000: 700}, **own)

    matrices = verdict_matrices(Frames(fabric.results, Request()))

    assert [list(matrix.baselines) for matrix in matrices] == [["full"], ["raw"]]
    rows = [[row for group in matrix.groups.values() for row in group] for matrix in matrices]
    assert {row.representation for row in rows[0]} == {"dae12", "planar", "pca12"}
    assert [row.words for row in rows[1]] == ["an encoder per agent", "one encoder"]
    for matrix, shown in zip(matrices, rows, strict=True):
        assert {len(row.verdicts) for row in shown} == {len(matrix.claims)}  # one baseline


def test_a_table_of_verdicts_has_two_baselines_at_most():
    """That of dae12 has raw, too; pca12 is compared with baselines of which two are in one."""
    compared = {
        "dae12": ("full", "raw"),
        "planar": ("full", "scaled"),
        "raw": ("full",),
        "pca12": ("full", "scaled", "heading"),
        "random12": ("scaled", "full"),
    }
    rows = [
        {"configuration": name, "against": baseline, "claim": claim}
        for name, baselines in compared.items()
        for baseline in baselines
        for claim in "ab"
    ]
    assert tables_of_verdicts(pd.DataFrame(rows)) == [
        (["full", "raw"], ["dae12", "raw"]),
        (["full", "scaled"], ["planar", "pca12", "random12"]),
        (["heading"], ["planar", "pca12", "random12"]),
    ]
