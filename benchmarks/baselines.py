"""Writes `jbench/report/baselines.csv`: `python benchmarks/baselines.py`.

The median return of random actions and of the hand-written policy of each task, over 100 episodes
with seed 0, its 95% interval, and the 10th and 90th percentile of the episodes. Figures and tables
of the report show them beside the agents. It takes minutes.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

import jbench.report
from jbench.names import HEURISTIC, TASKS
from jbench.policies.evaluate import evaluate
from jbench.settings.records import EvaluationSettings
from jbench.statistics import bootstrap
from jbench.store import Results

EPISODES = 100
POLICIES = {"random": "random", HEURISTIC: "hand-written"}


OUT = Path(jbench.report.__file__).with_name("baselines.csv")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=EPISODES, help="of each policy")
    parser.add_argument("--out", type=Path, default=OUT, help="CSV file to write")
    arguments = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as directory:
        for task in TASKS:
            for policy, name in POLICIES.items():
                settings = EvaluationSettings(
                    task=task, policy=policy, episodes=arguments.episodes, seed=0
                )
                record = evaluate(settings, Results(Path(directory)), threads=2)
                returns = record.read("policy_episodes")["episode_return"].to_numpy().round(2)
                median, low, high, _ = bootstrap.estimate(bootstrap.median, [returns])
                row = {"task": task, "policy": name, "median": median, "low": low, "high": high}
                row |= zip(("q10", "q90"), np.percentile(returns, (10, 90)), strict=True)
                rows.append(row | {"episodes": arguments.episodes})
                print(task, name, f"{median:.0f}", flush=True)
    pd.DataFrame(rows).to_csv(arguments.out, index=False)


if __name__ == "__main__":
    main()
