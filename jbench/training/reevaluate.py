"""Repeats the last evaluation of a finished run with the policy that was kept."""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from jbench.agents.batched.engine import BatchedEngine
from jbench.cores import cores, one_thread
from jbench.devices import find_device
from jbench.errors import RequestError
from jbench.policies.saved import has_policy, load_agent
from jbench.settings.recorded import Unreadable, read_run
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.provenance import device_provenance, differences, provenance
from jbench.training.engines import make_trainer
from jbench.training.evaluation import Evaluator, derive_seeds, evaluate_policy
from jbench.training.log import POLICY_EVALUATION

Verdict = Literal["equal", "different", "no policy", "not comparable"]
"""Whether returns are the recorded ones, bit for bit; `not comparable`: the record does not contain
what is needed to repeat its last evaluation."""


class Repeated(NamedTuple):
    """A part of a run that was computed again: its last evaluation, or its first episodes.

    Attributes:
        run: id.
        verdict: see `Verdict`.
        reason: why it is not comparable, or how it differs, as a sentence; otherwise empty.
        control_steps: at its end; None if it was not repeated.
        recorded: returns of its episodes in the database.
        computed: returns of the same episodes here.
    """

    run: str
    verdict: Verdict
    reason: str = ""
    control_steps: int | None = None
    recorded: tuple[float, ...] = ()
    computed: tuple[float, ...] = ()

    @property
    def compared(self) -> bool:
        """Whether it could be repeated and compared."""
        return self.verdict in ("equal", "different")


def reevaluate(results: Results, record: Record) -> Repeated:
    """Repeats the last evaluation of a run: the same initial states, with the kept policy.

    On the same kind of processor with the same versions, the returns are the same bits.

    Args:
        results: results directory of the run; contains its encoder.
        record: finished run.

    Raises:
        WorkError: if a file of the run is damaged.
    """
    if not has_policy(record):
        return Repeated(record.id, "no policy", "It was saved without its policy.")
    settings = read_run(record.settings)
    rows = record.read("evaluations").to_pandas(use_threads=False)
    obstacle = _obstacle(record, settings, rows)
    if isinstance(settings, Unreadable) or obstacle:
        return Repeated(record.id, "not comparable", obstacle)
    last = rows[rows["evaluation"] == rows["evaluation"].max()].sort_values("episode")
    control_steps = int(last["control_steps"].max())
    recorded = last["episode_return"].to_numpy(np.float64)
    if len(recorded) < settings.evaluate_episodes:
        reason = f"It has {len(recorded)} of {settings.evaluate_episodes} episodes."
        return Repeated(record.id, "different", reason, control_steps)
    try:
        with one_thread():
            computed = _returns(
                results, record, settings, int(last["evaluation"].max()), control_steps, len(last)
            )
    except (RequestError, ValueError) as error:
        reason = f"Its policy can't be run: {str(error).rstrip('.')}."
        return Repeated(record.id, "not comparable", reason)
    different, reason = np.flatnonzero(recorded != computed), ""
    if len(different):
        first = int(different[0])
        reason = (
            f"{len(different)} of {len(recorded)} episodes differ, the first of them in episode "
            f"{first}: recorded {float(recorded[first])!r}, here {float(computed[first])!r}."
        )
    verdict: Verdict = "different" if reason else "equal"
    returns = tuple(recorded.tolist()), tuple(computed.tolist())
    return Repeated(record.id, verdict, reason, control_steps, *returns)


def device_for(provenance: Mapping[str, Any]) -> str:
    """Returns the device that a run was trained on, if it exists here; otherwise `cpu`."""
    wanted = provenance.get("device") == "cuda"
    return find_device("auto").type if wanted else "cpu"


def changes_since(record: Record) -> dict[str, list[Any]]:
    """Returns what may round numbers differently: its values when the run began, and now."""
    recorded = record.manifest.provenance
    device = torch.device(device_for(recorded))
    return differences(recorded, {**provenance(), **device_provenance(device)})


def _obstacle(
    record: Record, settings: RunSettings | ExternalSettings | Unreadable, rows: pd.DataFrame
) -> str:
    """Returns why the kept policy can't be compared with the evaluations; "" if it can."""
    if isinstance(settings, Unreadable):
        return "Another program or version wrote its settings."
    if rows.empty:
        return "It has no evaluation."
    if settings.engine == "plugin":
        return (
            "Its evaluations ran the agent's own code; the kept copy rounds its sums differently."
        )
    evaluated = record.manifest.summary.get(POLICY_EVALUATION)
    if evaluated is None and isinstance(settings, RunSettings):
        # Older versions did not record it. They kept the policy after the last updates, which was
        # evaluated only if no evaluation was due at the last control step.
        previous, last = [0, *np.unique(rows["control_steps"]).tolist()][-2:]
        if last // settings.evaluate_every == previous // settings.evaluate_every:
            evaluated = rows["evaluation"].max()
    if evaluated != rows["evaluation"].max():
        return (
            "Its last evaluation was not made with the policy that was kept: with one before the "
            "last updates, as in older versions of jbench, or with a function of the caller."
        )
    return ""


def _returns(
    results: Results,
    record: Record,
    settings: RunSettings | ExternalSettings,
    number: int,
    control_steps: int,
    episodes: int,
) -> NDArray[np.float64]:
    """Returns the returns (episodes,) of an evaluation by the kept policy.

    Args:
        number: of the evaluation.
        control_steps: after which it was made.

    Raises:
        RequestError: if the encoder is missing.
        ValueError: if the policy does not have the layers of the settings.
    """
    agent = load_agent(results, record.id)
    _, seed = derive_seeds(settings.seed)
    if isinstance(settings, ExternalSettings):
        return evaluate_policy(settings, seed, number, agent.act, cores()).returns
    if settings.engine == "sb3":
        from jbench.training.sb3_run import SB3Evaluator  # takes a second to import

        in_turns = SB3Evaluator(settings, agent.encoder, seed)
        in_turns.skip(number)
        in_turns.final_episodes = episodes
        outcome, _ = in_turns(agent.policy.act, control_steps)
        return np.array([episode_return for episode_return, _ in outcome])
    device = device_for(record.manifest.provenance)
    with make_trainer([settings], [agent.encoder], device) as engine:
        assert isinstance(engine, BatchedEngine)
        engine.load_policy(0, agent.policy, control_steps)
        evaluator = Evaluator(settings, [seed])
        evaluator.restore(number, control_steps)
        return evaluator(engine, episodes)[0].returns
