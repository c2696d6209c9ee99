"""Compares the training speed with stable-baselines3 and SBX: `python benchmarks/train.py`.

It measures whole training on `face_direction` with the published networks and one update per
control step (`--task dmc:cheetah-run` and the like: with the settings for the suite, without SBX):
two single-threaded processes with five of ten seeds each, against two processes of each library
with one seed each. All processes stay in memory and run alternately for a few seconds, so that
other work on the machine affects them equally; a ratio is the median over the rounds. Rates are per
second of wall time and per second of processor time, which other processes do not take. A return is
the mean of the training episodes in the last 10,000 control steps before the step that all
contenders have reached; with `--steps 200000`, it is at least that one. Then it measures DDPG's
update relative to its own matrix products, and what takes the time of whole training with the
published settings.

SBX is built on JAX and needs a separate environment: `--make-sbx DIR` creates it and compares with
it, `--sbx-python DIR/bin/python` reuses it.

`benchmarks/gpu.py` measures a GPU.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from pathlib import Path
from statistics import fmean, median
from typing import Any, NamedTuple

from jbench.names import ONE_THREAD

HERE = Path(__file__).parent
SBX = "sbx-rl==0.28.0"
SEEDS, TASK = 10, "face_direction"
CLOCKS = ("wall", "processor")

Request = dict[str, Any]


class Contender(NamedTuple):
    """Processes that train side by side, one for each core."""

    name: str
    processes: list[subprocess.Popen[str]]

    def run(self, seconds: float) -> dict[str, Any]:
        """Returns the control steps per second over all its seeds, by clock.

        Also the `steps` of each seed since the start, and its `episodes`; see `train_worker.py`.
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
        raise SystemExit(f"A process ended without an answer: {process.args}")
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
            stderr=subprocess.DEVNULL,
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


def contenders_of(
    algo: str, task: str, sbx_python: str | None
) -> list[tuple[str, str, list[Request]]]:
    """Returns names, interpreters and requests of the contenders on one algorithm."""
    cores = sorted(os.sched_getaffinity(0))[:2]

    def requests(kind: str, seeds: Sequence[Sequence[int]], **more: Any) -> list[Request]:
        return [
            {"kind": kind, "task": task, "algo": algo, "core": core, "seeds": list(its), **more}
            for core, its in zip(cores, seeds, strict=True)
        ]

    shares = [range(i, SEEDS, len(cores)) for i in range(len(cores))]
    one = [[i] for i in range(len(cores))]
    low = {"options": {"precision": "bfloat16"}}
    found = [
        ("stable-baselines3", sys.executable, requests("sb3", one)),
        ("batched, 10 seeds", sys.executable, requests("batched", shares)),
        ("… 1 seed per core", sys.executable, requests("batched", one)),
    ]
    if algo != "ppo":  # refused in bfloat16
        found.append(("… in bfloat16", sys.executable, requests("batched", shares, **low)))
    if sbx_python is not None and algo != "ppo" and task == TASK:
        found.append(("SBX", sbx_python, requests("sbx", one)))
    return found


def compare(algo: str, arguments: argparse.Namespace) -> None:
    """Prints the control steps per second of all contenders and their ratios to the libraries."""
    with ExitStack() as stack:
        wanted = contenders_of(algo, arguments.task, arguments.sbx_python)
        contenders = [stack.enter_context(contender(*each)) for each in wanted]
        rounds: list[dict[str, dict[str, Any]]] = []
        reached = 0
        while len(rounds) < arguments.rounds or reached < arguments.steps:
            rounds.append({each.name: each.run(arguments.seconds) for each in contenders})
            reached = min(each["steps"] for each in rounds[-1].values())
    for name in rounds[0]:
        line = f"{algo:5} {name:18}"
        for clock in CLOCKS:
            line += f" | {median(each[name][clock] for each in rounds):7.1f}/s of {clock} time"
            for peer in ("stable-baselines3", "SBX"):
                if peer in rounds[0]:
                    ratio = median(each[name][clock] / each[peer][clock] for each in rounds)
                    line += f", {ratio:4.2f} x {peer}"
        last = [r for at, r in rounds[-1][name]["episodes"] if reached - 10_000 < at <= reached]
        line += f" | return {fmean(last):.1f}" if last else " | no episode"
        print(f"{line} at {reached:,} control steps", flush=True)


def make_sbx(directory: Path) -> str:
    """Creates an environment with SBX and the physics; returns its interpreter."""
    needed = [f"{name}=={version(name)}" for name in ("mujoco", "dm-control", "array-api-compat")]
    subprocess.run([sys.executable, "-m", "venv", directory], check=True)
    python = str(directory / "bin" / "python")
    subprocess.run([python, "-m", "pip", "install", "--quiet", SBX, *needed], check=True)
    return python


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--algos", default="ddpg,td3,sac,ppo", help="algorithms to compare")
    parser.add_argument("--task", default=TASK, help="task to train on")
    parser.add_argument("--sbx-python", help="interpreter of an environment with SBX")
    parser.add_argument("--make-sbx", type=Path, metavar="DIR", help="create such an environment")
    parser.add_argument("--rounds", type=int, default=7, help="rounds of all contenders")
    parser.add_argument("--steps", type=int, default=0, help="of each seed, at least")
    parser.add_argument("--seconds", type=float, default=3.0, help="per contender and round")
    arguments = parser.parse_args()
    import shares
    from update_rates import cpu_rows

    if arguments.make_sbx is not None:
        arguments.sbx_python = make_sbx(arguments.make_sbx)
    for algo in arguments.algos.split(","):
        compare(algo, arguments)
    cpu_rows()
    shares.rows()


if __name__ == "__main__":
    main()
