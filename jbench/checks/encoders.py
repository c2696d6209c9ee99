"""Checks of kinds of encoders: training, seeds, both array types, shapes, loading."""

import math
import tempfile
from collections.abc import Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
import torch

from jbench.checks.checked import NamedCheck, NotableError
from jbench.datasets import collect, find_dataset
from jbench.encoders import load_encoder
from jbench.encoders.kind import Learned
from jbench.encoders.registry import find_kind, latent_sizes, make_kind
from jbench.encoders.saved import WEIGHTS
from jbench.encoders.settings import encoder_settings, wrong_size
from jbench.encoders.states import States
from jbench.encoders.training import train_encoder
from jbench.errors import RequestError, WorkError
from jbench.settings.base import validated
from jbench.settings.records import DatasetSettings, dataset_robot
from jbench.settings.specs import episode_steps
from jbench.store import Record, Results
from jbench.tasks.find import find_task

_EPISODES = 5
"""Fewest episodes of a random policy that encoders are trained on: a fifth is held out."""

_STEPS = 5000
"""Fewest control steps of these episodes."""

_SEED = 0
"""Seed of every encoder that is trained."""


def checks(
    name: str, task: str, options: Mapping[str, Any], latents: int | None
) -> Iterator[NamedCheck]:
    """Yields the checks of a kind of encoder, and removes what they write."""
    yield "class", partial(_class, name, task, options)
    with tempfile.TemporaryDirectory(prefix="jbench-check-") as folder:
        trial = _Trial(name, task, options, latents, Path(folder))
        yield "options", trial.options_described
        yield "training", trial.training
        yield "seeds", trial.seeds
        yield "shapes", trial.shapes
        yield "torch and numpy", trial.array_types


def _class(name: str, task: str, options: Mapping[str, Any]) -> str:
    """Makes the kind with its options and says how many latents it can have."""
    base = "Fitted"
    if issubclass(find_kind(name), Learned):
        base = "Learned"

    make_kind(name, options)
    sizes = _sizes(name, task, options)
    latents = str(sizes[0])
    if len(sizes) > 1:
        latents = f"{sizes[0]} to {sizes[-1]}"

    return f"a subclass of {base}; {latents} latents on {task}"


def _sizes(name: str, task: str, options: Mapping[str, Any]) -> range:
    """Returns the allowed numbers of latents of a kind; a RequestError if the task has none."""
    sizes = latent_sizes(name, task, options)
    if not sizes:
        raise RequestError(f"{wrong_size(name, task, 0, options)}.")
    return sizes


class _Trial:
    """Encoders of a kind, trained for an epoch on a small dataset in a folder."""

    def __init__(
        self,
        name: str,
        task: str,
        options: Mapping[str, Any],
        latents: int | None,
        folder: Path,
    ) -> None:
        """Encoders are trained in folders of their own below `folder`."""
        self._name = name
        self._task = task
        self._folder = folder
        self._options = dict(options)
        if issubclass(find_kind(name), Learned):
            self._options = {"epochs": 1, "batch": 512, **options}

        sizes = _sizes(name, task, options)
        if latents is None:
            latents = min(12, sizes[-1])

        self._latents = latents
        self._trained = cache(self._train)

    def options_described(self) -> str:
        """Checks that each option has a description."""
        fields = find_kind(self._name).model_fields
        silent = [name for name, field in fields.items() if not field.description]
        if silent:
            raise NotableError(
                f"no description of {', '.join(silent)}: give Field a description, which the help "
                "shows"
            )
        return ", ".join(fields)

    def training(self) -> str:
        """Trains an encoder on a small dataset."""
        record = self._trained("first")
        summary = record.manifest.summary
        explained = summary.get("test_explained")
        steps = self._dataset_settings().steps
        return f"{self._latents} latents of {steps:,} control steps explain {explained:.2f}"

    def seeds(self) -> str:
        """Checks that training again with the same seed gives the same weights."""
        first, again = (
            safetensors.numpy.load(self._trained(place).read_file(WEIGHTS))
            for place in ("first", "again")
        )
        different = [name for name in first if not np.array_equal(first[name], again[name])]
        if different:
            raise WorkError(
                f"training again with the same seed gives other weights ({', '.join(different)}): "
                "draw random numbers from the generators that the methods are given."
            )

        return "the same seed gives the same weights"

    def shapes(self) -> str:
        """Checks the shapes of latents for any leading axes of states."""
        encoder = self._encoder()
        size = find_task(self._task).observation_size
        for shape in ((), (4,), (2, 3)):
            latents = encoder.encode(np.zeros((*shape, size), np.float32))
            if latents.shape != (*shape, self._latents):
                raise WorkError(
                    f"encode returns the shape {latents.shape} for states {(*shape, size)}; it "
                    f"must return {(*shape, self._latents)}."
                )

        return f"(..., {size}) to (..., {self._latents})"

    def array_types(self) -> str:
        """Checks that NumPy and PyTorch give the same latents, each in its own type."""
        encoder = self._encoder()
        size = find_task(self._task).observation_size
        states = np.random.default_rng(0).normal(size=(5, size)).astype(np.float32)
        by_numpy = encoder.encode(states)
        by_torch = encoder.encode(torch.from_numpy(states))
        if not isinstance(by_numpy, np.ndarray) or not isinstance(by_torch, torch.Tensor):
            raise WorkError("encode must return an array of the type that it is given.")

        difference = float(np.abs(by_numpy - by_torch.numpy()).max())
        if not difference < 1e-4:
            raise WorkError(f"encode differs between numpy and torch, by {difference:.2g}.")

        return f"the same latents within {difference:.1g}"

    def _encoder(self) -> Any:
        """Returns the first trained encoder as agents load it."""
        record = self._trained("first")
        return load_encoder(Results(self._folder / "first"), record.id).encoder

    def _dataset_settings(self) -> DatasetSettings:
        """Returns the settings of a small dataset, of whole episodes."""
        task = find_task(self._task)
        length = episode_steps(task.specs)
        episodes = max(_EPISODES, math.ceil(_STEPS / length))
        robot = dataset_robot(task.name, task.specs)
        return validated(DatasetSettings, "a dataset", steps=episodes * length, **robot)

    def _train(self, place: str) -> Record:
        """Collects a small dataset in a place of its own and trains an encoder on it."""
        results = Results(self._folder / place)
        collect(self._dataset_settings(), results, 1)
        dataset = find_dataset(results, None, self._task)
        settings = encoder_settings(
            self._name,
            self._options,
            task=self._task,
            dataset=dataset.id,
            latents=self._latents,
            seed=_SEED,
        )
        scale = make_kind(self._name, self._options).scale
        states = States(dataset, self._task, _SEED, scale=scale)
        return train_encoder(settings, states, results)
