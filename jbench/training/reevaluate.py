"""Repeats the last evaluation of a finished run with the policy that was kept."""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.agents.batched.engine import Engine
from jbench.cores import cores, one_thread
from jbench.devices import find_device
from jbench.errors import RequestError
from jbench.policies.saved import TrainedAgent, has_policy, load_agent
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings, Unreadable, read_run
from jbench.store import Record, Results
from jbench.training.engines import make_trainer
from jbench.training.evaluation import Evaluator, evaluate_policy, seeds_of
from jbench.training.log import POLICY_EVALUATION

Verdict = Literal["equal", "different", "no policy", "not comparable"]
"""Whether the returns of the kept policy are the recorded ones, bit for bit; `not comparable`:
the record does not contain what is needed to repeat its last evaluation."""


class Reevaluation(NamedTuple):
    """Outcome for one run.

    Attributes:
        run: id.
        verdict: see `Verdict`.
        reason: why it is not comparable, or how it differs, as a sentence; otherwise empty.
        control_steps: at which the evaluation was made; None if it was not repeated.
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
        """Whether the evaluation could be repeated and compared."""
        return self.verdict in ("equal", "different")


class _Last(NamedTuple):
    """The last evaluation of a run."""

    number: int
    control_steps: int
    returns: NDArray[np.float64]


def reevaluate(results: Results, record: Record) -> Reevaluation:
    """Repeats the last evaluation of a run: the same initial states, with the kept policy.

    On the same kind of processor with the same versions, the returns are the same bits.

    Args:
        results: results directory of the run; contains its encoder.
        record: finished run.

    Raises:
        WorkError: if a file of the run is damaged.
    """
    if not has_policy(record):
        return Reevaluation(record.id, "no policy", "It was saved without its policy.")
    settings, last = read_run(record.settings), _last_evaluation(record)
    if isinstance(settings, Unreadable):
        return _not_comparable(record, "Another program or version wrote its settings.")
    if last is None:
        return _not_comparable(record, "It has no evaluation.")
    if settings.engine == "plugin":
        return _not_comparable(
            record,
            "Its evaluations ran the agent's own code; the kept copy rounds its sums differently.",
        )
    if last.number != _evaluated_by_policy(record, settings):
        return _not_comparable(
            record,
            "Its last evaluation was not made with the policy that was kept: with one before the "
            "last updates, as in older versions of jbench, or with a function of the caller.",
        )
    if len(last.returns) < settings.evaluate_episodes:
        reason = f"It has {len(last.returns)} of {settings.evaluate_episodes} episodes."
        return Reevaluation(record.id, "different", reason, last.control_steps)
    try:
        with one_thread():
            computed = _returns(results, record, settings, last)
    except (RequestError, ValueError) as error:
        return _not_comparable(record, f"Its policy can't be run: {str(error).rstrip('.')}.")
    equal = np.array_equal(last.returns, computed)
    reason = "" if equal else _difference(last.returns, computed)
    return Reevaluation(
        record.id,
        "equal" if equal else "different",
        reason,
        last.control_steps,
        tuple(last.returns.tolist()),
        tuple(computed.tolist()),
    )


def device_for(provenance: Mapping[str, Any]) -> str:
    """Returns the device that a run was trained on, if it exists here; otherwise `cpu`."""
    wanted = provenance.get("device") == "cuda"
    return find_device("auto").type if wanted else "cpu"


def _not_comparable(record: Record, reason: str) -> Reevaluation:
    return Reevaluation(record.id, "not comparable", reason)


def _difference(recorded: NDArray[np.float64], computed: NDArray[np.float64]) -> str:
    """Returns a sentence on the first episode that differs."""
    (which,) = np.nonzero(recorded != computed)
    first = int(which[0])
    return (
        f"{len(which)} of {len(recorded)} episodes differ, the first of them in episode {first}: "
        f"recorded {float(recorded[first])!r}, here {float(computed[first])!r}."
    )


def _last_evaluation(record: Record) -> _Last | None:
    rows = record.read("evaluations").to_pandas(use_threads=False)
    if rows.empty:
        return None
    number = int(rows["evaluation"].max())
    last = rows[rows["evaluation"] == number].sort_values("episode")
    control_steps = int(last["control_steps"].max())
    return _Last(number, control_steps, last["episode_return"].to_numpy(np.float64))


def _evaluated_by_policy(record: Record, settings: RunSettings | ExternalSettings) -> int | None:
    """Returns the number of the evaluation that ran the kept policy, or None.

    Older versions did not record it. They kept the policy after the last updates, which was
    evaluated only if no evaluation was due at the last control step.
    """
    number = record.manifest.summary.get(POLICY_EVALUATION)
    if number is not None or isinstance(settings, ExternalSettings):
        return number if isinstance(number, int) else None
    rows = record.read("evaluations")
    steps = np.unique(rows["control_steps"].to_numpy())
    previous = int(steps[-2]) if len(steps) > 1 else 0
    was_due = steps[-1] // settings.evaluate_every != previous // settings.evaluate_every
    return None if was_due else int(rows["evaluation"].to_numpy().max())


def _returns(
    results: Results, record: Record, settings: RunSettings | ExternalSettings, last: _Last
) -> NDArray[np.float64]:
    """Returns the returns (episodes,) of the last evaluation with the kept policy.

    Raises:
        RequestError: if the encoder is missing.
        ValueError: if the policy does not have the layers of the settings.
    """
    agent = load_agent(results, record.id)
    _, evaluation_seed = seeds_of(settings.seed)
    if isinstance(settings, ExternalSettings):
        own = evaluate_policy(settings, evaluation_seed, last.number, agent.act, cores())
        return own.returns
    if settings.engine == "sb3":
        return _of_sb3(settings, agent, evaluation_seed, last)
    device = device_for(record.manifest.provenance)
    with make_trainer([settings], [agent.encoder], device) as engine:
        assert isinstance(engine, Engine)
        engine.load_policy(0, agent.policy, last.control_steps)
        evaluator = Evaluator(settings, [evaluation_seed])
        evaluator.restore(last.number, last.control_steps)
        return evaluator(engine, len(last.returns))[0].returns


def _of_sb3(
    settings: RunSettings, agent: TrainedAgent, seed: int, last: _Last
) -> NDArray[np.float64]:
    from jbench.training import sb3_run  # stable-baselines3 takes a second to import

    evaluator = sb3_run.SB3Evaluator(settings, agent.encoder, seed)
    evaluator.skip(last.number)
    evaluator.final_episodes = len(last.returns)
    outcome, _ = evaluator(agent.policy.act, last.control_steps)
    return np.array([episode_return for episode_return, _ in outcome])
