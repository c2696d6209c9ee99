"""The runs that are shipped with jbench are intact, and learned what was published."""

import numpy as np
import pytest

from jbench.settings.run import RunSettings
from jbench.store.shipped import shipped_results
from jbench.store.verify import verify
from tests.documentation import ROOT


@pytest.fixture(scope="module")
def runs():
    results = shipped_results()
    records, problems = results.scan("run")
    assert problems == []
    return records


def test_shipped_runs_are_finished_and_undamaged(runs):
    found = verify(shipped_results(), 1)
    assert found.faults == []
    others = [shipped_results().scan(kind)[0] for kind in ("encoder", "evaluation")]
    assert found.records == len(runs) + sum(map(len, others))
    assert runs
    assert {record.status for record in runs} == {"finished"}
    # No directory of the machine that made them is named.
    assert all("command" not in record.manifest.provenance for record in runs)


def last_twenty(runs, steps, **settings):
    """Returns the last 20 training returns of each of some seeds on face_direction.

    The agents observe their inputs as they are.
    """
    wanted = {"task": "face_direction", "steps": steps, **settings}
    return [
        record.read("episodes")["episode_return"].to_numpy()[-20:]
        for record in runs
        if wanted.items() <= RunSettings(**record.settings).__dict__.items()
        and "normalize" not in record.settings["hyperparameters"]
    ]


# Figure 9: by algorithm and control steps, the 10th and the 90th percentile of ten seeds.
BANDS = {
    ("td3", 100_000): (766.07, 971.14),
    ("sac", 100_000): (840.23, 951.93),
    ("ddpg", 300_000): (391.17, 859.33),
}


@pytest.mark.parametrize(
    ("algo", "steps", "engine", "precision", "seeds", "median"),
    [
        ("td3", 100_000, "batched", "float32", 10, 945),
        ("td3", 100_000, "batched", "bfloat16", 4, 960),
        ("td3", 100_000, "sb3", "float32", 7, 938),
        ("sac", 100_000, "batched", "float32", 6, 948),
        ("sac", 100_000, "sb3", "float32", 4, 949),
        ("ddpg", 300_000, "batched", "float32", 6, 689),
    ],
)
def test_the_last_twenty_episodes_lie_in_the_published_band(
    runs, algo, steps, engine, precision, seeds, median
):
    wanted = {"algo": algo, "representation": "full", "engine": engine, "precision": precision}
    wanted["time_limit"] = "bootstrap"  # as in Table 1; Figure 7's agents have a terminal one
    chosen = last_twenty(runs, steps, **wanted)
    assert len(chosen) == seeds
    low, high = BANDS[algo, steps]
    assert low <= np.median(chosen) <= high
    assert round(np.median(chosen)) == median  # as docs/agents.md says


def test_on_twelve_latents_the_published_seed_lies_among_ours(runs):
    chosen = last_twenty(runs, 300_000, algo="ddpg", representation="dae12")
    assert len(chosen) == 6
    # Figure 7, one seed: the mean of its points at 290,000 and 310,000 control steps.
    assert min(map(np.median, chosen)) < 554.0 < max(map(np.median, chosen))


def test_page_on_submissions_counts_the_runs_whose_evaluation_can_be_repeated(runs):
    kept = [
        record
        for record in runs
        if record.manifest.summary.get("policy_evaluation") is not None
        and "policy.safetensors" in {file.name for file in record.manifest.files}
    ]
    made = [record.manifest.provenance for record in kept]
    moved = [bool(m.get("continued") and "device" in m["continued"][-1]["changed"]) for m in made]
    on_gpu = [m for m, left in zip(made, moved, strict=True) if m["device"] == "cuda" and not left]
    assert (len(kept) - len(on_gpu), len(on_gpu)) == (70, 21)
    page = (ROOT / "docs/submit.md").read_text()
    assert "most were saved without their policy and seventy are equal" in page
    assert "twenty-one ran on a GPU" in page
