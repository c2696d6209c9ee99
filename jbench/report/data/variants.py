"""Settings of runs: which of them differ, how that is said, and what may be compared."""

import json
import math
from collections.abc import Mapping
from typing import Any

from jbench.agents.settings import SETTINGS
from jbench.store.identity import canonical_json

_NAMED_SETTINGS = 4
_VALUE_LENGTH = 34

_NOT_COMPARED = ("seed", "steps", "evaluate_every", "evaluate_episodes")
"""Settings in which comparable runs may differ: evaluating changes nothing of the training."""

UNSAID = {"augment": None, "robots": 1, "precision": "float32", "parallel": None, "ofe": None}
"""Settings that a run keeps only where they are something else than this."""

_IMPLIED = {
    "representation": ("encoder", "ofe"),
    "algo": ("hyperparameters", "parallel"),
    "augment": ("robots",),
}
"""Settings that can't stay the same where another one does not."""


def comparable(settings: Mapping[str, Any], *names: str) -> str:
    """Returns the settings in which runs must be equal to be compared, but for the named ones.

    Args:
        settings: of a run.
        names: of settings, of which those of an algorithm may be named by their last part.
    """
    left_out = {*_NOT_COMPARED, *names}
    left_out |= {implied for name in names for implied in _IMPLIED.get(name, ())}
    flat = flatten(settings)
    kept = {
        ".".join(path): value
        for path, value in flat.items()
        if not left_out & {path[0], path[-1], ".".join(path)}
    }
    return canonical_json(kept)


def variant_labels(settings: Mapping[str, str]) -> dict[str, str]:
    """Returns a label for each variant: the settings that differ, as `learning_rate=0.001`.

    Args:
        settings: JSON of a run's settings, by variant.

    Returns:
        Labels by variant, in the order of the values that differ; "" for a lone variant.
    """
    flat = {variant: flatten(json.loads(text)) for variant, text in settings.items()}
    paths = list(dict.fromkeys(path for values in flat.values() for path in values))
    differing = [
        path
        for path in paths
        if path not in (("seed",), ("steps",))
        and len({_exact(values.get(path, ...)) for values in flat.values()}) > 1
    ]
    names = _short_names(differing)
    rows = sorted(
        flat.items(), key=lambda item: ([_rank(item[1].get(path)) for path in differing], item[0])
    )
    labels = {
        variant: ", ".join(
            f"{names[path]}={_text(values.get(path, ...))}" for path in differing[:_NAMED_SETTINGS]
        )
        for variant, values in rows
    }
    # More settings than a label can name, or names cut short, must not make two curves one.
    if len(differing) > _NAMED_SETTINGS or len(set(labels.values())) < len(labels):
        labels = {variant: f"{label}, … ({variant})" for variant, label in labels.items()}
    return labels


def flatten(settings: Mapping[str, Any]) -> dict[tuple[str, ...], Any]:
    """Returns settings within settings by their path, as ("hyperparameters", "tau").

    Settings that a run leaves out while they have their defaults are there, too.
    """
    chosen, algorithm = settings.get("hyperparameters"), SETTINGS.get(settings.get("algo", ""))
    if algorithm is not None and isinstance(chosen, Mapping):
        settings = {**settings, "hyperparameters": {**algorithm.batched_defaults(), **chosen}}
    return _flat({**UNSAID, **settings}, ())


def _flat(settings: Mapping[str, Any], path: tuple[str, ...]) -> dict[tuple[str, ...], Any]:
    flat: dict[tuple[str, ...], Any] = {}
    for name, value in settings.items():
        if isinstance(value, Mapping) and value:
            flat |= _flat(value, (*path, name))
        else:
            flat[(*path, name)] = value
    return flat


def _short_names(paths: list[tuple[str, ...]]) -> dict[tuple[str, ...], str]:
    """Names a setting by its last part alone, where that is enough."""
    last = [path[-1] for path in paths]
    return {path: path[-1] if last.count(path[-1]) == 1 else ".".join(path) for path in paths}


def _text(value: Any) -> str:
    if value is ...:
        return "(not set)"
    text = value_text(value)
    half = _VALUE_LENGTH // 2
    return text if len(text) <= _VALUE_LENGTH else f"{text[:half]}…{text[-half:]}"


def value_text(value: Any) -> str:
    """Returns a setting's value for a reader: 3e-04, not 0.00030000000000000003."""
    if isinstance(value, float) and math.isfinite(value):
        mantissa, exponent = f"{value:.5e}".split("e")
        if value and int(exponent) < -3:
            return f"{mantissa.rstrip('0').rstrip('.')}e{exponent}"
        return f"{value:.6g}"
    return value if isinstance(value, str) else json.dumps(value)


def _exact(value: Any) -> str | None:
    return None if value is ... else json.dumps(value)


def _rank(value: Any) -> tuple[int, float, str]:
    """Sorts numbers by size, before all else."""
    number = isinstance(value, int | float)
    return (0, value, "") if number else (1, 0.0, _text(value))
