"""Writes `jbench/report/baselines.csv`: `python benchmarks/baselines.py`.

The returns of random actions and of the hand-written policy of each task, over 100 episodes with
seed 0. Figures and tables of the report show them beside the agents. It takes minutes.
"""

import tempfile
from pathlib import Path

import pandas as pd

import jbench.report
from jbench.names import HEURISTIC, TASKS
from jbench.policies.evaluate import evaluate
from jbench.settings.records import EvaluationSettings
from jbench.store import Results

EPISODES = 100
POLICIES = {"random": "random", HEURISTIC: "hand-written"}


def main() -> None:
    parts = []
    with tempfile.TemporaryDirectory() as directory:
        for task in TASKS:
            for policy, name in POLICIES.items():
                settings = EvaluationSettings(task=task, policy=policy, episodes=EPISODES, seed=0)
                record = evaluate(settings, Results(Path(directory)), threads=2)
                returns = record.read("policy_episodes")["episode_return"].to_numpy().round(2)
                row = {"task": task, "policy": name, "episode": range(EPISODES)}
                parts.append(pd.DataFrame({**row, "episode_return": returns}))
                print(task, name, f"{parts[-1]['episode_return'].median():.0f}", flush=True)
    out = Path(jbench.report.__file__).parent / "baselines.csv"
    pd.concat(parts).to_csv(out, index=False)


if __name__ == "__main__":
    main()
