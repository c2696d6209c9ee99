"""Notes on unusual runs of a configuration, and on points that they lack."""

from collections.abc import Sequence

import pandas as pd

from jbench.array_types import IntArray
from jbench.names import ReturnsName
from jbench.report.data.configuration import Configuration
from jbench.report.data.encoder_weights import notes_on_weights
from jbench.report.data.source_names import FILE, has_return_range
from jbench.returns import EVALUATION, TRAINING
from jbench.settings.labels import CUT
from jbench.settings.variants import chosen_words
from jbench.statistics.bootstrap import MIN_SEEDS
from jbench.wording import are, counted

_POINT: dict[ReturnsName, str] = {TRAINING: "episode", EVALUATION: "evaluation"}
"""What a point of each kind of return is called."""

_VALUE: dict[ReturnsName, str] = {TRAINING: "return", EVALUATION: "evaluation"}
"""What its value is called."""


def notes_on_runs(
    same: pd.DataFrame, chosen: pd.DataFrame, kind: ReturnsName, source: str, words: Sequence[str]
) -> list[str]:
    """Returns notes on unusual ones of the runs of the same settings, of which some are chosen."""
    # Of which kind the returns of a file are is not known.
    point = "point" if source == FILE else _POINT[kind]
    notes = []
    every = ""
    if any(CUT in word for word in words):
        every = chosen_words(chosen["typed"].iloc[0])
    if every:
        notes.append(f"its settings other than the defaults: {every}")

    if len(chosen) < MIN_SEEDS:
        few = f"only {counted(len(chosen), 'seed')}"
        notes.append(f"{few}: too few for a band and for quantiles")

    lengths = dict(zip(chosen["seed"], chosen["recorded"], strict=True))
    for seed, shorter in same.drop(chosen.index).groupby("seed")["recorded"]:
        notes.append(
            f"seed {seed} has {len(shorter) + 1} runs: the longest is used, of {lengths[seed]} "
            f"{point}s, not that of {', '.join(map(str, shorter))}"
        )

    notes += notes_on_weights(chosen)
    others = chosen[chosen["diverged"].isna()]
    diverged = chosen[chosen["diverged"].notna()]
    if len(diverged):
        which = ", ".join("seed " + diverged["seed"].astype(str) + " " + diverged["divergence"])
        notes.append(
            f"{len(diverged)} of {len(chosen)} diverged ({which}): from its divergence on, a seed "
            f"counts with {_what_counts(diverged)}"
        )

    for ended in ("failed", "unfinished"):
        for seed in others["seed"][others["status"] == ended]:
            notes.append(f"seed {seed} {ended} after {counted(lengths[seed], point)}")

    # Where episodes end early, runs of the same control steps have other numbers of them.
    is_whole = others["steps"].nunique() == 1 and (others["status"] == "finished").all()
    recorded = others["recorded"]
    if recorded.nunique() > 1 and not is_whole:
        notes.append(f"seeds of unequal length, {recorded.min()} to {recorded.max()} {point}s")

    return notes


def _what_counts(diverged: pd.DataFrame) -> str:
    """Returns what each of some runs counts with from its divergence on."""
    is_negative = diverged["lowest"] < 0
    if is_negative.all():
        return "its lowest training return"
    if is_negative.any():
        seeds = ", ".join(diverged["seed"][~is_negative].astype(str))
        return f"its lowest training return (seed {seeds}: 0, which is lower)"

    is_minimum = has_return_range(diverged["task"], ())
    return "return 0, the minimum" if is_minimum else "return 0, which is lower than its returns"


def notes_on_points(config: Configuration, absent: IntArray) -> list[str]:
    """Returns notes on returns that are not finite, and on the control steps of points."""
    value = _VALUE[config.returns_name]
    notes = [
        f"{counted(count, value)} of seed {seed} {are(count)} not finite and left out"
        for seed, count in zip(config.seeds, absent, strict=True)
        if count
    ]
    return notes + _notes_on_steps(config)


def _notes_on_steps(config: Configuration) -> list[str]:
    """Returns notes on seeds that were logged, or ended, at different control steps."""
    common = config.common
    if common.interpolated and not len(common.control_steps):
        return ["its seeds have no control step in common, so it has no curve"]

    notes = []
    of = "" if config.source == FILE else f" of {config.returns_name} returns"
    if common.interpolated:
        notes.append(
            f"its seeds were logged at different control steps: the curve{of} of each is "
            "interpolated linearly between its own points"
        )

    if not len(common.control_steps):
        return notes

    end = common.control_steps[-1]
    if end < config.longest:
        notes.append(
            f"its curve{of} ends at {end:,.0f} control steps, the last that every seed has reached"
        )

    return notes
