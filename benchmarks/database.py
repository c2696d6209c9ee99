"""Measures the results database on generated results: `python benchmarks/database.py`.

Generates results of 200 and of 2,000 runs of 5,000 episodes and times loading and querying them:
each measurement in a separate process, alternating between the sizes, as the median of several
rounds. Prints seconds, and the time per row in the larger results relative to the smaller. Finally
it measures what joining the parts of finished runs saves. It writes and removes about 0.5 GB.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa

from jbench.settings.base import settings_hash
from jbench.store import Record, Results, schema

SQL = (
    "SELECT algo, representation, seed, avg(episode_return) AS mean FROM episodes JOIN runs "
    "USING (run) GROUP BY ALL ORDER BY ALL"
)
LOAD_AND_QUERY = f"""
import sys, time
from pathlib import Path
from jbench.store import Results, query
began = time.perf_counter()
rows, problems, _ = query.query_results(Results(Path(sys.argv[1])), {SQL!r})
assert not problems
print(time.perf_counter() - began)
"""
JBENCH = (sys.executable, "-m", "jbench")
COMMIT_EVERY = 50  # episodes; a run of 5,000 commits about 100 times


def settings_of(number: int, episodes: int) -> dict[str, object]:
    """Returns settings like those of a run of `jbench train`."""
    algo, representation = ("ddpg", "td3")[number % 2], ("full", "dae12")[number // 2 % 2]
    return {
        **{"task": "face_direction", "algo": algo, "representation": representation},
        **{"encoder": None, "seed": number // 4, "steps": 1000 * episodes, "engine": "sb3"},
        **{"time_limit": "bootstrap", "evaluate_every": 50000, "evaluate_episodes": 10},
        "hyperparameters": {"hidden_layers": [350, 250], "learning_rate": 1e-4, "gamma": 0.99},
    }


def rows_of(run: str, number: int, episodes: int) -> pa.Table:
    """Returns episodes with noisy returns, times and the losses of an actor and a critic."""
    random = np.random.default_rng(number)
    columns = {
        "run": [run] * episodes,
        "episode": np.arange(episodes),
        "control_steps": 1000 * np.arange(1, episodes + 1),
        "episode_return": random.normal(500, 100, episodes),
        "length": np.full(episodes, 1000),
        "wall_time": random.uniform(5, 6, episodes).cumsum(),
        "actor_loss": random.normal(size=episodes),
        "critic_loss": random.normal(size=episodes),
    }
    arrays = [
        pa.array(columns[field.name], field.type)
        if field.name in columns
        else pa.nulls(episodes, field.type)
        for field in schema.EPISODES
    ]
    return pa.table(arrays, schema=schema.EPISODES)


def add_run(results: Results, number: int, episodes: int) -> Record:
    """Makes a run that has not ended."""
    settings = settings_of(number, episodes)
    name = "/".join(str(settings[part]) for part in ("task", "algo", "representation"))
    id = f"{name}/s{settings['seed']:02d}-{settings_hash(settings)}"
    return results.create("run", id, settings)


def generate(path: Path, runs: int, episodes: int) -> Results:
    """Makes finished runs."""
    results = Results(path)
    for number in range(runs):
        record = add_run(results, number, episodes)
        record.append({"episodes": rows_of(record.id, number, episodes)})
        record.finish({"wall_time": 5.5 * episodes, "steps_done": 1000 * episodes})
    return results


def size_of(path: Path) -> tuple[int, float]:
    """Returns the number of files and their total size in MB."""
    found = [file for file in path.rglob("*") if file.is_file()]
    return len(found), sum(file.stat().st_size for file in found) / 1e6


def load_and_query(path: Path) -> float:
    """Returns the seconds to load and query the results in a process, without its imports."""
    command = [sys.executable, "-c", LOAD_AND_QUERY, str(path)]
    return float(subprocess.run(command, capture_output=True, check=True, text=True).stdout)


def command_time(*arguments: str) -> Callable[[Path], float]:
    """Returns a function that measures the seconds of a command, including its start."""

    def measure(path: Path) -> float:
        command = [*JBENCH, *arguments, "--results", str(path)]
        began = time.perf_counter()
        subprocess.run(command, capture_output=True, check=True)
        return time.perf_counter() - began

    return measure


MEASURES: dict[str, Callable[[Path], float]] = {
    "loading and a grouped query, in Python": load_and_query,
    "jbench query, the same": command_time("query", SQL),
    "jbench runs": command_time("runs"),
    "jbench runs --returns": command_time("runs", "--returns"),
    "jbench verify": command_time("verify"),
}


def measure_sizes(directory: Path, sizes: list[int], episodes: int, rounds: int) -> None:
    """Prints the time of each measure at each size."""
    paths = {}
    for runs in sizes:
        began = time.perf_counter()
        paths[runs] = generate(directory / str(runs), runs, episodes).path
        files, megabytes = size_of(paths[runs])
        print(
            f"{runs:,} runs x {episodes:,} episodes = {runs * episodes:,} rows: {files:,} files "
            f"({files / runs:.1f} per run), {megabytes:,.0f} MB, made in "
            f"{time.perf_counter() - began:.0f} s",
            flush=True,
        )
    for name, measure in MEASURES.items():
        times: dict[int, list[float]] = {runs: [] for runs in sizes}
        for _ in range(rounds):
            for runs, path in paths.items():
                times[runs].append(measure(path))
        middle = {runs: statistics.median(times[runs]) for runs in sizes}
        ratio = middle[sizes[-1]] / middle[sizes[0]] / (sizes[-1] / sizes[0])
        at_sizes = ", ".join(
            f"{seconds:.2f} s at {runs:,} runs" for runs, seconds in middle.items()
        )
        print(f"{name}: {at_sizes}; per row {ratio:.2f} times as long in the larger", flush=True)


def measure_joining(directory: Path, runs: int, episodes: int) -> None:
    """Prints what joining the parts of finished runs saves."""
    results = Results(directory / "parts")
    records = []
    for number in range(runs):
        record = add_run(results, number, episodes)
        rows = rows_of(record.id, number, episodes)
        for first in range(0, episodes, COMMIT_EVERY):
            record.append({"episodes": rows.slice(first, COMMIT_EVERY)})
        records.append(record)
    for state in ("in parts", "joined"):
        files, megabytes = size_of(results.path)
        seconds = statistics.median(load_and_query(results.path) for _ in range(3))
        print(
            f"{runs} runs {state}: {files / runs:.1f} files and {megabytes / runs:.2f} MB per run, "
            f"{seconds:.2f} s to load and query",
            flush=True,
        )
        for record in records:
            record.finish({})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, nargs="+", default=[200, 2000], help="sizes to compare")
    parser.add_argument("--episodes", type=int, default=5000, help="of each run")
    parser.add_argument("--rounds", type=int, default=3, help="of which the median is taken")
    parser.add_argument("--directory", type=Path, help="where to work; else a temporary one")
    arguments = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory(dir=arguments.directory) as directory:
        measure_sizes(Path(directory), sorted(arguments.runs), arguments.episodes, arguments.rounds)
        measure_joining(Path(directory), 20, arguments.episodes)
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
