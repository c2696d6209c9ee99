"""Labels that tell several settings apart: the text of each setting in which they differ."""

import json
import math
from collections import Counter
from collections.abc import Callable, Collection, Container, Mapping
from itertools import chain
from typing import Any

from jbench.settings.algorithms import SETTINGS
from jbench.settings.defaults import differing_paths
from jbench.settings.named import bases
from jbench.settings.recorded import VARIANT, Flat, SettingPath

Form = Callable[[str, Any], str]
"""Returns the text of a setting, given its name and value; empty for none."""

_NAMED_SETTINGS = 4
_VALUE_LENGTH = 34

CUT = "…"
"""In names that have no room for all settings."""


def distinguishing_labels(
    values: Mapping[str, Flat],
    recorded: Mapping[str, Flat],
    form: Form,
    left_out: Collection[str] = VARIANT,
    always: Mapping[str, Collection[SettingPath]] | None = None,
) -> dict[str, list[str]]:
    """Returns the label of each variant: a text for each setting in which the variants differ.

    A label has the `_NAMED_SETTINGS` most important of them. Where that leaves out some, or makes
    two labels equal, each label ends with the name of its variant.

    Args:
        values: settings by variant; see `with_base`.
        recorded: the same as they were recorded, which labels show.
        form: see `Form`; the value of a setting that a variant does not have is `...`.
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
    form: Form,
    always: Collection[SettingPath],
) -> dict[SettingPath, str]:
    """Returns the texts of the settings of a variant, without those that need none.

    Args:
        values: of the variant.
        names: of the settings that labels may have.
        form: see `distinguishing_labels`.
        always: settings that have a text even if `form` returns none.
    """
    texts = {}
    for path, name in names.items():
        text = form(name, values.get(path, ...))
        if not text and path in always and path in values:
            text = f"{name}={short_text(values[path])}"
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


def short_text(value: Any) -> str:
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
    return 1, 0.0, short_text(value)
