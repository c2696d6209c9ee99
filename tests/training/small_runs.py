"""Settings of short runs, and readers of their rows."""

from collections import Counter

import torch

from jbench.encoders import Encoder
from jbench.settings.algorithms import algorithm_settings
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.store.schema import TIMES
from jbench.training.batched_run import run_batch
from jbench.training.events import Resumed
from jbench.training.request import request_runs


def small_run(algo, overrides, **changes):
    """Returns settings with networks of eight units; `overrides` are of the published settings."""
    overrides = {"hidden_layers": [8], **overrides}
    chosen = algorithm_settings(algo, overrides=overrides).model_dump(mode="json")
    about = {"task": "face_direction", "algo": algo, "seed": 0}
    return RunSettings(**{**about, "hyperparameters": chosen, **changes})


def requested(results, overrides, algo="td3", encoder="none"):
    """Returns the settings of one episode of training as a user requests it."""
    about = {"task": "face_direction", "seeds": [0], "base": "published", "steps": 1000}
    lengths = {"evaluate_every": 1000, "evaluate_episodes": 1}
    chosen = {"algo": algo, "encoder": encoder, "overrides": overrides}
    (run,) = request_runs(results, **about, **lengths, **chosen)
    return run


class TanhEncoder(Encoder):
    """A nonlinear encoder without scaling."""

    def __init__(self, latents=5):
        self._latents = latents

    @property
    def latent_size(self):
        return self._latents

    def encode(self, observations):
        size = observations.shape[-1]
        weights = torch.linspace(-1, 1, size * self._latents).reshape(size, -1)
        return torch.tanh(2 * observations @ weights)


def train(run, results, **options):
    """Trains a run; returns its record, or raises the error of the run."""
    for failure in run_batch([run], results, **options).values():
        raise failure
    return results.find("run", run.id)


def paths(record):
    """Returns the number of rows of each path by evaluation and control steps."""
    found = record.read("paths").to_pylist()
    return dict(Counter((row["evaluation"], row["control_steps"]) for row in found))


def resumed(events, runs):
    """Returns seed, control steps and reason of resumed runs, and the id of one they continue."""
    seeds = {run.id: run.seed for run in runs}
    return [
        (seeds[event.run], event.control_steps, event.text, *filter(None, [event.continues]))
        for event in events
        if isinstance(event, Resumed)
    ]


def train_batch(path, runs, **options):
    """Trains runs without a failure; returns those that were resumed, see `resumed`."""
    events = []
    assert run_batch(runs, Results(path), **{"report": events.append, **options}) == {}
    return resumed(events, runs)


def rows(record):
    """Returns all rows of a run, without times."""
    return [
        {name: value for name, value in row.items() if name not in TIMES}
        for table in ("episodes", "evaluations")
        for row in record.read(table).to_pylist()
    ]
