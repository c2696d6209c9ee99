"""Names of variants in words: the settings in which they differ, and those that are no defaults."""

from collections.abc import Collection, Mapping
from typing import Any

from jbench.settings.code_words import code_word
from jbench.settings.defaults import BASE, chosen_paths
from jbench.settings.labels import Form, distinguishing_labels, short_text, value_text
from jbench.settings.named import ENCODER, USUAL, WHOSE, with_base, with_encoders
from jbench.settings.recorded import (
    COMPARED,
    HYPERPARAMETERS,
    Flat,
    Run,
    SettingPath,
    alike,
    flatten,
)
from jbench.settings.run import RunSettings

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
        return code_word(name, value, dates or {}) or f"{name}={short_text(value)}"

    recorded = _recorded(settings)
    values = {v: with_base(flat, only_recorded=False) for v, flat in recorded.items()}
    labels = distinguishing_labels(values, recorded, label)
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
    settings: Mapping[str, Run], word: Form, elsewhere: Collection[SettingPath]
) -> dict[str, list[str]]:
    """Returns the words of variants on robots with the same defaults; see `variant_words`."""
    groups: dict[str, dict[str, Run]] = {}
    for variant, run in settings.items():
        groups.setdefault(alike(run, _SAME_NAME), {})[variant] = run

    first = dict(next(iter(group.items())) for group in groups.values())
    always = {variant: chosen_paths(run) | {*elsewhere} for variant, run in first.items()}
    on_all_tasks = distinguishing_labels(
        _shown(first), _recorded(first), word, (*_SAME_NAME, WHOSE), always
    )

    words: dict[str, list[str]] = {}
    for name, group in zip(first, groups.values(), strict=True):
        for task in dict.fromkeys(run.task for run in group.values()):
            # Variants on one task differ in their evaluations or encoders.
            same_task = {variant: run for variant, run in group.items() if run.task == task}
            labels = distinguishing_labels(_shown(same_task), _recorded(same_task), word)
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
        f"{path[-1]}={short_text(value)}"
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
    return _WORDS.get((name, str(value)), f"{name}={short_text(value)}")
