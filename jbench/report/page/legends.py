"""Legends of figures as HTML, so that they stay readable on any screen."""

from collections.abc import Iterator
from typing import Any

from matplotlib.colors import to_hex
from matplotlib.markers import MarkerStyle

from jbench.report.figure import Figure, Shade, Style
from jbench.report.page.text import html

_WIDTH, _HEIGHT = 26.0, 10.0  # points
# In line widths, as matplotlib draws them.
_DASHES: dict[str, tuple[float, ...]] = {
    "--": (3.7, 1.6),
    "-.": (6.4, 1.6, 1, 1.6),
    ":": (1, 1.65),
}


def legend(figure: Figure, colors: set[str]) -> str:
    """Returns the legend of a figure as a list; empty if it has none.

    An entry that series belong to has their number in `data-entry`.

    Args:
        colors: receives the colors of the lines.
    """
    belonging = {entry for p in figure.panels for one in p.series for entry in one.belongs_to}
    entries = []
    for i, (label, style) in enumerate(figure.legend):
        colors.add(to_hex(style.color))
        data = f' data-entry="{i}"' if label in belonging else ""
        swatch = "".join(_swatch(style))
        entries.append(
            f'<li{data}><svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" width="{_WIDTH:g}pt" '
            f'height="{_HEIGHT:g}pt" aria-hidden="true">{swatch}</svg>'
            f"<span>{html(label)}</span></li>"
        )
    return f'<ul class="legend">{"".join(entries)}</ul>' if entries else ""


def _swatch(style: Style | Shade) -> Iterator[str]:
    color = to_hex(style.color)
    if isinstance(style, Shade):
        yield f'<rect width="{_WIDTH:g}" height="{_HEIGHT:g}" fill="{color}" '
        yield f'fill-opacity="{style.alpha:g}"/>'
        return
    middle, opacity = _HEIGHT / 2, f'opacity="{style.alpha:g}"'
    if style.dash:
        parts = _DASHES.get(style.dash, ()) if isinstance(style.dash, str) else style.dash[1]
        dashes = " ".join(f"{part * style.width:.3g}" for part in parts)
        pattern = f' stroke-dasharray="{dashes}"' if dashes else ""
        if dashes and style.marker:  # it covers the middle of a dash, not a gap
            pattern += f' stroke-dashoffset="{(parts[0] * style.width - _WIDTH) / 2:.3g}"'
        yield f'<path d="M0 {middle:g}H{_WIDTH:g}" fill="none" stroke="{color}" '
        yield f'stroke-width="{style.width:g}" {opacity}{pattern}/>'
    if style.marker:
        fill = "#ffffff" if style.hollow else color
        marker = MarkerStyle(style.marker)
        path = marker.get_path().transformed(marker.get_transform())
        polygons: list[Any] = list(path.to_polygons())
        for polygon in polygons:
            corners = " ".join(
                f"{_WIDTH / 2 + x * style.size:.4g},{middle - y * style.size:.4g}"
                for x, y in polygon
            )
            yield f'<polygon points="{corners}" fill="{fill}" stroke="{color}" {opacity}/>'
