"""Escaping of untrusted text in a page."""

import json
import re
from html import escape
from typing import Any

# Characters that are invalid in HTML, or that reverse the text around them.
_UNSHOWN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]"
)


def plain(text: object) -> str:
    r"""Returns text with control characters escaped, such as `\u202e`."""
    return _UNSHOWN.sub(lambda match: f"\\u{ord(match[0]):04x}", str(text))


def html(text: object) -> str:
    """Returns text escaped for an HTML element or a quoted attribute."""
    return escape(plain(text), quote=True)


def classes(**applies: bool) -> str:
    """Returns the attribute `class` of an element, with the names that apply; empty without any."""
    names = " ".join(name for name, does in applies.items() if does)
    return f' class="{names}"' if names else ""


def with_asides(sentence: str) -> str:
    """Returns a sentence as HTML in which parentheses of several words are marked as asides."""
    return re.sub(r"(\([^() ]+ [^()]*\))", r"<span>\1</span>", html(sentence))


def json_block(value: Any) -> str:
    """Returns a value as JSON for a script element of data."""
    # With "<" escaped, nothing can end the element; "&" has no special meaning in it.
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def identifier(name: str) -> str:
    """Returns a name as an HTML id of letters, digits and hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "x"
