"""Parts of an observation: the option `features` of every kind, its names and its short form.

A list names parts of the observation (`velocity`) or single values (`velocity_angular_z`), as
`encoder_features` lists them. Each name adds what it names, one with a leading minus takes it away,
and a list that begins with a minus begins with all features. Several lists can mean the same
features: ids contain the one that `shortest` returns.
"""

import re
from collections.abc import Sequence

from jbench.errors import RequestError
from jbench.settings.base import settings_hash
from jbench.tasks.find import find_task
from jbench.typed_values import closest, suggested

ALL_BUT = "without"
ONLY = "of"
HASHED = "features"
"""Words of a representation's name before the features that are left out, those that are kept, or
a hash of names that are too long or have other characters than a name may have."""

_LONGEST = 50  # characters of names in a representation


def columns(task: str, features: Sequence[str] | None) -> list[int]:
    """Returns which values of a task's observation are chosen, in order; all for None.

    Raises:
        RequestError: if the task's observation has no such feature, or none is left.
    """
    named = _columns_by_name(task)
    everything = list(range(find_task(task).observation_size))
    if features is None:
        return everything

    chosen = set[int]()
    if features and features[0].startswith("-"):
        chosen.update(everything)

    for feature in features:
        name = feature.removeprefix("-")
        if name not in named:
            raise _unknown(task, name)
        if feature.startswith("-"):
            chosen.difference_update(named[name])
        else:
            chosen.update(named[name])

    if not chosen:
        raise RequestError(
            f"features={','.join(features)} leaves no feature of {task}: type those to keep, or a "
            "minus before those to leave out."
        )

    return sorted(chosen)


def shortest(task: str, features: Sequence[str] | None) -> list[str] | None:
    """Returns the shortest list for the same features, such as ["-velocity"]; None for all.

    It is the list of those that are kept if it is shorter than the list of those left out. Raises a
    RequestError as `columns` does, and if names mean other features, too.
    """
    kept = columns(task, features)
    left = [column for column in columns(task, None) if column not in kept]
    if not left:
        return None
    names_kept = _names(task, kept)
    names_left = [f"-{name}" for name in _names(task, left)]
    # Of two lists of one length it is that of those left out.
    for names in sorted((names_left, names_kept), key=len):
        if columns(task, names) == kept:
            return names

    raise RequestError(
        f"These features of {task} have no name of their own, since a part of its observation is "
        "called as a value of another one; rename a part in the environment, or choose others."
    )


def in_name(features: Sequence[str]) -> str:
    """Returns the part of a representation's name for what `shortest` returned: without-velocity.

    Names are joined by dots.
    """
    word = ONLY
    if features[0].startswith("-"):
        word = ALL_BUT

    names = ".".join(name.removeprefix("-") for name in features)
    if len(names) <= _LONGEST and re.fullmatch(r"[A-Za-z0-9_.]+", names):
        return f"{word}-{names}"
    return f"{HASHED}-{settings_hash({'features': list(features)})}"


def from_name(text: str, task: str) -> list[str]:
    """Returns the list of features that `in_name` has made a name of, unless that is a hash.

    A name of the task's observation may have dots itself.
    """
    word, _, joined = text.partition("-")
    named = _columns_by_name(task)
    rest = joined.split(".")
    names = list[str]()
    while rest:
        ends = (end for end in range(len(rest), 0, -1) if ".".join(rest[:end]) in named)
        end = next(ends, 1)
        names.append(".".join(rest[:end]))
        rest = rest[end:]

    if word == ALL_BUT:
        return [f"-{name}" for name in names]
    return names


def _names(task: str, chosen: Sequence[int]) -> list[str]:
    """Returns names of values: one for a part of which all are chosen."""
    labels = find_task(task).labels
    names = list[str]()
    for part, some in _columns_of_parts(task).items():
        of_part = [column for column in some if column in chosen]
        is_whole = len(of_part) == len(some)
        if is_whole:
            names.append(part)
        else:
            names += [labels[column] for column in of_part]

    return names


def _columns_by_name(task: str) -> dict[str, list[int]]:
    """Returns the columns of each part and of each value of an observation, by name.

    A part such as position_0 may be called as a value of another one; the name means the part.
    """
    named = {label: [column] for column, label in enumerate(find_task(task).labels)}
    return named | _columns_of_parts(task)


def _columns_of_parts(task: str) -> dict[str, list[int]]:
    """Returns the columns of each part of an observation, by name, in order."""
    by_part = dict[str, list[int]]()
    first = 0
    for part, size in find_task(task).parts.items():
        by_part[part] = list(range(first, first + size))
        first += size
    return by_part


def _unknown(task: str, name: str) -> RequestError:
    """Returns the refusal of a feature that a task does not have, with those that it has."""
    about = find_task(task)
    parts = []
    for part, columns_of_part in _columns_of_parts(task).items():
        labels = [about.labels[column] for column in columns_of_part]
        if len(labels) > 1:
            part += f" ({', '.join(labels)})"
        parts.append(part)

    close = closest(name, [*about.parts, *about.labels])
    advice = suggested(close, f"it has {', '.join(parts)}")
    return RequestError(f"The observation of {task} has no feature {name}; {advice}.")
