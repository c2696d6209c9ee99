"""Writes `jbench/report/baselines.csv`: `python benchmarks/baselines.py`.

The mean and the median return of random actions and of the hand-written policy of each task, over
100 episodes with seed 0, with their 95% intervals, and the 10th and 90th percentile of the
episodes. Figures and tables of the report show the means beside the agents. It takes minutes.
"""

import argparse
import tempfile
from pathlib import Path

import pandas as pd

import jbench.report
from jbench.names import HEURISTIC, TASKS
from jbench.policies.evaluate import evaluate
from jbench.report.data.untrained import HAND_WRITTEN, RANDOM, SHIPPED, untrained_row
from jbench.settings.records import EvaluationSettings
from jbench.store import Results

EPISODES = 100
POLICIES = {RANDOM: RANDOM, HEURISTIC: HAND_WRITTEN}

OUT = Path(jbench.report.__file__).with_name(SHIPPED)


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
                row = untrained_row(task, name, returns)
                rows.append(row)
                print(f"{task} {name} {row['mean']:.0f}", flush=True)
    pd.DataFrame(rows).to_csv(arguments.out, index=False)


if __name__ == "__main__":
    main()
