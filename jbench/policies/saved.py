"""The kept policies of runs, usable without the library that trained them."""

from dataclasses import dataclass
from pathlib import Path

from jbench.encoders import Encoder, load_encoder, on_observations
from jbench.errors import RequestError, WorkError
from jbench.policies.network import SavedNetwork
from jbench.settings.records import EXTERNAL, Specs
from jbench.simulation.find import check_specs, find_task
from jbench.store import Record, Results
from jbench.store.shipped import results_to_read
from jbench.tasks.geometry import Array
from jbench.wording import with_results

WEIGHTS = "policy.safetensors"
DESCRIPTION = "policy.json"


def policy_files(policy: SavedNetwork | None) -> dict[str, bytes]:
    """Returns a policy as files by name; none for None."""
    return {} if policy is None else dict(zip((WEIGHTS, DESCRIPTION), policy.files(), strict=True))


@dataclass(frozen=True)
class TrainedAgent:
    """The policy of a finished run together with its encoder."""

    task: str
    policy: SavedNetwork
    encoder: Encoder | None

    def act(self, observations: Array) -> Array:
        """Returns actions (..., action_size) for observations (..., dim(O)), or a RequestError."""
        size = find_task(self.task).observation_size
        if observations.shape[-1:] != (size,):
            raise RequestError(
                f"The agent was trained on {self.task}: pass observations of the shape "
                f"(..., {size}), not {observations.shape}."
            )
        return on_observations(self.encoder, self.policy.act)(observations)


def has_policy(record: Record) -> bool:
    """Returns whether a run was saved with its policy; most shipped runs were not."""
    return {WEIGHTS, DESCRIPTION} <= {entry.name for entry in record.manifest.files}


def load_agent(results: Results | Path | str, run: str) -> TrainedAgent:
    """Returns the trained agent of a finished run, by its whole id; see `results_to_read`.

    Raises a RequestError if the run does not exist, has not finished, or was saved without its
    policy, or its task is not installed or has changed, and a WorkError if its files are damaged.
    """
    results = results_to_read(results)
    record = results.find("run", run)
    if record is None:
        runs = with_results("jbench runs", results.name)
        raise RequestError(f"No run {run} in {results.name}; {runs} lists them.")
    if record.status != "finished":
        raise RequestError(f"The run {run} is {record.status}: it has no trained policy yet.")
    if not has_policy(record):
        recorded = record.settings.get("engine") == EXTERNAL
        keep = " Its loop must call recording.keep_policy(actor)." if recorded else ""
        raise RequestError(f"The run {run} in {results.name} was saved without its policy.{keep}")
    try:
        policy = SavedNetwork.from_files(*map(record.read_file, (WEIGHTS, DESCRIPTION)))
    except ValueError as error:
        raise WorkError(f"The policy of {run} can't be read ({error}).") from None
    task, encoder = (record.settings.get(name, 0) for name in ("task", "encoder"))
    if not isinstance(task, str) or not isinstance(encoder, str | None):
        raise WorkError(f"The settings of the run {run} lack a task or an encoder.")
    specs = record.settings.get("specs")
    check_specs(task, None if specs is None else Specs.model_validate(specs))
    loaded = None if encoder is None else load_encoder(results, encoder)[0]
    return TrainedAgent(task, policy, loaded)
