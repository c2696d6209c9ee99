"""How LaTeX writes the characters of a text, so that pdflatex has all of them."""

import re
import unicodedata

_GREEK = [
    "alpha",
    "beta",
    "gamma",
    "delta",
    "epsilon",
    "zeta",
    "eta",
    "theta",
    "iota",
    "kappa",
    "lambda",
    "mu",
    "nu",
    "xi",
    "",
    "pi",
    "rho",
    "varsigma",
    "sigma",
    "tau",
    "upsilon",
    "phi",
    "chi",
    "psi",
    "omega",
]
"""Commands of the letters from U+03B1 on, which pdflatex lacks; omicron has none."""

_CAPITALS = (
    "Gamma",
    "Delta",
    "Theta",
    "Lambda",
    "Xi",
    "Pi",
    "Sigma",
    "Upsilon",
    "Phi",
    "Psi",
    "Omega",
)
"""Commands of the capitals that are no Latin letters."""


def _capital(name: str) -> str:
    """Returns a Greek capital by its name, such as Gamma."""
    unicode_name = name.upper().replace("LAMBDA", "LAMDA")
    return unicodedata.lookup(f"GREEK CAPITAL LETTER {unicode_name}")


_LATEX = str.maketrans(
    {
        **{chr(0x3B1 + place): f"$\\{name}$" for place, name in enumerate(_GREEK) if name},
        **{_capital(name): f"$\\{name}$" for name in _CAPITALS},
        "µ": r"$\mu$",
        "°": r"$^\circ$",
        "±": r"$\pm$",
        "\N{MULTIPLICATION SIGN}": r"$\times$",
        "·": r"$\cdot$",
        "→": r"$\to$",
        "←": r"$\gets$",
        "≤": r"$\le$",
        "≥": r"$\ge$",
        "≠": r"$\ne$",
        "≈": r"$\approx$",
        "∞": r"$\infty$",
        "\N{MINUS SIGN}": "$-$",
        "\N{HORIZONTAL ELLIPSIS}": r"\ldots{}",
        "\N{EM DASH}": "---",
        "\N{LEFT SINGLE QUOTATION MARK}": "`",
        "\N{RIGHT SINGLE QUOTATION MARK}": "'",
        "\N{LEFT DOUBLE QUOTATION MARK}": "``",
        "\N{RIGHT DOUBLE QUOTATION MARK}": "''",
        "\N{NO-BREAK SPACE}": "~",
        "\N{FIGURE SPACE}": "~",
        "¹": "$^1$",
        "³": "$^3$",
        **{character: f"\\{character}" for character in "&%$#_{}"},
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "\\": r"\textbackslash{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
        '"': "''",
        "✓": r"$\surd$",
        "✗": r"$\times$",
        "\N{EN DASH}": "--",
        "[": "{[}",
        "²": "$^2$",
    }
)


_LETTERS = "ÆØßæøŁłŒœı¡¿£"
"""What every font of pdflatex has of itself, beside ASCII."""

_ACCENTS = {
    "\N{COMBINING GRAVE ACCENT}": r"\`",
    "\N{COMBINING ACUTE ACCENT}": r"\'",
    "\N{COMBINING CIRCUMFLEX ACCENT}": r"\^",
    "\N{COMBINING TILDE}": r"\~",
    "\N{COMBINING DIAERESIS}": r"\"",
    "\N{COMBINING RING ABOVE}": r"\r",
    "\N{COMBINING CARON}": r"\v",
    "\N{COMBINING CEDILLA}": r"\c",
    "\N{COMBINING MACRON}": r"\=",
    "\N{COMBINING BREVE}": r"\u",
    "\N{COMBINING DOT ABOVE}": r"\.",
    "\N{COMBINING DOUBLE ACUTE ACCENT}": r"\H",
}
"""Commands of the accents that every font of pdflatex has."""


def escaped(text: str) -> str:
    """Returns a text in which no character is a command of LaTeX, and hyphens are no dash.

    A character that pdflatex lacks is written by its number, such as U+1F680.
    """
    parts = re.split(r"(?<=-)(?=-)", unicodedata.normalize("NFC", text))
    return "{}".join("".join(map(_character, part)) for part in parts)


def _character(character: str) -> str:
    """Returns a character as LaTeX has it."""
    if known := _LATEX.get(ord(character)):
        return known
    if character.isascii() or character in _LETTERS:
        return character

    parts = unicodedata.normalize("NFD", character)
    letter = parts[0]
    accent = _ACCENTS.get(parts[1:])
    if accent is not None and letter.isascii():
        return f"{accent}{{{letter}}}"

    return f"U+{ord(character):04X}"
