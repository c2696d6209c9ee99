"""Text of strangers in a page: shown as it is, and never anything but text."""

import json
import re
from html import escape
from typing import Any

# Characters that a page must not hold, or that turn the text around them about: ids and settings
# come from files that anybody may have written.
_UNSHOWN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]"
)


def plain(text: object) -> str:
    r"""Returns text with each control character written out, such as `\u202e`."""
    return _UNSHOWN.sub(lambda match: f"\\u{ord(match[0]):04x}", str(text))


def html(text: object) -> str:
    """Returns text as HTML that shows it, in an element or in a quoted attribute."""
    return escape(plain(text), quote=True)


def json_block(value: Any) -> str:
    """Returns a value as JSON that can stand in a script element of data."""
    # With "<" written out nothing can end the element, and "&" means nothing in it.
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def identifier(name: str) -> str:
    """Returns a name as an HTML id: letters, digits, and hyphens for all else."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "x"


def paragraphs(texts: Any) -> str:
    """Returns a paragraph of HTML for each text."""
    return "".join(f"<p>{html(text)}</p>\n" for text in texts)
