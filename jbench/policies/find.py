"""Policies by name: random, constant, heuristic, trained, or of another package."""

import re
from difflib import get_close_matches

import numpy as np

from jbench import plugins
from jbench.errors import RequestError
from jbench.names import HEURISTIC, POLICIES, POLICY_NAMES, REFERENCE, TASKS, closest
from jbench.policies import acting
from jbench.policies.acting import ActingPolicy, installed_policies, is_imported_policy
from jbench.policies.saved import TrainedAgent, has_policy, load_agent
from jbench.policies.sb3_zip import is_sb3_zip, read_sb3_zip, sha256_start
from jbench.settings.recorded import Run, read_run
from jbench.simulation import find_task
from jbench.store import Results
from jbench.store.shipped import shipped_results
from jbench.tasks.heuristics import heuristic

SHIPPED = f"{REFERENCE}/"
"""Prefix of the names of shipped policies; the id of the run follows."""

_CONSTANT = "constant:"
_NUMBER = re.compile(r"-?(\d+\.?\d*|\.\d+)(e-?\d+)?", re.ASCII | re.IGNORECASE)


def find_policy(results: Results, name: str, task: str, seed: int = 0) -> ActingPolicy:
    """Returns a policy by name, see `POLICY_NAMES`; the seed is of the random policy.

    Raises a RequestError if there is no such policy, or it was trained on another task, and a
    WorkError if the policy of another package can't be imported.
    """
    if name == HEURISTIC:
        if task not in TASKS:
            raise RequestError(
                f"There is no hand-written policy of {task}; choose random, constant:U, a trained "
                "policy, or MODULE:NAME."
            )
        policy = heuristic(task)
        return ActingPolicy(policy.act, policy.reset)
    size = find_task(task).action_size
    if name == "random":  # as in the random-policy dataset
        random = np.random.default_rng(np.random.SeedSequence(seed))
        return ActingPolicy(lambda observations: random.uniform(-1, 1, (len(observations), size)))
    if name.startswith(_CONSTANT):
        command = _constant(name)
        return ActingPolicy(lambda observations: np.full((len(observations), size), command))
    if is_imported_policy(name):
        return acting.imported_policy(name, task)
    if is_sb3_zip(name):
        return ActingPolicy(read_sb3_zip(name, task).act)
    if "/" not in name:
        raise _unknown(name)
    run, agent = find_trained_agent(results, name)
    if agent.task != task:
        raise RequestError(
            f"The run {run} was trained on {agent.task}, not {task}; type --task {agent.task}."
        )
    return ActingPolicy(agent.act)


def _constant(name: str) -> float:
    text = name.removeprefix(_CONSTANT)
    # Python also reads 0_1 and +1, but the name is part of an evaluation's id.
    if not _NUMBER.fullmatch(text) or not -1 <= float(text) <= 1:
        raise RequestError(
            f"{name}: a constant command lies in [-1, 1]; type constant:0.5, for example."
        )
    return float(text)


def find_trained_agent(results: Results, name: str) -> tuple[str, TrainedAgent]:
    """Returns the id of a run and its trained agent, also for "reference/" and a shipped run's id.

    Raises a RequestError if there is no such run or policy, a WorkError if its files are damaged.
    """
    located, run = _locate(results, name)
    return run, load_agent(located, run)


def full_name(results: Results, name: str) -> str:
    """Completes the name of a trained policy to the whole id of its run.

    `reference/face_direction/ddpg/full` is short for the only shipped policy of these runs, and
    `face_direction/ddpg` for the only such run of the results. Raises a RequestError if there is no
    such policy, its command is wrong, or several runs match.
    """
    if is_sb3_zip(name):
        return name
    if "/" in name:
        return f"{SHIPPED if name.startswith(SHIPPED) else ''}{_locate(results, name)[1]}"
    if name.startswith(_CONSTANT):
        _constant(name)
    if name.partition(":")[0] in POLICIES or is_imported_policy(name):
        return name
    raise _unknown(name)


def shipped_policies() -> list[str]:
    """Returns the names of all policies shipped with jbench."""
    runs = shipped_results().scan("run")[0]
    return sorted(f"{SHIPPED}{run.id}" for run in runs if has_policy(run))


def find_run(results: Results, name: str) -> Run | None:
    """Returns the settings of a trained policy's run; None if there is none, as of other policies.

    Raises a RequestError if the name is an invalid run id or an unknown shipped policy, and a
    WorkError if the run's manifest can't be read.
    """
    if "/" not in name or is_sb3_zip(name):
        return None
    located, run = _locate(results, name)
    record = located.find("run", run)
    return None if record is None else read_run(record.settings)


def policy_code(name: str) -> str | None:
    """Returns what identifies the code of a policy that is not jbench's; None for the others.

    It is name and version of its package, or the first 16 digits of the SHA-256 of its file.
    """
    if is_sb3_zip(name):
        return sha256_start(name)
    if not is_imported_policy(name):
        return None
    made_with = plugins.provenance("policy", name, installed_policies())
    checksum = made_with.get("source_sha256")
    return checksum[:16] if checksum else made_with.get("package")


def _locate(results: Results, name: str) -> tuple[Results, str]:
    if name.startswith(SHIPPED):
        return shipped_results(), _shipped_run(name)
    return results, results.complete_id("run", name)


def _shipped_run(name: str) -> str:
    names = shipped_policies()
    matches = [shipped for shipped in names if shipped.startswith(name)]
    if len(matches) == 1:
        return matches[0].removeprefix(SHIPPED)
    if matches:
        raise RequestError(
            f"{name} is not unique; type one of {', '.join(matches)} "
            "(jbench runs --results reference shows how they differ)."
        )
    same = [shipped for shipped in names if shipped.startswith(f"{name.rpartition('/')[0]}/")]
    choices = same or sorted(get_close_matches(name, names, 3)) or names
    instead = f"type one of {', '.join(choices)}" if names else "this version of jbench ships none"
    raise RequestError(f"No policy is shipped as {name}; {instead}.")


def _unknown(name: str) -> RequestError:
    close = closest(name, [*POLICIES, *installed_policies()])
    hint = f"did you mean {close}? Choose" if close else "choose"
    return RequestError(f"Unknown policy {name!r}; {hint} {POLICY_NAMES}.")
