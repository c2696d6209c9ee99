"""Compares the training speed with stable-baselines3 and SBX: `python benchmarks/train.py`.

It measures whole training on `face_direction` with the published networks and one update per
control step (`--task dmc:cheetah-run` and the like: with the settings for the suite, without SBX):
two single-threaded processes with five of ten seeds each, against two processes of each library
with one seed each. All processes stay in memory and run alternately for a few seconds, so that
other work on the machine affects them equally; a ratio is the median over the rounds. Rates are per
second of wall time and per second of processor time, which other processes do not take. Then it
measures DDPG's update relative to its own matrix products, and what takes the time of whole
training with the published settings (`benchmarks/shares.py`).

`--cores 1,2` measures ten seeds on 1 and on 2 cores with the settings as published instead, and
predicts the hours of Figure 8 (`benchmarks/cost.py`).

`--steps 50000` compares returns instead: five seeds of stable-baselines3 and five of jbench train
alternately for 50,000 control steps each. After each tenth it prints the rates, the mean return of
each seed's episodes in that tenth, and whether the median of jbench's seeds is between the lowest
and the highest of stable-baselines3's.

`--normalize` compares jbench with and without standardized inputs instead.

SBX is built on JAX and needs a separate environment: `--make-sbx DIR` creates it and compares with
it, `--sbx-python DIR/bin/python` reuses it.

`benchmarks/gpu.py` measures a GPU.
"""

import argparse
import json
import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from pathlib import Path
from statistics import fmean, median
from typing import Any, NamedTuple

from jbench.cores import ONE_THREAD
from jbench.numbers import whole

HERE = Path(__file__).parent
SBX = "sbx-rl==0.28.0"
SEEDS, TASK = 10, "face_direction"
RETURN_SEEDS = 5
RETURN_PARTS = 10
CORES = sorted(os.sched_getaffinity(0))[:2]
CLOCKS = ("wall", "processor")

Request = dict[str, Any]


class Contender(NamedTuple):
    """Processes that train side by side, one for each core."""

    name: str
    processes: list[subprocess.Popen[str]]

    def run(self, seconds: float) -> dict[str, Any]:
        """Returns the control steps per second over all its seeds, by clock.

        Also the `steps` of each seed since the start, and the `episodes`; see `train_worker.py`.
        """
        for process in self.processes:
            assert process.stdin is not None
            process.stdin.write(json.dumps({"seconds": seconds}) + "\n")
            process.stdin.flush()
        answers = [_read_answer(process) for process in self.processes]
        return {
            **{clock: sum(answer[clock] for answer in answers) for clock in CLOCKS},
            "steps": min(answer["steps"] for answer in answers),
            "episodes": [episode for answer in answers for episode in answer["episodes"]],
        }


def _read_answer(process: subprocess.Popen[str]) -> dict[str, Any]:
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:
        raise SystemExit(f"{process.args!r} ended with exit code {process.wait()}; see above.")
    answer: dict[str, Any] = json.loads(line)
    return answer


@contextmanager
def contender(name: str, python: str, requests: list[Request]) -> Iterator[Contender]:
    """Starts the processes of a contender and waits until they are ready."""
    environment = {
        **os.environ,
        **ONE_THREAD,
        "MUJOCO_GL": "disable",
        "PYTHONPATH": str(HERE.parent),
        "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    }
    processes = [
        subprocess.Popen(
            [python, str(HERE / "train_worker.py"), json.dumps(request)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        for request in requests
    ]
    try:
        for process in processes:
            _read_answer(process)
        yield Contender(name, processes)
    finally:
        for process in processes:
            process.kill()
            process.wait()


def requests(kind: str, algo: str, task: str, seeds: int, **more: Any) -> list[Request]:
    """Returns a request for each core, with its share of the seeds."""
    about = {"kind": kind, "task": task, "algo": algo, **more}
    return [
        {**about, "core": core, "seeds": list(range(first, seeds, len(CORES)))}
        for first, core in enumerate(CORES)
    ]


def compare(algo: str, arguments: argparse.Namespace) -> None:
    """Prints the control steps per second of all contenders and their ratios to the libraries."""
    python, about = sys.executable, (algo, arguments.task)
    low: dict[str, Any] = {"options": {"precision": "bfloat16"}}
    wanted = [
        ("stable-baselines3", python, requests("sb3", *about, len(CORES))),
        ("batched, 10 seeds", python, requests("batched", *about, SEEDS)),
        ("… 1 seed per core", python, requests("batched", *about, len(CORES))),
    ]
    if algo != "ppo":  # refused in bfloat16
        wanted.append(("… in bfloat16", python, requests("batched", *about, SEEDS, **low)))
    if arguments.sbx_python is not None and algo != "ppo" and arguments.task == TASK:
        wanted.append(("SBX", arguments.sbx_python, requests("sbx", *about, len(CORES))))
    with ExitStack() as stack:
        contenders = [stack.enter_context(contender(*each)) for each in wanted]
        rounds = []
        for number in range(1, arguments.rounds + 1):
            print(f"{algo}: round {number} of {arguments.rounds}", file=sys.stderr, flush=True)
            rounds.append({each.name: each.run(arguments.seconds) for each in contenders})
    for name in rounds[0]:
        line = f"{algo:5} {name:18}"
        for clock in CLOCKS:
            line += f" | {median(each[name][clock] for each in rounds):7.1f}/s of {clock} time"
            for peer in ("stable-baselines3", "SBX"):
                if peer in rounds[0]:
                    line += f", {ratio(rounds, name, peer, clock):4.2f} x {peer}"
        print(line, flush=True)


def compare_inputs(algo: str, arguments: argparse.Namespace) -> None:
    """Prints the rates with standardized inputs, relative to those without."""
    changes: dict[str, dict[str, Any]] = {
        "without": {},
        "with": {"changes": {"normalize": "running"}},
    }
    with ExitStack() as stack:
        contenders = []
        for name, more in changes.items():
            asked = requests("batched", algo, arguments.task, SEEDS, **more)
            contenders.append(stack.enter_context(contender(name, sys.executable, asked)))
        rounds = [
            {each.name: each.run(arguments.seconds) for each in contenders}
            for _ in range(arguments.rounds)
        ]
    parts = [f"{ratio(rounds, 'with', 'without', clock):.3f} ({clock} time)" for clock in CLOCKS]
    print(f"{algo:5} rate with standardized inputs: {', '.join(parts)} x without", flush=True)


def ratio(rounds: list[dict[str, dict[str, Any]]], name: str, peer: str, clock: str) -> float:
    """Returns the median over the rounds of a rate relative to that of a peer."""
    return float(median(each[name][clock] / each[peer][clock] for each in rounds))


def compare_returns(algo: str, arguments: argparse.Namespace) -> None:
    """Prints after each tenth of `--steps` the rates and the mean return of each seed."""
    kinds = {"stable-baselines3": "sb3", "batched": "batched"}
    part = arguments.steps // RETURN_PARTS
    with ExitStack() as stack:
        contenders = [
            stack.enter_context(
                contender(name, sys.executable, requests(kind, algo, arguments.task, RETURN_SEEDS))
            )
            for name, kind in kinds.items()
        ]
        for end in range(part, arguments.steps + 1, part):
            rounds: list[dict[str, dict[str, Any]]] = []
            last: dict[str, dict[str, Any]] = {name: {"steps": 0} for name in kinds}
            while behind := [each for each in contenders if last[each.name]["steps"] < end]:
                last |= {each.name: each.run(arguments.seconds) for each in behind}
                if len(behind) == len(contenders):
                    rounds.append(dict(last))

            means = {name: mean_returns(last[name]["episodes"], end - part, end) for name in kinds}
            for name in kinds:
                wall, processor = (ratio(rounds, name, "stable-baselines3", c) for c in CLOCKS)
                returns = " ".join(map(whole, means[name])) or "of no episode that ended"
                print(
                    f"{algo:5} {name:18} {end:,} control steps | {wall:.2f} (wall) and"
                    f" {processor:.2f} (processor) x stable-baselines3 | returns {returns}",
                    flush=True,
                )
            print(f"{algo:5} {position(means['batched'], means['stable-baselines3'])}", flush=True)


def mean_returns(episodes: list[tuple[int, int, float]], first: int, last: int) -> list[float]:
    """Returns the mean of each seed's episodes that ended within control steps, ascending.

    A seed of PPO may have none: its eight robots end an episode every 8,000 control steps.
    """
    returns: dict[int, list[float]] = defaultdict(list)
    for seed, at, value in episodes:
        if first < at <= last:
            returns[seed].append(value)

    return sorted(fmean(its) for its in returns.values())


def position(ours: list[float], theirs: list[float]) -> str:
    """Returns a sentence on where our median is among the returns of stable-baselines3."""
    if not ours or not theirs:
        return "no median to compare: a library has no episode that ended"

    middle = median(ours)
    lowest, highest = min(theirs), max(theirs)
    where = "below" if middle < lowest else "above" if middle > highest else "within"
    return (
        f"the median of batched, {whole(middle)}, is {where} the range of stable-baselines3, "
        f"{whole(lowest)} to {whole(highest)}"
    )


def make_sbx(directory: Path) -> str:
    """Creates an environment with SBX and the physics; returns its interpreter."""
    needed = [f"{name}=={version(name)}" for name in ("mujoco", "dm-control", "array-api-compat")]
    subprocess.run([sys.executable, "-m", "venv", directory], check=True)
    python = str(directory / "bin" / "python")
    subprocess.run([python, "-m", "pip", "install", "--quiet", SBX, *needed], check=True)
    return python


def main() -> None:
    import cost
    import shares
    from update_rates import BURSTS, UPDATES, cpu_rows

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--algos", default="ddpg,td3,sac,ppo", help="algorithms to compare")
    parser.add_argument("--task", default=TASK, help="task to train on")
    parser.add_argument("--sbx-python", help="interpreter of an environment with SBX")
    parser.add_argument("--make-sbx", type=Path, metavar="DIR", help="create such an environment")
    parser.add_argument("--rounds", type=int, default=7, help="rounds of all contenders")
    parser.add_argument("--steps", type=int, help="control steps of each seed, to compare returns")
    parser.add_argument("--seconds", type=float, default=3.0, help="per contender and round")
    parser.add_argument(
        "--cores", type=parse_cores, metavar="N,…", help="numbers of cores, to compare with a model"
    )
    parser.add_argument(
        "--normalize", action="store_true", help="compare with and without standardized inputs"
    )
    parser.add_argument("--bursts", type=int, default=BURSTS, help="bursts of DDPG's updates alone")
    parser.add_argument("--updates", type=int, default=UPDATES, help="updates of a burst")
    parser.add_argument("--share-steps", type=int, help="control steps of the shares of training")
    arguments = parser.parse_args()

    algos = arguments.algos.split(",")
    if arguments.cores is not None:
        cost.rows(arguments.cores, [agent for agent in cost.AGENTS if agent.algo in algos])
        return
    if arguments.normalize:
        for algo in algos:
            compare_inputs(algo, arguments)
        return

    if arguments.make_sbx is not None:
        arguments.sbx_python = make_sbx(arguments.make_sbx)
    if arguments.steps is not None:
        for algo in algos:
            compare_returns(algo, arguments)
        return
    for algo in algos:
        compare(algo, arguments)
    cpu_rows(arguments.bursts, arguments.updates)
    shares.rows({algo: arguments.share_steps or shares.STEPS[algo] for algo in algos})


def parse_cores(text: str) -> list[int]:
    """Returns numbers of cores such as 1,2."""
    return [int(part) for part in text.split(",")]


if __name__ == "__main__":
    main()
