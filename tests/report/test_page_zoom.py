"""Tests of zooming into the figures of a report's page in a real browser."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from playwright.sync_api import expect

from jbench.report.document import FigureItem, Section
from jbench.report.figure import Axis, Figure, Panel, Series, Style
from jbench.report.page import render_document
from tests.report import page_documents as made
from tests.report.browser import PHONE

LEFT, RIGHT = 54.72, 342.72
"""Edges of the panel of `page_documents.curves_figure` in points: 0 and 30,000 steps."""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "index.html"
    path.write_bytes(render_document(made.document()).encode())
    return path


def pixel(page, steps, low=0.0, high=30_000.0):
    """Returns the screen position of control steps at half of the panel's height."""
    svg = page.page.locator("#curves svg[role]")
    svg.scroll_into_view_if_needed()
    box = svg.bounding_box()
    points = LEFT + (RIGHT - LEFT) * (steps - low) / (high - low)
    width = svg.evaluate("(one) => one.viewBox.baseVal.width")
    return box["x"] + points / width * box["width"], box["y"] + box["height"] / 2


def drag(page, start, end):
    page.page.mouse.move(*pixel(page, start))
    page.page.mouse.down()
    page.page.mouse.move(*pixel(page, (start + end) / 2))
    page.page.mouse.move(*pixel(page, end))
    page.page.mouse.up()


def limits(page):
    """Returns the limits in the page's address, or None."""
    found = re.search(r"zoom\+curves\+0=([\d.]+)\+([\d.]+)", page.page.evaluate("location.hash"))
    return found and [float(limit) for limit in found.groups()]


def ticks(page, figure="curves"):
    return page.page.locator(f"#{figure} .ticks text").all_text_contents()


def zoomed(opened, written, state="zoom+curves+0=10000+20000", **options):
    page = opened(written, **options)
    page.page.goto(f"{written.as_uri()}#view:{state}")
    page.page.reload()
    page.requests.clear()
    return page


def test_drag_zooms_and_updates_address(opened, written):
    page = opened(written)
    drag(page, 20_000, 10_000)
    assert limits(page) == pytest.approx([10_000, 20_000], abs=100)
    assert ticks(page) == ["10", "12", "14", "16", "18", "20"]
    expect(page.page.locator("#curves [data-tick=x]").first).to_be_hidden()
    expect(page.page.locator("#curves [data-tick=y]").first).to_be_visible()


def test_zoomed_lines_are_clipped_to_new_limits(opened, written):
    page = zoomed(opened, written)
    lines = page.page.locator("#curves [data-of] > path")
    x = [float(part) for part in re.findall(r"([\d.-]+) [\d.-]+", lines.first.get_attribute("d"))]
    # 30 points from 1000 to 30,000 steps; the twelfth, 12,000, is at a fifth of the new axis.
    assert len(x) == 30
    assert x[11] == pytest.approx(LEFT + 0.2 * (RIGHT - LEFT), abs=0.4)
    assert x[0] == pytest.approx(LEFT - 0.9 * (RIGHT - LEFT), abs=0.4)
    clip = page.page.locator("#curves clipPath rect").first
    assert float(clip.get_attribute("x")) == pytest.approx(LEFT)


def test_bands_and_markers_are_zoomed_with_lines(opened, written):
    page = zoomed(opened, written)
    band = page.page.locator("#curves [data-of] defs path").first.get_attribute("d")
    assert f"{LEFT + 0.2 * (RIGHT - LEFT):.1f} " in band
    page = zoomed(opened, written, "zoom+errors+1=4+12")
    at = page.page.locator("#errors [data-panel='1'] [data-of] use")
    x = [float(one.get_attribute("x")) for one in at.all()]
    # Latents 2, 4, 8 and 12.
    assert x[2] - x[1] == pytest.approx(x[3] - x[2], abs=0.2)
    assert x[1] - x[0] == pytest.approx((x[2] - x[1]) / 2, abs=0.2)
    assert ticks(page, "errors") == ["4", "6", "8", "10", "12"]


def test_pointer_and_arrow_keys_read_zoomed_values(opened, written):
    page = zoomed(opened, written)
    page.page.mouse.move(*pixel(page, 12_000, 10_000, 20_000))
    assert page.tip()[:2] == ["face_direction", "control steps (thousands): 12"]
    page.page.locator("#curves .drawing").focus()
    page.page.keyboard.press("ArrowRight")
    assert page.tip()[1] == "control steps (thousands): 20"
    for _ in range(40):
        page.page.keyboard.press("ArrowLeft")
    assert page.tip()[1] == "control steps (thousands): 10"


def test_double_click_resets_zoom(opened, written):
    page = zoomed(opened, written)
    page.page.mouse.dblclick(*pixel(page, 15_000))
    assert (ticks(page), page.page.evaluate("location.hash")) == ([], "")
    expect(page.page.locator("#curves [data-tick=x]").first).to_be_visible()
    line = page.page.locator("#curves [data-of] > path").first
    assert line.get_attribute("d").startswith("M 64.3 195.4 ")


def test_click_does_not_zoom(opened, written):
    page = opened(written)
    page.page.mouse.click(*pixel(page, 15_000))
    assert page.page.evaluate("location.hash") == ""


def test_escape_cancels_drag(opened, written):
    page = opened(written)
    page.page.mouse.move(*pixel(page, 10_000))
    page.page.mouse.down()
    page.page.mouse.move(*pixel(page, 20_000))
    expect(page.page.locator("#curves .area")).to_have_count(1)
    page.page.keyboard.press("Escape")
    page.page.mouse.up()
    expect(page.page.locator("#curves .area")).to_have_count(0)
    assert limits(page) is None


def test_drag_ends_when_button_is_released_outside_of_figure(opened, written):
    page = opened(written)
    x, y = pixel(page, 10_000)
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x, page.page.locator("#curves").bounding_box()["y"] - 20)
    page.page.mouse.up()
    for steps in (15_000, 20_000):
        page.page.mouse.move(*pixel(page, steps))
        expect(page.page.locator("#curves .area")).to_have_count(0)
    assert page.tip()[1] == "control steps (thousands): 20"


def test_keyboard_zooms_and_resets(opened, written):
    page = opened(written)
    button = page.page.locator("#curves").get_by_role("button", name="Reset zoom")
    expect(button).to_be_hidden()
    page.page.locator("#curves .drawing").focus()
    for _ in range(15):
        page.page.keyboard.press("ArrowLeft")
    page.page.keyboard.press("+")
    # Half of the axis, centered at 15,000 steps.
    assert limits(page) == [7500, 22500]
    assert page.tip()[1] == "control steps (thousands): 15"
    for _ in range(9):
        page.page.keyboard.press("+")
    low, high = limits(page)
    assert high - low == pytest.approx(0.05 * 30_000)
    page.page.keyboard.press("-")
    assert limits(page)[1] - limits(page)[0] == pytest.approx(0.1 * 30_000)
    button.focus()
    page.page.keyboard.press("Enter")
    assert limits(page) is None
    expect(button).to_be_hidden()
    expect(page.page.locator("#curves .drawing")).to_be_focused()


@pytest.mark.parametrize(
    "typed",
    [
        *("20000+10000", "x+y"),
        *(
            pytest.param(typed, marks=pytest.mark.slow)
            for typed in ("5000", "-1e9+1e9", "0+30000", "")
        ),
    ],
)
def test_address_with_invalid_limits_shows_whole_panel(opened, written, typed):
    assert ticks(zoomed(opened, written, f"zoom+curves+0={typed}")) == []


def test_limits_too_close_or_outside_are_adjusted(opened, written):
    # A twentieth of the axis, 1500 steps, centered at 15,000.
    page = zoomed(opened, written, "zoom+curves+0=15000+15001")
    assert ticks(page) == ["14.5", "15", "15.5"]
    # The last 12,000 steps, from 18,000.
    page = zoomed(opened, written, "zoom+curves+0=28000+40000")
    assert ticks(page) == ["20", "22.5", "25", "27.5", "30"]


def sizes_figure():
    """Returns points of two representations at four sizes, offset from the ticks of the sizes."""
    sizes = Axis("size", (-0.5, 3.5), ticks=range(4), names=["2", "4", "8", "16"])
    at, style = np.arange(4.0), Style("#cc79a7", marker="o")
    series = [Series(at - 0.2, 100 * at, style, "pca"), Series(at + 0.2, 200 * at, style, "dae")]
    return Figure("Sizes", [Panel("", sizes, Axis("return", (-15, 1015)), series)])


def test_named_ticks_are_zoomed_and_shown_in_tooltip(opened, tmp_path):
    section = Section("Sizes", [], [FigureItem("sizes", "Sizes", sizes_figure())])
    path = tmp_path / "index.html"
    path.write_bytes(render_document(made.document(sections=[section])).encode())
    page = zoomed(opened, path, "zoom+sizes+0=0.5+2.5")
    assert ticks(page, "sizes") == ["4", "8"]
    page.page.locator("#sizes .drawing").focus()
    page.page.keyboard.press("ArrowRight")
    assert page.tip() == ["size: 8", "pca", "200"]


def test_heat_maps_do_not_zoom(opened, written):
    page = zoomed(opened, written, "zoom+matrix+0=0+1")
    assert ticks(page, "matrix") == []
    expect(page.page.locator("#matrix").get_by_text("Reset zoom")).to_have_count(0)


def test_saved_figure_is_zoomed(opened, written, tmp_path):
    page = zoomed(opened, written)
    with page.page.expect_download() as download:
        page.page.locator("#curves").get_by_role("button", name="Save SVG").click()
    download.value.save_as(tmp_path / "curves.svg")
    root = ElementTree.parse(tmp_path / "curves.svg").getroot()
    texts = [one.text for one in root.iter("{http://www.w3.org/2000/svg}text")]
    assert texts[:6] == ["10", "12", "14", "16", "18", "20"]
    assert root.get("font-family") == "sans-serif"
    assert [one for one in root.iter() if one.get("data-tick") == "x"] == []


def test_touch_scrolls_page_and_does_not_zoom(opened, written):
    page = opened(written, viewport=PHONE, has_touch=True, is_mobile=True)
    x, y = pixel(page, 15_000)
    session = page.context.new_cdp_session(page.page)
    before = page.page.evaluate("scrollY")

    def touch(kind, *points):
        touched = [{"x": px, "y": py} for px, py in points]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touched})

    for dx, dy in ((0, 3), (6, 0)):
        touch("touchStart", (x, y))
        for step in range(1, 15):
            touch("touchMove", (x + dx * step, y - dy * 4 * step))
        touch("touchEnd")
    page.page.wait_for_function(f"scrollY > {before + 50}")
    assert page.page.evaluate("location.hash") == ""
    expect(page.page.locator(".area")).to_have_count(0)
