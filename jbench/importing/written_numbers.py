"""Numbers as people and spreadsheets write them."""

import math
import re
import unicodedata

_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
"""A number with commas between thousands, such as 1,000 or 1,234.5."""

_DECIMAL_COMMA = re.compile(r"[-+]?\d+(,\d+)?([eE][-+]?\d+)?")
"""A number without commas between thousands, with a decimal comma or without decimals."""

_POINTS_AND_COMMA = re.compile(r"[-+]?\d{1,3}(\.\d{3})+,\d+")
"""A number with points between thousands and a decimal comma, such as 1.234,5."""

_POINTS = re.compile(r"[-+]?[1-9]\d{0,2}(\.\d{3})+")
"""A number with points between thousands and no decimals, such as 1.000 or 1.234.567."""

_SPACED = re.compile(r"[-+]?\d{1,3}([ '_\u00a0\u2009\u202f]\d{3})+(\.\d*)?")
"""A number with spaces, apostrophes or underscores between thousands."""

_UNIT = re.compile(r"([-+]?\d+\.?\d*) ?([kKmM])")
_UNITS = {"k": 1e3, "m": 1e6}

_MISSING = ("", "nan", "na", "n/a", "none", "null", "nil", "-")


def has_decimal_commas(texts: list[str]) -> bool:
    """Returns whether the texts of a column are numbers whose commas can only be decimal ones.

    At least one of them, such as 100,5, has no other meaning; 1,000 has two.
    """
    with_comma = [text for text in texts if "," in text]
    if not with_comma or not all(_DECIMAL_COMMA.fullmatch(text) for text in texts if text):
        return False

    return any(not _THOUSANDS.fullmatch(text) for text in with_comma)


def may_have_thousands(text: str) -> bool:
    """Returns whether the points of a number may stand between thousands, as in 1.000."""
    return _POINTS.fullmatch(text) is not None


def correction_of(text: str) -> str:
    """Returns what to type instead of a text that is no clear number, as the end of a sentence."""
    text = text.strip()
    if text.lower() in _MISSING:
        return "remove that line"

    if may_have_thousands(text):
        correction = f"write {text.replace('.', '')}"
        if text.count(".") == 1:
            correction += f", or {text.replace('.', ',')} if that is a decimal point"
        return correction

    number = _number_in_any_script(text)
    if math.isfinite(number):
        return f"write {number:.15g}"

    if unit := _UNIT.fullmatch(text):
        return f"write {float(unit[1]) * _UNITS[unit[2].lower()]:.15g}"

    if _SPACED.fullmatch(text):
        return f"write {re.sub(r'[^-+0-9.]', '', text)}"

    if _POINTS_AND_COMMA.fullmatch(text):
        return f"write {text.replace('.', '').replace(',', '.')}"

    if _THOUSANDS.fullmatch(text):
        correction = f"write {text.replace(',', '')}"
        if text.count(",") == 1 and "." not in text:
            correction += f", or {text.replace(',', '.')} if that is a decimal comma"
        return correction

    if "," in text and _DECIMAL_COMMA.fullmatch(text):
        return f"write {text.replace(',', '.')}"

    return "correct it, or remove that line"


def _number_in_any_script(text: str) -> float:
    """Returns a number whose digits or minus sign are not those of ASCII; NaN if it is none."""
    ascii_sign = unicodedata.normalize("NFKC", text).replace("\N{MINUS SIGN}", "-")
    try:
        return float(ascii_sign)
    except ValueError:
        return math.nan
