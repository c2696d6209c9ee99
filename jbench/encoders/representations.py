"""What a representation that a user types asks for, such as dae12-observation-whitened.

`REPRESENTATION` is the form of these names; `EncoderSettings.representation` writes them.
"""

from collections.abc import Mapping
from typing import Any

from jbench import plugins
from jbench.encoders.option_names import SCALES, may_be_hash, options_from_name
from jbench.encoders.registry import kind_names, latent_sizes, make_kind
from jbench.encoders.settings import EncoderSettings, wrong_size
from jbench.errors import RequestError
from jbench.names import EncoderBase
from jbench.representation_names import LATENTS, REPRESENTATION


def named_encoder(name: str, task: str) -> EncoderSettings | None:
    """Returns settings that a representation asks for; None for other names, such as an id.

    None is also the answer for names that have hashes of options, which don't say what to make.
    Their options are those in the name, and their dataset and seed are not those of any. The name
    is KIND:LATENTS, KINDLATENTS, or KIND if the task determines the size; what is not the default
    follows, as in dae12-observation-whitened.

    Raises:
        RequestError: if there is no such kind, or its encoders don't have this size.
    """
    match = REPRESENTATION.fullmatch(name)
    kind = name.partition(":")[0]
    if match is not None:
        kind = match["kind"]

    if kind not in kind_names():
        if ":" not in name:
            return None
        if plugins.is_imported(name):
            raise RequestError(f"{name} is a kind of encoder; type the id of an encoder of it.")

    given: dict[str, Any] | None = {}
    endings = ""
    base: EncoderBase | None = None
    if match is not None:
        given = options_from_name(match, task)
        endings = match["endings"]
        if match["base"]:
            base = "script"

    if given is None or _has_hashed_value(kind, given):
        return None

    sizes = latent_sizes(kind, task, given)
    latents = 0
    if match and match["latents"]:
        latents = int(match["latents"].lstrip("0")[:10] or 0)  # Python reads no more than 4300
    elif len(sizes) == 1 and ":" not in name:
        latents = sizes[0]

    problem = wrong_size(kind, task, latents, given)
    if problem is not None:
        raise _no_such_size(problem, kind, sizes, endings)

    return EncoderSettings(
        kind=kind,
        task=task,
        dataset="any",
        latents=latents,
        options=given,
        base=base,
        named=sorted(option for option in given if option not in ("features", *SCALES)),
    )


def _has_hashed_value(kind: str, options: Mapping[str, Any]) -> bool:
    """Returns whether a kind refuses values that may be hashes, such as that of [32, 32] or -0.5.

    Raises a RequestError if it refuses another value.
    """
    plain = {name: value for name, value in options.items() if not may_be_hash(value)}
    if plain == options:
        return False

    make_kind(kind, plain)
    try:
        make_kind(kind, options)
    except RequestError:
        return True
    return False


def _no_such_size(problem: str, kind: str, sizes: range, endings: str) -> RequestError:
    """Returns the refusal of a number of latents, with a name of a size that there is."""
    if not sizes:
        return RequestError(f"{problem}.")
    if len(sizes) == 1:
        return RequestError(f"{problem}; choose {kind}{endings}.")

    size = min(LATENTS, sizes[-1])
    return RequestError(f"{problem}; choose {kind}{size}{endings}, for example.")


def without_options(representation: str) -> str:
    """Returns a representation's name without its single options: dae12 of dae12-noise-0.2."""
    match = REPRESENTATION.fullmatch(representation)
    if match is None or not match["options"]:
        return representation

    first, last = match.span("options")
    return representation[:first] + representation[last:]
