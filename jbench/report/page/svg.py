"""Cleans matplotlib's SVG for a page: unique ids, attributes instead of styles, colors."""

import re
from xml.etree import ElementTree

_COLOR = re.compile(r"#[0-9a-f]{6}")
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_DECIMALS = re.compile(r"(?<=\.\d)\d+")  # a tenth of a point is precise enough
_NOT_ATTRIBUTES = ("font", "mix-blend-mode", "-inkscape-stroke")


def clean(
    root: ElementTree.Element, prefix: str, colors: set[str], keep: tuple[str, ...] = ()
) -> None:
    """Converts a drawing in place, and collects its colors.

    Args:
        colors: receives the colors that differ on a dark page.
        keep: prefixes of the ids of elements that keep their colors.
    """
    _clean(root, prefix, colors, keep, False)
    _drop_ids(root)


def _clean(
    element: ElementTree.Element, prefix: str, colors: set[str], keep: tuple[str, ...], kept: bool
) -> None:
    """Converts an element and its children; `kept` is whether a parent keeps its colors."""
    element.tag = element.tag.rpartition("}")[2]
    element.text = element.tail = None
    for child in list(element):
        if child.tag.rpartition("}")[2] in ("metadata", "style", "title"):
            element.remove(child)
    begins = element.get("id", "").startswith(keep)
    kept = kept or begins
    for name, value in list(element.attrib.items()):
        del element.attrib[name]
        element.attrib.update(_attributes(name.rpartition("}")[2], value, prefix))
    for name in ("fill", "stroke"):
        color = element.get(name, "")
        if _COLOR.fullmatch(color) and kept:
            element.set(name, _unmatched(color))
        elif _COLOR.fullmatch(color):
            colors.add(color)
    if begins and element.get("fill") is None:
        element.set("fill", _unmatched("#000000"))  # the default, which the page's CSS changes
    for child in element:
        _clean(child, prefix, colors, keep, kept)
        if element.tag == "defs" and child.tag == "path":
            # The `<use>` of the path has the same color. The page's rules match only the `<use>`,
            # since the copy of the path in it has no `<figure>` above it.
            child.attrib.pop("stroke", None)


def _attributes(name: str, value: str, prefix: str) -> dict[str, str]:
    """Returns the attributes in a page for an attribute of matplotlib's SVG."""
    if name == "style":
        pairs = [part.split(":", 1) for part in value.split(";") if ":" in part]
        styles = {key.strip(): text.strip() for key, text in pairs}
        return {
            key: _REFERENCE.sub(rf"url(#{prefix}\1)", text)
            for key, text in styles.items()
            if key not in _NOT_ATTRIBUTES
        }
    if name == "id":
        return {name: prefix + value}
    if name == "href":
        return {name: f"#{prefix}{value[1:]}" if value.startswith("#") else value}
    if name == "d":
        return {name: _DECIMALS.sub("", " ".join(value.split()))}
    return {name: _REFERENCE.sub(rf"url(#{prefix}\1)", value)}


def _drop_ids(root: ElementTree.Element) -> None:
    """Removes the ids that nothing refers to, which are most."""
    used = {
        name
        for element in root.iter()
        for value in element.attrib.values()
        for name in (*_REFERENCE.findall(value), value[1:] if value.startswith("#") else "")
    }
    for element in root.iter():
        if element.get("id") not in used:
            element.attrib.pop("id", None)


def _unmatched(color: str) -> str:
    """Returns a color in a notation that the dark page's style sheet does not match."""
    return f"rgb({','.join(str(int(color[i : i + 2], 16)) for i in (1, 3, 5))})"
