"""Measures the training of encoders against the usual loops: `python benchmarks/encoders.py`.

One epoch of the denoising autoencoder (16 features, 12 latents, batches of 8192) over rows in
memory is trained by three loops alternately, several times; the best time of each counts. Only the
ratios of the rates are meaningful.

- a DataLoader over a TensorDataset, the usual loop;
- a plain loop over one tensor: a random order, autograd, fused Adam;
- ours, for the denoising autoencoder and for the other learned kinds.

`--whole` writes a dataset of 5,000,000 control steps with random states to a temporary directory,
trains on it from the command line, and prints the wall time and the peak memory of the process.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pyarrow as pa
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader, TensorDataset

from jbench.cores import one_thread
from jbench.datasets.jitterbug import steps_table
from jbench.devices import find_device
from jbench.encoders.kind import Learned
from jbench.encoders.loop import EncoderLearner
from jbench.encoders.pairs import Shard
from jbench.encoders.registry import make_kind
from jbench.encoders.states import States
from jbench.store import Results, schema
from jbench.tasks.jitterbug.geometry import State

SIZE, LATENTS, BATCH, NOISE = 16, 12, 8192, 0.1
STATES = 1001
PUBLISHED_ROWS, PUBLISHED_EPOCHS = 4_000_000, 200
FILE_EPISODES = 25
KINDS = ("ae", "ddae", "vae", "lld-vae")


class Network(nn.Module):
    """The denoising autoencoder in plain torch."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = nn.Linear(SIZE, LATENTS)
        self.decoder = nn.Linear(LATENTS, SIZE)

    def forward(self, rows: Tensor) -> Tensor:
        """Returns the reconstruction."""
        return torch.tanh(self.decoder(torch.tanh(self.encoder(rows))))


def data_loader(rows: Tensor) -> Callable[[], None]:
    network = Network().to(rows.device)
    optimizer = torch.optim.Adam(network.parameters())
    loader = DataLoader(TensorDataset(rows), batch_size=BATCH, shuffle=True)

    def epoch() -> None:
        for (clean,) in loader:
            corrupted = clean + NOISE * torch.randn_like(clean)
            loss = nn.functional.mse_loss(network(corrupted), clean)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()

    return epoch


def plain_loop(rows: Tensor) -> Callable[[], None]:
    network = Network().to(rows.device)
    optimizer = torch.optim.Adam(network.parameters(), fused=True)

    def epoch() -> None:
        for chosen in torch.randperm(len(rows), device=rows.device).split(BATCH):
            clean = rows[chosen]
            corrupted = clean + NOISE * torch.randn_like(clean)
            loss = nn.functional.mse_loss(network(corrupted), clean)
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()

    return epoch


def ours(name: str, shard: Shard) -> Callable[[], None]:
    kind = make_kind(name, {})
    assert isinstance(kind, Learned)
    about = {"size": SIZE, "action_size": 1, "seed": 0, "device": shard.states.device}
    states = SimpleNamespace(learn=lambda random: iter([shard]), **about)
    learner = EncoderLearner(kind, cast(States, states), LATENTS)

    def epoch() -> None:
        with one_thread():
            learner.epoch()

    return epoch


def best_rates(loops: dict[str, Callable[[], None]], rows: int, rounds: int) -> dict[str, float]:
    """Returns the best rows/s of each loop; each round runs every loop once."""
    best = dict.fromkeys(loops, 0.0)
    for number in range(1, rounds + 1):
        print(f"round {number} of {rounds}", file=sys.stderr, flush=True)
        for name, epoch in loops.items():
            began = time.perf_counter()
            epoch()
            if torch.cuda.is_available():
                torch.cuda.synchronize()
            best[name] = max(best[name], rows / (time.perf_counter() - began))
    return best


def compare(rows: int, rounds: int, device: torch.device) -> None:
    episodes = rows // STATES
    random = np.random.default_rng(0)
    values = random.uniform(-1, 1, (episodes, STATES, SIZE)).astype(np.float32)
    actions = random.uniform(-1, 1, (episodes, STATES - 1)).astype(np.float32)
    states, acted = torch.from_numpy(values), torch.from_numpy(actions)
    shard = Shard(states, acted, acted).to(device)
    flat = shard.states.view(-1, SIZE)

    def with_one(epoch: Callable[[], None]) -> Callable[[], None]:
        def run() -> None:
            with one_thread():
                epoch()

        return run

    loops = {
        "DataLoader, all threads": data_loader(flat),
        "DataLoader, one thread": with_one(data_loader(flat)),
        "plain loop, all threads": plain_loop(flat),
        "plain loop, one thread": with_one(plain_loop(flat)),
        "ours: dae": ours("dae", shard),
        **{f"ours: {name}": ours(name, shard) for name in KINDS},
    }
    rates = best_rates(loops, len(flat), rounds)
    print(f"{len(flat):,} rows of {SIZE} features, {device.type}, best of {rounds} rounds")
    for name, rate in rates.items():
        seconds = PUBLISHED_ROWS * PUBLISHED_EPOCHS / rate
        print(
            f"{name:26} {rate / 1e6:8.3f} million rows/s   200 epochs of 4M rows: {seconds:7.0f} s"
        )
    for other in ("DataLoader", "plain loop"):
        usual = max(rate for name, rate in rates.items() if name.startswith(other))
        print(f"dae against the better {other}: {rates['ours: dae'] / usual:.1f} times")


def whole(epochs: int, episodes: int, device: str) -> None:
    """Trains on random states of episodes from the command line."""
    with tempfile.TemporaryDirectory() as path:
        print(f"writing {episodes:,} episodes of random states", file=sys.stderr, flush=True)
        make_dataset(Path(path), episodes)
        command = ("train-dae", "--epochs", str(epochs), "--results", path, "--device", device)
        began = time.perf_counter()
        subprocess.run([sys.executable, "-m", "jbench", *command], check=True)
        wall = time.perf_counter() - began
        memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024 / 1e9
        rows = 4 * episodes // 5 * STATES  # one episode of five is held out
        print(f"{epochs} epochs of {rows:,} rows: {wall:.1f} s, at most {memory:.2f} GB")


def make_dataset(path: Path, episodes: int) -> None:
    """Writes a dataset of random states."""
    random = np.random.default_rng(0)
    record = Results(path).create("dataset", "random/synthetic", {})
    for first in range(0, episodes, FILE_EPISODES):
        shape = (FILE_EPISODES, STATES)
        quaternion = random.normal(size=(*shape, 4))
        quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
        state = State(
            position=np.concatenate([random.normal(0, 0.1, (*shape, 3)), quaternion], -1),
            velocity=random.normal(size=(*shape, 6)),
            motor_position=random.uniform(-np.pi, np.pi, shape),
            motor_velocity=random.uniform(-150, 150, shape),
            torso_velocity=random.normal(0, 0.1, (*shape, 3)),
        )
        actions = random.uniform(-1, 1, (FILE_EPISODES, STATES - 1)).astype(np.float32)
        numbers = np.arange(first, first + FILE_EPISODES)
        targets = {name: np.zeros(FILE_EPISODES) for name in schema.DATASET_EPISODES.names}
        record.append(
            {
                "steps": steps_table(first, state, actions),
                "dataset_episodes": pa.table(targets | {"episode": numbers}).cast(
                    schema.DATASET_EPISODES
                ),
            }
        )
    record.finish({}, join=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=1_000_000, help="in memory")
    parser.add_argument("--rounds", type=int, default=5, help="rounds of all loops")
    parser.add_argument("--device", default="cpu", help="auto, cpu or cuda")
    parser.add_argument(
        "--whole",
        type=int,
        metavar="EPOCHS",
        help="train on 5M control steps from the command line",
    )
    parser.add_argument("--episodes", type=int, default=5000, help="of --whole")
    arguments = parser.parse_args()
    if arguments.whole:
        whole(arguments.whole, arguments.episodes, arguments.device)
    else:
        compare(arguments.rows, arguments.rounds, find_device(arguments.device))


if __name__ == "__main__":
    main()
