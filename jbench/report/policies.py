"""Policies beside the agents, random and hand-written, and what policies do (Figures 4 and 5)."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jbench.array_types import FloatArray
from jbench.errors import WorkError
from jbench.names import HEURISTIC, REFERENCE, TASKS, is_reference
from jbench.report.analysis.claims import examine_solving
from jbench.report.analysis.findings import SOLVED_BY_HAND, Finding
from jbench.report.data.configuration import Configuration
from jbench.report.data.order import in_order
from jbench.report.data.points import Part, long_frame
from jbench.report.data.untrained import RANDOM, shipped_untrained, untrained_row
from jbench.settings.specs import CODE_CHECKSUMS
from jbench.store import Record, Results
from jbench.wording import with_results

MOTOR = ("task", "policy", "label", "median", "velocity", "density")
POSITIONS = ("task", "policy", "label", "median", "x", "y", "share", "target_yaw", "reach")

RecordedSpecs = Mapping[str, Sequence[Mapping[str, Any]]]
"""By task, what each configuration of a report records of it: its `Specs`."""

FULL_SPEED = 180.0  # rad/s of the motor, an observation of 1
_REACH = 2.0  # m from the origin; the fastest gait moves 0.14 m in a second
_SHOWN = 4  # policies in a figure
_BINS = 80  # of positions, along each axis


def specs_by_task(configurations: Iterable[Configuration]) -> RecordedSpecs:
    """Returns what configurations record of their task, by task; manifests are untrusted."""
    found: dict[str, list[Mapping[str, Any]]] = {}
    for config in configurations:
        found.setdefault(config.task, []).append(_recorded_specs(config.settings.values))
    return found


def _recorded_specs(settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """Returns what settings record of their task, `Specs` if jbench wrote them."""
    specs = settings.get("specs")
    return specs if isinstance(specs, Mapping) else {}


def baseline_frame(shown: RecordedSpecs, tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Returns the returns of policies without training; see `untrained_row` for the columns.

    Those on the Jitterbug are shipped (`benchmarks/baselines.py` writes them). Random actions on
    other robots are those of `jbench evaluate random --task TASK` in the results, if all runs that
    are shown are of the code that was evaluated.

    Args:
        shown: by task, what each configuration records of it.
        tables: rows by table.
    """
    shipped = shipped_untrained()
    evaluated = [
        untrained_row(task, RANDOM, returns)
        for task, returns in evaluated_returns(tables, RANDOM, shown).items()
        if len(returns) and task not in {*shipped["task"]}
    ]
    more = pd.DataFrame(evaluated, columns=shipped.columns)
    rows = pd.concat([shipped, more], ignore_index=True) if evaluated else shipped
    return rows[rows["task"].isin(shown)].reset_index(drop=True)


def without_baseline(shown: RecordedSpecs, tables: Mapping[str, pd.DataFrame]) -> list[str]:
    """Returns a sentence on each task whose random actions are not shown; see `baseline_frame`."""
    every = {*_evaluations(tables, RANDOM)["task"]}
    fitting = {*_evaluations(tables, RANDOM, shown)["task"]}
    return [
        f"Random actions on {task} are left out: not all runs are of the code on which they were "
        f"evaluated. jbench evaluate {RANDOM} --task {task} evaluates them on the present code, "
        "and --since leaves out older runs."
        for task in shown
        if task in every and task not in fitting
    ]


def findings(
    tables: Mapping[str, pd.DataFrame], task: str | None, results: Path
) -> tuple[list[Finding], list[str]]:
    """Returns findings on hand-written policies, and what to type for those not evaluated."""
    returns = hand_written_returns(tables)
    tasks = in_order(returns if task is None else {task} & returns.keys())
    rows = [examine_solving(SOLVED_BY_HAND, name, returns[name]) for name in tasks]
    missing = [name for name in (TASKS if task is None else (task,)) if name not in returns]
    if not missing:
        return rows, []

    tasks_left = ", ".join(missing)
    how = _how_to_test(missing, results)
    return rows, [f"Claim ({SOLVED_BY_HAND}) is not tested on {tasks_left}: {how}."]


def _how_to_test(missing: Sequence[str], results: Path) -> str:
    """Returns what to type so that the hand-written policies of these tasks are evaluated."""
    evaluate = f"jbench evaluate {HEURISTIC} --task {missing[0]}"
    others = ", and the same for the other tasks" if len(missing) > 1 else ""
    if is_reference(results):  # nothing is written there
        copy = f"jbench merge {REFERENCE}"
        return f"type `{copy}`, `{evaluate}`{others}, then `jbench report --claims`"

    return f"type `{with_results(evaluate, results)}`{others}"


def hand_written_returns(tables: Mapping[str, pd.DataFrame]) -> dict[str, FloatArray]:
    """Returns the finite returns (episodes,) of the hand-written policy of each task."""
    return evaluated_returns(tables, HEURISTIC)


def evaluated_returns(
    tables: Mapping[str, pd.DataFrame], policy: str, shown: RecordedSpecs | None = None
) -> dict[str, FloatArray]:
    """Returns the finite returns (episodes,) of a policy without training, by task.

    See `_evaluations` for the evaluations that count.
    """
    chosen = _evaluations(tables, policy, shown)
    episodes = tables["policy_episodes"]
    episodes = episodes[np.isfinite(episodes["episode_return"])]
    returns = episodes.groupby("evaluation", observed=True)["episode_return"]
    known = {str(name): values.to_numpy(float) for name, values in returns}
    pairs = zip(chosen["task"], chosen["evaluation"], strict=True)
    return {task: known.get(evaluation, np.empty(0)) for task, evaluation in pairs}


def _evaluations(
    tables: Mapping[str, pd.DataFrame], policy: str, shown: RecordedSpecs | None = None
) -> pd.DataFrame:
    """Returns the row of the evaluation of a policy without training that counts, of each task.

    It is that with the most episodes, or the newest of several such. Only evaluations on the plain
    robot with random targets count, and if `shown` is given, see `baseline_frame`, only those of
    its tasks with the code of all that is shown.
    """
    rows = tables["policy_evaluations"]
    rows = rows[(rows["policy"] == policy) & (rows["status"] == "finished")]
    settings = [json.loads(text) for text in rows["settings"]]
    usual = [
        each.get("augment") is None
        and each.get("target_yaw") is None
        and (shown is None or _is_of_code(each, shown.get(str(each.get("task")), ())))
        for each in settings
    ]
    rows = rows[np.array(usual, bool)].dropna(subset=["task", "episodes"])
    return rows.sort_values(["episodes", "created"]).drop_duplicates("task", keep="last")


def _is_of_code(evaluation: Mapping[str, Any], shown: Sequence[Mapping[str, Any]]) -> bool:
    """Returns whether an evaluation is of the code of all configurations of its task, if any.

    Checksums that one of the two does not have are not compared.
    """
    mine = _recorded_specs(evaluation)
    pairs = [(mine.get(name), specs.get(name)) for specs in shown for name in CODE_CHECKSUMS]
    return bool(shown) and all(None in pair or pair[0] == pair[1] for pair in pairs)


def behavior(
    results: Results | None, task: str | None = None
) -> tuple[pd.DataFrame, pd.DataFrame, list[str]]:
    """Returns the distributions of motor velocities and positions, and sentences on read errors.

    Of each task, the worst policy and the best of the others are shown, four in all, each by its
    newest saved states. A velocity is as observed: 1 at 180 rad/s. A share is that of all states in
    a square, of which x and y (m) are the center; reach is half of the width of the map.
    """
    newest: dict[tuple[str, str], pd.DataFrame] = {}
    problems = []
    for record in results.scan("evaluation")[0] if results is not None else ():
        settings = record.settings
        saved = record.is_finished and settings.get("states")
        if saved and task in (None, settings.get("task")):
            try:
                newest[str(settings["task"]), str(settings["policy"])] = _read(record)
            except WorkError as error:
                problems.append(str(error))

    motor = list[Part]()
    positions = list[Part]()
    for name in dict.fromkeys(task for task, _ in newest):
        ranked = [states for key, states in newest.items() if key[0] == name]
        ranked.sort(key=lambda states: states["median"].iloc[0])
        shown = ranked if len(ranked) <= _SHOWN else [ranked[0], *ranked[1 - _SHOWN :]]
        motor += map(_motor, shown)
        positions += _positions(shown)

    return long_frame(motor, MOTOR), long_frame(positions, POSITIONS), problems


def _read(record: Record) -> pd.DataFrame:
    """Returns the states of an evaluation, in m, rad and rad/s; its manifest is untrusted."""
    states = record.read("policy_states")
    settings = record.settings
    yaw = record.settings.get("target_yaw")
    try:
        median = float(record.manifest.summary["median"])
        policy = str(settings["policy"])
        changed = "" if settings.get("accepted") is None else ", with changed code"
        episodes = int(settings["episodes"])
        label = f"{policy} (median return {median:.0f}, {episodes} episodes{changed})"
        columns = {name: states[name].to_numpy() for name in ("motor_velocity", "x", "y")}
        if not (states.num_rows and np.isfinite([*columns.values()]).all()):
            raise ValueError("no states, or states that are not finite")
        names = {"task": str(settings["task"]), "policy": policy, "label": label, "median": median}
        target = {"target_yaw": np.nan if yaw is None else float(yaw)}
        return pd.DataFrame({**names, **target, **columns})
    except (KeyError, TypeError, ValueError) as error:
        raise WorkError(
            f"The evaluation {record.id} has invalid settings or states ({error}); delete "
            f"{record.path} to make it again."
        ) from None


def _motor(states: pd.DataFrame) -> Part:
    """Returns the density of the motor's velocity in an evaluation."""
    edges = np.linspace(-1.2, 1.2, 121)
    observed = np.clip(states["motor_velocity"].to_numpy() / FULL_SPEED, edges[0], edges[-1])
    density, _ = np.histogram(observed, edges, density=True)
    names = states.iloc[0][[*MOTOR[:4]]]
    return {**names}, {"velocity": (edges[:-1] + edges[1:]) / 2, "density": density}


def _positions(shown: Sequence[pd.DataFrame]) -> list[Part]:
    """Returns the maps of a task's policies, of one reach, without their empty squares."""
    farthest = max(float(np.quantile(np.hypot(s["x"], s["y"]), 0.995)) for s in shown)
    reach = float(np.clip(farthest * 1.05, 0.1, _REACH))
    edges = np.linspace(-reach, reach, _BINS + 1)
    middles = (edges[:-1] + edges[1:]) / 2
    maps: list[Part] = []
    for states in shown:
        counts, _, _ = np.histogram2d(states["x"], states["y"], [edges, edges])
        column, row = np.nonzero(counts)
        where = {"x": middles[column], "y": middles[row], "share": counts[column, row]}
        where["share"] /= len(states)
        names = states.iloc[0][["task", "policy", "label", "median", "target_yaw"]]
        maps.append(({**names, "reach": reach}, where))

    return maps
