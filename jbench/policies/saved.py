"""The trained agents of finished runs, usable without the library that trained them."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jbench.arrays import Array
from jbench.encoders import Encoder, encoder_code, load_run_encoder, on_observations
from jbench.errors import RequestError, WorkError
from jbench.policies.network import DESCRIPTION, WEIGHTS, SavedNetwork
from jbench.settings.records import EXTERNAL
from jbench.settings.specs import Specs
from jbench.store import Record, Results
from jbench.store.code import check_code
from jbench.store.rows import has_policy
from jbench.store.shipped import LEFT_OUT, results_to_read
from jbench.store.weights import check_encoder
from jbench.tasks.find import check_specs, find_task, task_provenance


@dataclass(frozen=True)
class TrainedAgent:
    """The policy of a finished run together with its encoder."""

    task: str
    policy: SavedNetwork = field(repr=False)  # of thousands of numbers
    encoder: Encoder | None = field(repr=False)

    def act(self, observations: Array) -> Array:
        """Returns actions (..., action_size) for observations (..., dim(O)), or a RequestError."""
        size = find_task(self.task).observation_size
        if observations.shape[-1:] != (size,):
            raise RequestError(
                f"The agent was trained on {self.task}: pass observations of the shape "
                f"(..., {size}), not {observations.shape}."
            )
        return on_observations(self.encoder, self.policy.act)(observations)


def agent_code(results: Results, record: Record) -> dict[str, Any]:
    """Returns provenance of the present users' code that runs a saved policy: task and encoder.

    Its layers run without the code that has trained them.
    """
    task = record.settings.get("task")
    encoder = record.settings.get("encoder")
    return {**task_provenance(str(task)), **encoder_code(results, encoder)}


def load_agent(
    results: Results | Path | str, run: str, accept_changed: bool = False
) -> TrainedAgent:
    """Returns the trained agent of a finished run, by its whole id; see `results_to_read`.

    Raises a RequestError if the run does not exist, has not finished, or was saved without its
    policy, its task is not installed, its encoder has other weights than the one at its training,
    or the code of task or encoder has changed, unless that is accepted, and a WorkError if its
    files are damaged.
    """
    results = results_to_read(results)
    record = results.find("run", run)
    if record is None:
        raise results.no_run(run)
    if not record.is_finished:
        raise RequestError(f"The run {run} is {record.status}: it has no trained policy yet.")

    if not has_policy(record):
        raise _without_policy(results, record)

    try:
        policy = SavedNetwork.from_files(record.read_file(WEIGHTS), record.read_file(DESCRIPTION))
    except ValueError as error:
        raise WorkError(f"The policy of {run} can't be read ({error}).") from None

    task = record.settings.get("task")
    encoder = record.settings.get("encoder")
    has_encoder = "encoder" in record.settings and isinstance(encoder, str | None)
    if not isinstance(task, str) or not has_encoder:
        raise WorkError(f"The settings of the run {run} lack a task or an encoder.")
    if not accept_changed:
        check_code(record, agent_code(results, record))

    specs = record.settings.get("specs")
    recorded_specs = Specs.model_validate(specs) if specs else None
    check_specs(task, recorded_specs, accept_changed)
    loaded = load_run_encoder(encoder, results, accept_changed)
    check_encoder(record, results)
    return TrainedAgent(task, policy, loaded)


def _without_policy(results: Results, record: Record) -> RequestError:
    """Returns the error for a finished run that was saved without its policy."""
    if record.left_out:
        return RequestError(f"The policy of {record.id} {LEFT_OUT}.")

    message = f"The run {record.id} in {results.name} was saved without its policy."
    if record.settings.get("engine") == EXTERNAL:
        message += " Its loop must call recording.keep_policy(actor)."
    return RequestError(message)
