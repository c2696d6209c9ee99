"""Measures `jbench report` on generated results: `python benchmarks/report.py`.

Makes results of 200 and of 2,000 runs of 5,000 episodes (five tasks, four algorithms; the runs are
seeds, or with --variants also settings) and writes their report, each time in a process of its own.
Prints seconds and peak memory of the whole command, its start included, the median of several
rounds that alternate between the sizes, and with --beside between this version and another checkout
of jbench; how long the page alone takes, as `--watch` writes it; and with --profile where the time
goes. It writes and removes about 0.5 GB.
"""

import argparse
import cProfile
import io
import os
import pstats
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from database import rows_of

from jbench.names import TASKS
from jbench.settings.algorithms import ALGORITHMS
from jbench.settings.base import settings_hash
from jbench.store import Record, Results

MEASURED = """
import resource, sys
from jbench.cli import main
code = main(sys.argv[1:])
used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
processor = sum(one.ru_utime + one.ru_stime for one in used)
print(code, processor, max(one.ru_maxrss for one in used), file=sys.stderr)
"""


class Measure(NamedTuple):
    """Of one report: seconds by the clock and of the processor, and MB of its largest process."""

    seconds: float
    processor: float
    megabytes: float


def settings_of(number: int, episodes: int, variants: int) -> dict[str, object]:
    """Returns settings like those of a run of `jbench train`."""
    number, variant = divmod(number, variants)
    number, task = divmod(number, len(TASKS))
    seed, algo = divmod(number, len(ALGORITHMS))
    return {
        **{"task": TASKS[task], "algo": ALGORITHMS[algo], "representation": "full"},
        **{"encoder": None, "seed": seed, "steps": 1000 * episodes, "engine": "sb3"},
        **{"time_limit": "bootstrap", "evaluate_every": 50000, "evaluate_episodes": 10},
        "hyperparameters": {"hidden_layers": [350, 250], "learning_rate": 1e-4 * (1 + variant)},
    }


def begin(results: Results, number: int, episodes: int, variants: int) -> Record:
    """Makes a run without episodes."""
    settings = settings_of(number, episodes, variants)
    name = "/".join(str(settings[part]) for part in ("task", "algo", "representation"))
    id = f"{name}/s{settings['seed']:02d}-{settings_hash(settings)}"
    return results.create("run", id, settings)


def generate(path: Path, runs: int, episodes: int, variants: int) -> None:
    """Makes finished runs."""
    results = Results(path)
    for number in range(runs):
        record = begin(results, number, episodes, variants)
        record.append({"episodes": rows_of(record.id, number, episodes)})
        record.finish({"wall_time": 5.5 * episodes, "steps_done": 1000 * episodes})


def measure(path: Path, root: Path, *options: str) -> Measure:
    """Writes a report by a checkout of jbench, in a process of its own."""
    command = [sys.executable, "-P", "-c", MEASURED, "report", "--results", str(path), *options]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    began = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    seconds = time.perf_counter() - began
    code, *numbers = done.stderr.splitlines()[-1].split()
    if code != "0":
        raise SystemExit(done.stderr)
    processor, kibibytes = map(float, numbers)
    return Measure(seconds, processor, kibibytes * 1024 / 1e6)


def page(path: Path, rounds: int) -> list[float]:
    """Returns the seconds of the page alone, as `--watch` writes it again and again."""
    from jbench.report.report import write_report
    from jbench.report.request import Request

    seconds = []
    for _ in range(rounds):
        began = time.perf_counter()
        write_report(Results(path), path / "report", Request(watched=True))
        seconds.append(time.perf_counter() - began)
    return seconds


def profile(path: Path, lines: int) -> str:
    """Returns where the time of a report goes, function by function."""
    from jbench.report.report import write_report

    profiler = cProfile.Profile()
    profiler.runcall(write_report, Results(path), path / "report")
    text = io.StringIO()
    pstats.Stats(profiler, stream=text).sort_stats("cumulative").print_stats("jbench", lines)
    return text.getvalue()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, nargs="+", default=[200, 2000], help="sizes to compare")
    parser.add_argument("--episodes", type=int, default=5000, help="of each run")
    parser.add_argument("--variants", type=int, default=1, help="settings of each cell")
    parser.add_argument("--rounds", type=int, default=3, help="of which the median is taken")
    parser.add_argument("--profile", type=int, default=0, help="lines of a profile of the smallest")
    parser.add_argument("--directory", type=Path, help="where to work; else a temporary one")
    parser.add_argument("--beside", type=Path, help="root of another checkout to measure as well")
    arguments = parser.parse_args()
    roots = [Path(__file__).resolve().parents[1], *filter(None, [arguments.beside])]
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}", flush=True)
    sizes = sorted(arguments.runs)
    with tempfile.TemporaryDirectory(dir=arguments.directory) as directory:
        paths = {runs: Path(directory) / str(runs) for runs in sizes}
        for runs, path in paths.items():
            print(f"making {runs:,} runs", file=sys.stderr, flush=True)
            generate(path, runs, arguments.episodes, arguments.variants)
        for options in ((), ("--claims",)):
            rounds = [
                {
                    (root, runs): measure(path, root, *options)
                    for runs, path in paths.items()
                    for root in roots
                }
                for _ in range(arguments.rounds)
            ]
            for root, runs in rounds[0]:
                measured = zip(*(found[root, runs] for found in rounds), strict=True)
                middle = Measure(*map(statistics.median, measured))
                print(
                    f"{root.name}: {' '.join(('jbench report', *options))}, {runs:,} runs x "
                    f"{arguments.episodes:,} episodes: {middle.seconds:.1f} s "
                    f"({middle.processor:.1f} s of the processor), {middle.megabytes:,.0f} MB",
                    flush=True,
                )
        times = page(paths[sizes[0]], arguments.rounds)
        print(f"the page alone, {sizes[0]:,} runs: {statistics.median(times):.2f} s", flush=True)
        if arguments.profile:
            print(profile(paths[sizes[0]], arguments.profile))
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
