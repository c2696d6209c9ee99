"""Labels of variants: the settings in which they differ."""

import json
import math
from collections import Counter
from collections.abc import Callable, Collection, Container, Mapping
from itertools import chain
from typing import Any

from jbench.settings.algorithms import SETTINGS
from jbench.settings.code_words import code_word
from jbench.settings.defaults import BASE, chosen_paths, differing_paths
from jbench.settings.named import ENCODER, USUAL, WHOSE, bases, with_base, with_encoders
from jbench.settings.recorded import (
    COMPARED,
    HYPERPARAMETERS,
    VARIANT,
    Flat,
    Run,
    SettingPath,
    alike,
    flatten,
)
from jbench.settings.run import RunSettings

_Form = Callable[[str, Any], str]
"""Returns the text of a setting, given its name and value; empty for none."""

_NAMED_SETTINGS = 4
_VALUE_LENGTH = 34

CUT = "…"
"""In names that have no room for all settings."""

# Settings that a name on all tasks leaves out.
_SAME_NAME = (*COMPARED, "task", "specs", "encoder", "encoder_draws")

_WORDS = {
    ("engine", "sb3"): "stable-baselines3",
    ("precision", "bfloat16"): "bfloat16",
    ("precision", "tf32"): "tf32",
    (WHOSE, "each"): "an encoder per agent",
    (WHOSE, "one"): "one encoder",
    (BASE, USUAL): "",
}
"""Settings that have a name of their own; none for the hyperparameters that a task has."""


def variant_labels(
    settings: Mapping[str, Run | Mapping[str, Any]], dates: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Returns a label of the settings that differ, in order, such as `learning_rate=0.001`.

    Users' code is called as by `variant_words`.
    """

    def label(name: str, value: Any) -> str:
        return code_word(name, value, dates or {}) or f"{name}={_text(value)}"

    recorded = _recorded(settings)
    values = {v: with_base(flat, only_recorded=False) for v, flat in recorded.items()}
    labels = _labels(values, recorded, label)
    return {variant: ", ".join(words) for variant, words in labels.items()}


def variant_words(
    settings: Mapping[str, Run],
    dates: Mapping[str, str] | None = None,
    encoders: Mapping[str, str] | None = None,
    elsewhere: Collection[SettingPath] = (),
) -> dict[str, list[str]]:
    """Returns the words that name variants of one algorithm and representation in legends.

    The words are the settings that differ between the variants on all tasks, so that a name means
    the same on each, and those that are not the defaults, even if all variants agree. The only
    variant has no words if it has all defaults. A setting with a name of its own is called by it,
    `stable-baselines3` instead of `engine=sb3`. Users' code is called by the beginning of its
    checksum and by its date, `code 3f2a91 of 2026-11-28`.

    Args:
        settings: by variant.
        dates: of checksums of code.
        encoders: names of encoders by id, in place of the ids.
        elsewhere: hyperparameters that are named even if all variants agree; see
            `foreign_differences`.
    """

    def word(name: str, value: Any) -> str:
        encoder = None
        if encoders and (name,) == ENCODER:
            encoder = encoders.get(str(value))
        return encoder or _word(name, value, dates or {})

    jitterbug = {v: run for v, run in settings.items() if getattr(run, "specs", None) is None}
    others = {v: run for v, run in settings.items() if v not in jitterbug}
    # Each robot has defaults of its own.
    return _words(jitterbug, word, elsewhere) | _words(others, word, elsewhere)


def _words(
    settings: Mapping[str, Run], word: _Form, elsewhere: Collection[SettingPath]
) -> dict[str, list[str]]:
    """Returns the words of variants on robots with the same defaults; see `variant_words`."""
    groups: dict[str, dict[str, Run]] = {}
    for variant, run in settings.items():
        groups.setdefault(alike(run, _SAME_NAME), {})[variant] = run

    first = dict(next(iter(group.items())) for group in groups.values())
    always = {variant: chosen_paths(run) | {*elsewhere} for variant, run in first.items()}
    on_all_tasks = _labels(_shown(first), _recorded(first), word, (*_SAME_NAME, WHOSE), always)

    words: dict[str, list[str]] = {}
    for name, group in zip(first, groups.values(), strict=True):
        for task in dict.fromkeys(run.task for run in group.values()):
            # Variants on one task differ in their evaluations or encoders.
            same_task = {variant: run for variant, run in group.items() if run.task == task}
            labels = _labels(_shown(same_task), _recorded(same_task), word)
            for variant, apart in labels.items():
                words[variant] = on_all_tasks[name] + apart

    return words


def _shown(settings: Mapping[str, Run]) -> dict[str, Flat]:
    """Returns the settings that words are made of, without options of ours at their default."""
    return with_encoders(
        {variant: with_base(flatten(run), only_recorded=True) for variant, run in settings.items()}
    )


def _recorded(settings: Mapping[str, Run | Mapping[str, Any]]) -> dict[str, Flat]:
    """Returns the settings of variants as they were recorded."""
    return {variant: flatten(run) for variant, run in settings.items()}


def hyperparameter_words(run: Run) -> list[str]:
    """Returns the words that names have for hyperparameters that are not the defaults."""
    return [
        f"{path[-1]}={_text(value)}"
        for path, value in _chosen(run).items()
        if path[0] in (BASE, HYPERPARAMETERS)
    ]


def chosen_words(run: Run) -> str:
    """Returns all settings of a run that are known not to be the defaults, however many."""
    return ", ".join(
        f"{path[-1]}={value_text(value)}"
        for path, value in _chosen(run).items()
        if path[0] not in COMPARED
    )


def _chosen(run: Run) -> Flat:
    """Returns the settings of a run that are known not to be the defaults, as names have them."""
    if not isinstance(run, RunSettings):
        return {}
    paths = chosen_paths(run)
    named = with_base(flatten(run), only_recorded=True)
    return {path: value for path, value in named.items() if path in paths}


def _word(name: str, value: Any, dates: Mapping[str, str]) -> str:
    """Returns a setting in words; nothing for a default."""
    code = code_word(name, value, dates)
    if code:
        return code
    field = RunSettings.model_fields.get(name)
    if value is ... or (field and not field.is_required() and value == field.default):
        return ""
    return _WORDS.get((name, str(value)), f"{name}={_text(value)}")


def _labels(
    values: Mapping[str, Flat],
    recorded: Mapping[str, Flat],
    form: _Form,
    left_out: Collection[str] = VARIANT,
    always: Mapping[str, Collection[SettingPath]] | None = None,
) -> dict[str, list[str]]:
    """Returns the label of each variant: a text for each setting in which the variants differ.

    A label has the `_NAMED_SETTINGS` most important of them. Where that leaves out some, or makes
    two labels equal, each label ends with the name of its variant.

    Args:
        values: settings by variant; see `with_base`.
        recorded: the same as they were recorded, which labels show.
        form: see `_Form`; the value of a setting that a variant does not have is `...`.
        left_out: names of settings that no label has.
        always: of each variant, the settings that its label has even if all variants agree.
    """
    always = always or {}
    differing = differing_paths(values.values())
    candidates = differing.union(*always.values())
    every_path = dict.fromkeys(chain.from_iterable(values.values()))
    names = _names([p for p in every_path if p in candidates and p[0] not in left_out])

    true = {
        variant: {path: recorded[variant].get(path, value) for path, value in each.items()}
        for variant, each in values.items()
    }
    labels = {}
    is_cut = False
    for variant in _in_order(true, names):
        texts = _texts(true[variant], names, form, always.get(variant, ()))
        shown = _most_important(texts, values[variant], differing)
        is_cut = is_cut or len(shown) < len(texts)
        labels[variant] = [text for path, text in texts.items() if path in shown]

    # Values that are cut short may be equal as well.
    are_distinct = len({*map(tuple, labels.values())}) == len(labels)
    if is_cut or not are_distinct:
        return {variant: [*label, f"{CUT} ({variant})"] for variant, label in labels.items()}

    return labels


def _in_order(values: Mapping[str, Flat], paths: Collection[SettingPath]) -> list[str]:
    """Returns the variants, sorted by their values of these settings, numbers by size."""

    def key(variant: str) -> tuple[list[tuple[int, float, str]], str]:
        return [_rank(values[variant].get(path)) for path in paths], variant

    return sorted(values, key=key)


def _texts(
    values: Flat,
    names: Mapping[SettingPath, str],
    form: _Form,
    always: Collection[SettingPath],
) -> dict[SettingPath, str]:
    """Returns the texts of the settings of a variant, without those that need none.

    Args:
        values: of the variant.
        names: of the settings that labels may have.
        form: see `_labels`.
        always: settings that have a text even if `form` returns none.
    """
    texts = {}
    for path, name in names.items():
        text = form(name, values.get(path, ...))
        if not text and path in always and path in values:
            text = f"{name}={_text(values[path])}"
        if text:
            texts[path] = text

    return texts


def _names(paths: Collection[SettingPath]) -> dict[SettingPath, str]:
    """Returns the last part of each path, or all of it where that does not tell two apart."""
    ends = Counter(path[-1] for path in paths)
    return {path: path[-1] if ends[path[-1]] == 1 else ".".join(path) for path in paths}


def _most_important(
    paths: Collection[SettingPath], values: Flat, differing: Container[SettingPath]
) -> set[SettingPath]:
    """Returns the settings of a variant for which a label has room.

    First come those that tell variants apart, and of these the ones that are not as published.
    """
    algo = values.get(("algo",))
    published = bases(algo)["published"] if algo in SETTINGS else {}
    ranked = sorted(
        paths, key=lambda path: (path not in differing, values.get(path) == published.get(path))
    )
    return {*ranked[:_NAMED_SETTINGS]}


def _text(value: Any) -> str:
    """Returns a value as text, cut in the middle if it is long."""
    if value is ...:
        return "(not set)"
    text = value_text(value)
    if len(text) <= _VALUE_LENGTH:
        return text

    half = _VALUE_LENGTH // 2
    return f"{text[:half]}{CUT}{text[-half:]}"


def value_text(value: Any) -> str:
    """Formats a setting's value, such as 3e-04 instead of 0.00030000000000000003."""
    if isinstance(value, float) and math.isfinite(value):
        mantissa, exponent = f"{value:.5e}".split("e")
        if value and int(exponent) < -3:
            return f"{mantissa.rstrip('0').rstrip('.')}e{exponent}"
        return f"{value:.6g}"
    return value if isinstance(value, str) else json.dumps(value)


def _rank(value: Any) -> tuple[int, float, str]:
    """Returns a sort key: numbers by size, then everything else."""
    if isinstance(value, int | float):
        return 0, value, ""
    return 1, 0.0, _text(value)
