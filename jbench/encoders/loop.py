"""The training loop of all learned kinds: epochs, shuffling, Adam, and checkpoints.

All random numbers come from one generator in a fixed order: the initial weights, then in each
epoch the order of the rows and, several batches at a time, the noise of the kind. The generator is
on the CPU for every device, so every device trains the same encoder up to rounding. Its state is
saved with the weights and Adam's state, so a resumed training ends with the same weights.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pyarrow as pa
import safetensors
import safetensors.torch
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.encoders.adam import FusedAdam
from jbench.encoders.kind import Learned
from jbench.encoders.pairs import StatePairs, state_pairs
from jbench.encoders.registry import sentence_about
from jbench.encoders.saved import SavedEncoder
from jbench.encoders.states import States
from jbench.errors import WorkError
from jbench.store import Record
from jbench.store.encoder_tables import ENCODER_TABLES

CHECKPOINT = "checkpoint.safetensors"

WeightArrays = dict[str, NDArray[np.float32]]

_CHECKED = 8  # rows
_PREPARED = 16  # batches gathered and corrupted at once
_RANDOM = "random.cpu"  # state of the generator in checkpoints


class EncoderLearner:
    """The complete state of a training: weights, optimizer and random generator.

    The weights and their gradients are views of flat tensors, which Adam updates.
    """

    def __init__(self, kind: Learned, states: States, latents: int) -> None:
        """Draws the initial weights with the seed of the states, which have been read."""
        self.kind = kind
        self.states = states
        self.latents = latents
        self.device = states.device
        actions = states.action_size
        self.random = torch.Generator().manual_seed(states.seed)
        several = {"action_size": actions} if kind.uses_actions and actions > 1 else {}
        initial = kind.initial(states.size, latents, self.random, **several)
        flat = torch.cat([value.reshape(-1) for value in initial.values()])
        self._flat = flat.to(self.device, torch.float32)
        self._gradient = torch.zeros_like(self._flat)
        trained = _parts(self._flat, initial)
        self.weights = {name: value.requires_grad_() for name, value in trained.items()}
        self.weights |= kind.constants(states)  # not trained
        self.gradients = _parts(self._gradient, initial)
        self._adam = FusedAdam([self._flat], kind.learning_rate)

    def arrays(self) -> WeightArrays:
        """Returns the weights as numpy arrays."""
        return {name: value.detach().cpu().numpy() for name, value in self.weights.items()}

    def epoch(self) -> float:
        """Trains on every row once, in random order; returns the mean loss."""
        total = torch.zeros((), dtype=torch.float64, device=self.device)
        rows = 0
        batches = self._prepared()
        with ThreadPoolExecutor(1) as pool:  # it prepares the next batches while these are in use
            prepared = pool.submit(next, batches, None).result()
            while prepared is not None:
                following = pool.submit(next, batches, None)
                for batch in prepared.split(self.kind.batch):
                    loss = self.kind.gradient(self.weights, self.gradients, batch)
                    self._adam.step([self._gradient])
                    total += loss * len(batch.now)
                    rows += len(batch.now)
                prepared = following.result()

        return float(total) / rows

    @torch.no_grad()
    def error(self, states: Tensor, targets: Tensor) -> float:
        """Returns the mean squared error of reconstructing targets from states, (rows, size)."""
        rebuilt = self.kind.decode(self.weights, self.kind.encode(self.weights, states))
        return float((rebuilt - targets).square().mean(dtype=torch.float64))

    def to_bytes(self) -> bytes:
        """Returns the state of the training as safetensors."""
        tensors = {"weights": self._flat, _RANDOM: self.random.get_state()}
        return bytes(safetensors.torch.save(tensors | self._moments()))

    def restore(self, content: bytes) -> None:
        """Restores what `to_bytes` returned, on any device; an unusable one is a WorkError."""
        try:
            saved = safetensors.torch.load(content)
            with torch.no_grad():
                self._flat.copy_(saved["weights"])
                for name, moments in self._moments().items():
                    moments.copy_(saved[name])

            self.random.set_state(saved[_RANDOM])
        except (safetensors.SafetensorError, KeyError, ValueError, RuntimeError) as error:
            raise WorkError(
                f"The checkpoint can't be used ({error}); delete the directory of the encoder to "
                "train it from the beginning."
            ) from None

    def _moments(self) -> dict[str, Tensor]:
        """Returns the state of Adam by its names in checkpoints."""
        adam = self._adam
        return {"exp_avg": adam.first[0], "exp_avg_sq": adam.second[0], "step": adam.steps[0]}

    def _prepared(self) -> Iterator[StatePairs]:
        """Yields the batches of an epoch in a random order, prepared by the kind."""
        kind = self.kind
        ahead = self.kind.steps_ahead
        for shard in self.states.learn(self.random):
            pairs = shard.pairs(ahead)
            if not pairs:  # its episodes are all shorter
                continue
            dtype = torch.int32 if pairs < 2**30 else torch.int64
            order = torch.randperm(pairs, generator=self.random, dtype=dtype)
            for indices in order.to(self.device).split(_PREPARED * kind.batch):
                batch = shard.take(indices, ahead, kind.uses_actions)
                yield kind.prepare(batch, self.latents, self.random)


def learn(
    kind: Learned,
    states: States,
    record: Record,
    latents: int,
    *,
    progress: Callable[[int], None],
    commit_every: float,
) -> WeightArrays:
    """Trains the remaining epochs and commits their rows with checkpoints; returns the weights.

    Raises:
        WorkError: if the checkpoint can't be read, or the training diverges.
    """
    learner = EncoderLearner(kind, states, latents)
    if CHECKPOINT in record.roles():
        learner.restore(record.read_file(CHECKPOINT))

    indices = torch.arange(states.sample.pairs(kind.steps_ahead), device=states.device)
    clean = states.sample.take(indices, kind.steps_ahead, kind.uses_actions)
    # A separate generator: measuring an error must not change the training.
    corrupted = kind.prepare(clean, latents, torch.Generator().manual_seed(0)).now
    targets = clean.later if kind.decodes_later else clean.now
    done = record.read("encoder_epochs").to_pylist()
    rows = list[dict[str, Any]]()
    committed = -math.inf
    start = time.perf_counter() - (done[-1]["wall_time"] if done else 0.0)
    progress(len(done))

    for epoch in range(len(done) + 1, kind.epochs + 1):
        loss = learner.epoch()
        if not math.isfinite(loss):
            raise WorkError(
                f"The training of {record.id} diverged: the loss of epoch {epoch} is {loss}; "
                "type a smaller --learning-rate."
            )

        row = {"epoch": epoch, "train_loss": loss, "test_mse": learner.error(clean.now, targets)}
        if corrupted is not clean.now:
            row["test_denoising_mse"] = learner.error(corrupted, targets)
        now = time.perf_counter()
        rows.append({**row, "wall_time": now - start})
        if now - committed >= commit_every or epoch == kind.epochs:
            tables = encoder_tables(record.id, {"encoder_epochs": rows})
            record.append(tables, {CHECKPOINT: learner.to_bytes()})
            rows = []
            committed = now

        progress(epoch)

    return learner.arrays()


def encoder_tables(id: str, rows: Mapping[str, list[dict[str, Any]]]) -> dict[str, pa.Table]:
    """Returns an encoder's rows by table; their column `encoder` is set."""
    return {
        name: pa.Table.from_pylist([{**row, "encoder": id} for row in some], ENCODER_TABLES[name])
        for name, some in rows.items()
    }


def _parts(flat: Tensor, like: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Returns views of a flat tensor in the shapes of named ones."""
    parts = flat.detach().split([value.numel() for value in like.values()])
    return {name: part.view(like[name].shape) for name, part in zip(like, parts, strict=True)}


def check_kind(kind: Learned, name: str, states: States, latents: int) -> None:
    """Calls the methods of a kind of another package, before hours of training: WorkError."""
    with sentence_about(name, "initial or constants"):
        learner = EncoderLearner(kind, states, latents)

    with sentence_about(name, "prepare"):
        pairs = next(state_pairs([states.sample], kind.steps_ahead, kind.uses_actions))
        pairs = kind.prepare(pairs.split(_CHECKED)[0], latents, torch.Generator())

    with sentence_about(name, "loss"):
        kind.gradient(learner.weights, learner.gradients, pairs)

    with sentence_about(name, "encode or decode of numpy arrays"):
        SavedEncoder(kind, learner.arrays(), states.scaling, latents)
