"""Colors of series: contrast with their background, and distances as the color-blind see them.

Numbers follow WCAG 2.2 (relative luminance, contrast), CIE 1976 (L*a*b*) and Machado et al., 2009
(what the color-blind see).
"""

import re
from importlib import resources

import numpy as np
import pandas as pd
import pytest

from jbench.report import style
from jbench.representation_names import ENCODER_KINDS

LEAST_CONTRAST = 3.0  # of lines and marks (WCAG 2.2, 1.4.11)
VISION = {
    "usual": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
}
MAIN = ("full", "scaled", "planar", "forward", "random", "pca", "dae", "heading", "raw")
ALGORITHMS = ("DDPG", "PPO", "SAC", "TD3", *(f"their own {i}" for i in range(7)))


def light(color):
    """Returns the linear red, green and blue of a color such as #0072b2."""
    values = np.array([int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def contrast(first, second):
    """Returns the contrast of two colors, from 1 to 21."""
    weights = [0.2126, 0.7152, 0.0722]
    darker, lighter = sorted(light(color) @ weights for color in (first, second))
    return (lighter + 0.05) / (darker + 0.05)


def lab(rgb):
    """Returns L*, a* and b* of linear colors (..., 3)."""
    to_xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    xyz = rgb @ to_xyz.T / to_xyz.sum(axis=1)
    root = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def least_distance(colors, vision):
    """Returns the distance of the two colors that are most alike; 2.3 can just be seen."""
    seen = np.clip([np.array(VISION[vision]) @ light(color) for color in colors], 0, 1)
    places = lab(seen)
    distances = np.linalg.norm(places[:, None] - places[None], axis=2)
    return distances[np.triu_indices(len(colors), 1)].min()


def series_colors(names, by):
    """Returns the color of each of some kinds of representations, or of some algorithms."""
    found = style.looks(pd.DataFrame({"name": names, by: names}), "name", by)
    return [found[name].color for name in names]


def backgrounds():
    """Returns the colors that series are drawn on: white paper, and both cards of the page."""
    sheet = resources.files("jbench.report").joinpath("templates", "style.css").read_text("utf-8")
    (cards,) = re.findall(r"--card: light-dark\((\S+), (\S+)\);", sheet)
    return ["#ffffff", *(re.sub(r"^#(.)(.)(.)$", r"#\1\1\2\2\3\3", card) for card in cards)]


def test_contrasts_and_distances_are_those_of_colors_whose_numbers_are_known():
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#767676", "#ffffff") == pytest.approx(4.54, abs=0.01)  # WCAG's own example
    assert lab(light("#ff0000")) == pytest.approx([53.2, 80.1, 67.2], abs=0.2)
    assert least_distance(["#ff0000", "#00ff00"], "usual") == pytest.approx(170.6, abs=0.5)
    gray = [least_distance(["#333333", "#999999"], vision) for vision in VISION]
    assert gray == pytest.approx([gray[0]] * 3, abs=0.1)  # the color-blind see grays as others do


@pytest.mark.parametrize("background", backgrounds())
def test_each_color_of_a_series_is_seen_on_each_background(background):
    kinds = [*MAIN, *ENCODER_KINDS, *(f"mine{letter}" for letter in "abcdef")]
    drawn = {*series_colors(kinds, "kind"), *series_colors(ALGORITHMS, "algo"), style.SOFT}
    if background != "#ffffff":
        drawn -= {style.SOFT}  # which the page replaces by one of its theme
    low = {color: contrast(color, background) for color in drawn}
    assert {color: at for color, at in low.items() if at < LEAST_CONTRAST} == {}
    assert len(low) > 25


@pytest.mark.parametrize("vision", VISION)
def test_the_color_blind_can_tell_main_representations_and_algorithms_apart(vision):
    assert least_distance(series_colors(MAIN, "kind"), vision) > 10
    assert least_distance(series_colors(ALGORITHMS, "algo"), vision) > 14


def test_main_representations_have_markers_of_their_own():
    found = style.looks(pd.DataFrame({"name": MAIN, "kind": MAIN}), "name", "kind")
    assert len({look.marker for look in found.values()}) == len(MAIN)
