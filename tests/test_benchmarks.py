"""Every script of `benchmarks/` runs, at its smallest, and prints each of its tables."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
SCRIPTS = ROOT / "benchmarks"
COMPANIONS = {"cost.py", "stacked_updates.py", "train_worker.py"}
"""Scripts that others start or import: `train.py` and `gpu.py`."""


class Case(NamedTuple):
    """A call of a script, and the patterns that its output contains, in this order."""

    script: str
    arguments: str
    printed: tuple[str, ...]
    calls: int = 1
    """How often it is called; the output is the last one's."""


SHARES = (r"\| share of training \(%\) \| DDPG \|", r"\| updates \| [1-9]", r"\| rest \|")
CASES = (
    Case("agents_variance", "--repetitions 2", (r"\| case ", r"unequal variance \| \d")),
    Case("augmented", "--seeds 2", ("2 seeds, 0 of them without a robot", "upright reward")),
    Case(
        "baselines", "--episodes 1 --out baselines.csv", ("face_direction random", "move_to_pose")
    ),
    Case(
        "checkpoint",
        "--algos ddpg,ppo --rounds 1 --steps 3000 --repeated 20",
        (
            "ddpg  a checkpoint of a seed",
            "ddpg  3,000 control steps, 3 checkpoints",
            "is written",
            "ddpg  10 seeds: a million control steps of a seed",
            "ddpg  a compact state is .* and 4 bytes for each control step",
        ),
    ),
    Case(
        "collect",
        "--threads 1 --rounds 1 --steps 1000 --robots 8",
        ("bare loop of the XML", "collect", "closed loop, 8 robots", "plain dm_control loop"),
    ),
    Case("collect", "--threads 1 --memory 1000", (r"1,000 control steps: at most \d+ MB",)),
    Case(
        "database",
        "--runs 2 4 --episodes 60 --rounds 1",
        ("2 runs x 60 episodes", "jbench runs --returns: ", "20 runs joined"),
    ),
    Case("encoders", "--rows 20000 --rounds 1", ("DataLoader, all threads", "against the better")),
    Case("encoders", "--whole 1 --episodes 50", (r"1 epochs of 40,040 rows",)),
    Case("faults", "--verbs import --sample 2", (r"\| import \|", "2 cases, 0 of them wrong")),
    Case("features", "--rounds 1", ("full: ", "ofe12: ", "ofe240: ")),
    Case("gait_map", "--episodes 1 --output map.png", ("wrote map.png",)),
    Case(
        "gpu",
        "--device cpu --small",
        ("Tests: .* passed", r"\| td3 \| 2 \| bfloat16", r"\| ppo \| 2 \| 8 ", "kernel of DDPG"),
    ),
    Case("mujoco_versions", "states", ("MuJoCo", r"100 control steps: positions 0e\+00"), calls=2),
    Case("ratio_intervals", "--comparisons 3", (r"\| normal \|", r"\| exponential \|")),
    Case("verdict_rates", "--comparisons 2", (r"\| normal \| 6 \|", r"seven fails \| 10 \|")),
    Case(
        "report",
        "--runs 4 8 --episodes 20 --rounds 1 --profile 3",
        ("jbench report, 4 runs", "jbench report --claims, 8 runs", "the page alone", "cumulative"),
    ),
    Case("robots", "--robots 2 --rounds 1", (r"\| move_to_pose \| \d+ \| \d+ \| \d+ \|",)),
    Case("rules", "--rounds 2", ("TD3 by hand .* ratio",)),
    Case(
        "sequential",
        "--repetitions 50 --max-seeds 10 --comparisons 1 --relabelings 50",
        ("shifts of comparisons", "1 comparisons, at most 10 seeds", "no shift, margin"),
    ),
    Case("shares", "--algos ddpg --steps 1000", SHARES),
    Case("ship_reference", "results --out shipped", ("0 runs; 0.0 MB in a wheel",)),
    Case(
        "train",
        "--algos ddpg --rounds 1 --seconds 0.3 --bursts 1 --updates 2 --share-steps 1000",
        ("ddpg  batched, 10 seeds .* x stable-baselines3", "DDPG's update in float32", *SHARES),
    ),
    Case(
        "train",
        "--algos ppo --steps 5000 --seconds 2",
        ("ppo   batched .* 5,000 control steps .* returns",),
    ),
    Case(
        "train",
        "--algos td3 --task gym:Hopper-v5 --steps 600 --seconds 0.5",
        (
            r"td3   batched .* 600 control steps .* \| returns -?\d",
            r"the median of batched, -?\d\S*, is \w+ the range of stable-baselines3, -?\d",
        ),
    ),
    Case(
        "train",
        "--algos td3 --cores 1",
        (r"\| TD3 published \| 1 \| \d", "Figure 8, predicted hours", r"\| TD3 published \| \d"),
    ),
    Case(
        "tune_heuristics",
        "--task face_direction --candidates 16 --episodes 1 --steps 20 --held-out 2",
        ("0: mean", "face_direction: tuning", "face_direction: held out"),
    ),
    Case("update_rates", "--bursts 1 --updates 2", ("update in float32", "update in bfloat16")),
    Case("vector_env", "--envs 2 --rounds 1 --seconds 0.1", ("SyncVectorEnv", "for each environ")),
)


def test_every_script_is_run():
    scripts = {path.name for path in SCRIPTS.glob("*.py")}
    assert scripts - COMPANIONS == {f"{case.script}.py" for case in CASES}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.script} {case.arguments}")
def test_script_prints_its_tables(case, tmp_path):
    (tmp_path / "results").mkdir()
    command = [sys.executable, str(SCRIPTS / f"{case.script}.py"), *case.arguments.split()]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MUJOCO_GL": "disable"}
    for _ in range(case.calls):
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
    assert re.search(".*".join(case.printed), done.stdout, re.DOTALL), done.stdout
