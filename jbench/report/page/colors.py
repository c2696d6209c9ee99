"""Colors of figures on a dark page."""

from collections.abc import Iterable

PAPER = (24, 27, 33)
"""Background (red, green and blue, 0 to 255) of figures on the dark page, as in `style.css`."""

INK = (230, 233, 237)
"""Color on the dark page of what is black on the light page."""

_CONTRAST = 4.0  # WCAG 2.2 requires 3 for graphics


def on_dark(color: str) -> str:
    """Returns the color on the dark page for a color of a figure, "#rrggbb".

    Greys are inverted. Other colors keep their hue, and are lightened until they stand out.
    """
    rgb = tuple(int(color[i : i + 2], 16) for i in (1, 3, 5))
    if max(rgb) - min(rgb) <= 2:
        share = rgb[1] / 255
        rgb = tuple(round(i + (p - i) * share) for i, p in zip(INK, PAPER, strict=True))
        return _hex(rgb)
    white = 0.0
    lighter = rgb
    while _contrast(lighter, PAPER) < _CONTRAST:
        white += 0.05
        lighter = tuple(round(c + (255 - c) * white) for c in rgb)
    return _hex(lighter)


def both(color: str) -> str:
    """Returns the CSS for a figure's color on the light and on the dark page."""
    return f"light-dark({color},{on_dark(color)})"


def rules(colors: Iterable[str]) -> str:
    """Returns the style sheet for these colors of figures, "#rrggbb", on both pages."""
    return "\n".join(
        f"figure [{name}='{color}']{{{name}:{both(color)}}}"
        for color in sorted(set(colors))
        for name in ("fill", "stroke")
    )


def _hex(rgb: Iterable[int]) -> str:
    return "#" + "".join(f"{c:02x}" for c in rgb)


def _contrast(one: tuple[int, ...], other: tuple[int, ...]) -> float:
    """Returns the contrast ratio of two colors (WCAG 2.2, "contrast ratio")."""
    high, low = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def _luminance(rgb: tuple[int, ...]) -> float:
    """Returns the relative luminance of a color (WCAG 2.2, "relative luminance")."""
    linear = [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (i / 255 for i in rgb)
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
