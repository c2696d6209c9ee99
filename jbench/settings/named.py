"""Settings of runs as their names show them: by the nearest source of hyperparameters (base).

Names also say whether agents have an encoder each, or share one.
"""

from collections.abc import Mapping
from functools import cache

from jbench.names import TASKS
from jbench.settings.algorithms import (
    SETTINGS,
    algorithm_settings,
    default_base,
    default_time_limit,
)
from jbench.settings.defaults import BASE, nearest_base
from jbench.settings.recorded import HYPERPARAMETERS, Flat, flatten

ENCODER = ("encoder",)
DRAWS = ("encoder_draws",)
TIME_LIMIT = ("time_limit",)

WHOSE = "encoders"
"""Name for whether the agents of a variant have an encoder each ("each") or share one ("one")."""

USUAL = "usual"
"""The base that a task has if none is typed."""


def with_encoders(flat: Mapping[str, Flat]) -> dict[str, Flat]:
    """Returns settings of variants with `WHOSE`, if only some of them share an encoder.

    Ids and hashes of encoders are left out where `WHOSE` is enough to tell the variants apart.
    """
    draws = {values.get(DRAWS) for values in flat.values()} - {None}
    shared = {values.get(ENCODER) for values in flat.values()} - {None}
    if not (draws and shared):
        return dict(flat)

    changed = {}
    for variant, values in flat.items():
        whose = "one"
        if values.get(DRAWS) is not None:
            whose = "each"

        kept = {
            path: value
            for path, value in values.items()
            if not (path == DRAWS and len(draws) == 1)
            and not (path == ENCODER and len(shared) == 1)
        }
        changed[variant] = {(WHOSE,): whose} | kept

    return changed


def with_base(flat: Flat, *, only_recorded: bool) -> Flat:
    """Returns settings of a run with the name of the nearest base, and what differs from it.

    A hyperparameter that is as in the base has the published value, so that runs of two bases
    differ in it only if one of them has changed it; names show the recorded value.

    If `only_recorded`, options of ours that are at their default, such as `mirror`, are left out,
    and so are the name of the base that is the task's default and the time limit that the base
    brings with it.
    """
    algo = flat.get(("algo",))
    given = {path: value for path, value in flat.items() if path[0] == HYPERPARAMETERS}
    if algo not in SETTINGS or not given:
        return flat

    published = bases(algo)["published"]
    # Settings that another program wrote may lack the task.
    task = str(flat.get(("task",), TASKS[0]))
    base = nearest_base(algo, {".".join(path[1:]): value for path, value in given.items()}, task)
    assert base is not None
    changes = published
    if base == "published":
        changes = given
    if only_recorded:
        omitted = flatten({HYPERPARAMETERS: SETTINGS[algo].omitted()})
        changes = {p: v for p, v in changes.items() if v != omitted.get(p, ...)}
    if base != "published":
        usual = bases(algo)[base]
        changes = changes | {p: v for p, v in given.items() if usual.get(p, ...) != v}

    others = {path: value for path, value in flat.items() if path not in given}
    if only_recorded and others.get(TIME_LIMIT) == default_time_limit(base):
        del others[TIME_LIMIT]

    if only_recorded and base == default_base(task):
        return {(BASE,): USUAL} | others | changes
    return {(BASE,): base} | others | changes


@cache
def bases(algo: str) -> dict[str, Flat]:
    """Returns the hyperparameters of each base that an algorithm has, by their paths."""
    omitted = SETTINGS[algo].omitted()
    return {
        base: flatten({HYPERPARAMETERS: omitted | algorithm_settings(algo, base).values})
        for base in SETTINGS[algo].bases
    }
