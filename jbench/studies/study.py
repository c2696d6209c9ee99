"""The comparisons of a study: those that its file lists, or each representation with baselines."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

from jbench.errors import RequestError
from jbench.names import MAX_SEEDS
from jbench.representation_names import FULL, features_in, kind_in
from jbench.settings.base import canonical_json
from jbench.settings.recorded import SEED, alike, with_implied
from jbench.statistics.sequential import BLOCK
from jbench.statistics.verdicts import ERROR_RATE
from jbench.studies.arms import Arm, arms, short_name
from jbench.studies.entries import Claim, Entry, Side
from jbench.studies.file import refusals_named
from jbench.studies.matrix import Parts
from jbench.studies.quantities import SPEED, margin
from jbench.typed_values import known

SCALED = "scaled"
RAW = "raw"  # the observation in SI units

BASELINES = (FULL, SCALED)
"""Representations that reduce nothing, without and with the encoders' scaling of inputs."""


@dataclass(frozen=True)
class PlannedComparison:
    """Two arms of a study and how much of its error rate decides between them.

    Attributes:
        labels: what the entry calls the sides: representations, with what else it names of each.
        common: what else it names of both.
        share: of the error rate, before other comparisons pass theirs on.
        max_seeds: most seeds of each arm, a multiple of the block size.
        margin: difference within which the arms are similar; 0 if nothing is.
    """

    first: Arm
    second: Arm
    labels: tuple[str, str]
    common: str = ""
    share: float = ERROR_RATE
    claim: Claim = "a"
    max_seeds: int = MAX_SEEDS
    margin: float = 0.0

    def __post_init__(self) -> None:
        """Raises a RequestError if no analysis or no error rate would be left to decide it."""
        if self.max_seeds < BLOCK or self.max_seeds % BLOCK:
            raise RequestError(
                f"max_seeds of {self.name} is {self.max_seeds}: type a multiple of {BLOCK}."
            )
        if not 0 < self.share <= ERROR_RATE + 1e-9:
            raise RequestError(
                f"share of {self.name} is {self.share}: type a number above 0, up to "
                f"{ERROR_RATE:g}."
            )

    @property
    def name(self) -> str:
        """Name in tables."""
        ours, theirs = self.labels
        name = f"{self.first.task} {self.first.algo} {ours} against {theirs}"
        over_run = "over the run" if self.claim == SPEED.claim else ""
        return ", ".join(filter(None, (name, self.common, over_run)))

    @property
    def typed(self) -> list[str]:
        """What a user types for all comparisons of the first representation, or for this one."""
        ours = dict.fromkeys((self.first.representation, self.first.short_name))
        theirs = dict.fromkeys((self.second.representation, self.second.short_name))
        return [*ours, *(f"{first}/{second}" for first, second in product(ours, theirs))]


def listed_comparisons(
    parts: Parts, entries: Mapping[str, Entry], max_seeds: int = MAX_SEEDS
) -> list[PlannedComparison]:
    """Returns the comparisons that a file lists, with the arms of its parts.

    `max_seeds` is for entries that have none. Raises a RequestError if the parts have not exactly
    one pair of arms for an entry, or it is listed twice.
    """
    every = _different(parts)
    listed: list[PlannedComparison] = []
    seen: dict[str, str] = {}
    for where, entry in entries.items():
        with refusals_named(where):
            first, second = _pair(every, entry)
            key = canonical_json({"entry": [first.key, second.key, entry.claim]})
            if key in seen:
                ours, theirs = (side.representation for side in (entry.first, entry.second))
                raise RequestError(f"{ours} against {theirs} is listed twice; leave one out.")
            seen[key] = where
            listed.append(
                PlannedComparison(
                    first,
                    second,
                    labels=(_label(first, entry.first), _label(second, entry.second)),
                    common=_common(entry),
                    share=entry.share,
                    claim=entry.claim,
                    max_seeds=entry.max_seeds or max_seeds,
                    margin=entry.margin or margin(first.task),
                )
            )

    return listed


def default_comparisons(parts: Parts, max_seeds: int = MAX_SEEDS) -> list[PlannedComparison]:
    """Returns the comparisons of a file without a list: reduced representations with baselines.

    A baseline has the same features. As in a report, `raw` is a baseline where nothing observes
    `full`. Each comparison has the whole error rate: whoever chooses some of them divides it; see
    `chosen`.
    """
    every = _different(parts)

    def observed(arm: Arm, kind: str) -> tuple[str, str, str]:
        return _rest(arm), kind, features_in(arm.short_name)

    baselines = {observed(arm, kind_in(arm.short_name)): arm for arm in every}
    compared = []
    for arm in every:
        names = BASELINES if observed(arm, FULL) in baselines else (RAW, SCALED)
        if kind_in(arm.short_name) in names:
            continue

        for name in names:
            theirs = baselines.get(observed(arm, name))
            if theirs is not None:
                labels = arm.representation, name
                similar = margin(arm.task)
                compared.append(
                    PlannedComparison(arm, theirs, labels, max_seeds=max_seeds, margin=similar)
                )

    return compared


def chosen(
    comparisons: Sequence[PlannedComparison], typed: Collection[str], *, listed: bool
) -> list[PlannedComparison]:
    """Returns the comparisons that a user asks for, such as `dae12` or `dae12/full`; none for all.

    Listed ones keep their share of the error rate whether or not the others are requested; others
    divide the whole rate equally. Raises a RequestError if what is typed matches none.
    """
    names = list(dict.fromkeys(name for comparison in comparisons for name in comparison.typed))
    for name in typed:
        known("comparison", name, names)
    left = [one for one in comparisons if not typed or {*one.typed} & {*typed}]
    return left if listed else [replace(one, share=ERROR_RATE / len(left)) for one in left]


def _different(parts: Parts) -> list[Arm]:
    """Returns the arms of all parts, each once.

    Raises a RequestError if two differ in their evaluations alone: training is the same, so nothing
    says which of the runs decide.
    """
    found: dict[str, Arm] = {}
    for arm in arms(parts):
        with refusals_named(arm.where):
            same = found.setdefault(arm.training_key, arm)
            if same.evaluation != arm.evaluation:
                raise RequestError(
                    f"{arm.representation} of {arm.algo} on {arm.task} is also in {same.where}, "
                    "with other evaluations; give both the same [evaluation], or leave one out."
                )
    return list(found.values())


def _pair(every: Sequence[Arm], entry: Entry) -> tuple[Arm, Arm]:
    """Returns the only pair of arms that an entry means, or raises a RequestError."""
    first, second = entry.first, entry.second
    if first == second:
        raise RequestError(f"first and second are both {first.representation}; name another one.")

    free = _differing(first, second)
    pairs = [
        (ours, theirs)
        for ours in _matching(every, entry, first)
        for theirs in _matching(every, entry, second)
        if ours.key != theirs.key and _rest(ours, *free) == _rest(theirs, *free)
    ]
    both = f"{first.representation} and {second.representation} of {entry.algo} on {entry.task}"
    if not pairs:
        steps = "" if entry.steps is None else f" with {entry.steps} control steps"
        raise RequestError(
            f"the matrix has no {both}{steps} that differ only in their representation, or in what "
            "the entry names of one side; choose others, or give both the same settings."
        )

    if len(pairs) > 1:
        raise RequestError(
            f"the matrix has {both} with {len(pairs)} settings; write which to compare: steps, "
            "settings, hyperparameters, or the encoder.seed of a side."
        )

    return pairs[0]


def _matching(every: Sequence[Arm], entry: Entry, side: Side) -> Iterator[Arm]:
    """Yields the arms that have all that an entry names of both sides, and of this one."""
    wanted = {**entry.hyperparameters, **side.hyperparameters}
    for arm in every:
        is_named = (arm.task, arm.algo) == (entry.task, entry.algo) and (
            side.representation == arm.representation
            or short_name(side.representation) == arm.short_name
        )
        if not is_named:
            continue
        given = arm.run.hyperparameters
        omitted = arm.run.algorithm.omitted()
        values = {**omitted, **given}
        for name in wanted:
            known("hyperparameter", name, [*values])
        has_all = (
            all(values[name] == value for name, value in wanted.items())
            and entry.steps in (None, arm.run.steps)
            and all(base in (None, arm.base) for base in (entry.settings, side.settings))
            and (side.encoder is None or side.encoder.seed == arm.part.encoder.seed)
        )
        if has_all:
            yield arm


def _differing(first: Side, second: Side) -> list[str]:
    """Returns the settings in which two sides may differ, since one of them names them."""
    names = [*first.hyperparameters, *second.hyperparameters]
    if first.settings != second.settings:
        names.extend(("hyperparameters", "time_limit"))
    return names


def _rest(arm: Arm, *free: str) -> str:
    """Returns a key that is equal for arms that differ only in a representation and free names."""
    return alike(arm.run, {*SEED, *with_implied("representation"), *free})


def _label(arm: Arm, side: Side) -> str:
    """Returns the representation of an arm, and what else an entry names of this side."""
    words = [] if side.settings is None else [str(side.settings)]
    words += [f"{name}={value}" for name, value in side.hyperparameters.items()]
    if side.encoder is not None:
        each = side.encoder.seed == "each"
        words.append("an encoder per agent" if each else "one encoder")
    return arm.representation + (f" ({', '.join(words)})" if words else "")


def _common(entry: Entry) -> str:
    """Returns what an entry names of both sides."""
    words = [] if entry.settings is None else [str(entry.settings)]
    words += [f"{name}={value}" for name, value in entry.hyperparameters.items()]
    return ", ".join(words)
