"""Tests of the run dialog of a report's page in a real browser."""

import re

import numpy as np
import pytest
from playwright.sync_api import expect

from jbench.report.data.paths import RunPath
from jbench.report.document import RunCurve, RunDetail
from jbench.report.page import render_document
from tests.report import page_documents as made
from tests.report.browser import PHONE

STEPS = np.array([20_000.0, 40_000, 60_000])
NAMES = made.provenance()["run"].tolist()


NO_TARGET = np.full(3, np.nan)
# LAST moves 20 cm along x and has a target beyond its end; FIRST moves 5 cm along y.
FIRST = RunPath(20_000.0, 12.0, np.array([[0, 0], [0, 0.05]]), np.pi / 2, NO_TARGET)
LAST = RunPath(
    60_000.0,
    *(612.3, np.array([[0, 0], [0.1, 0.02], [0.2, 0]]), 0.0, np.array([0.25, -0.05, np.pi / 2])),
)


def detail(number, cell, curves=(), paths=(), **changes):
    settings = {"algo": "td3", "seed": str(number), "tau": "0.005", **changes}
    tags = {"task": "face_direction", "algorithm": settings["algo"].upper(), "source": "ours"}
    return RunDetail(NAMES[number], ("ours", cell), settings, curves, tags, paths)


def curves(height):
    trained = RunCurve(
        "training return, mean over 2 episodes", STEPS - 10_000, STEPS / 100 + height
    )
    return [RunCurve("evaluation return", STEPS, STEPS / 100 + height), trained]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    runs = [
        detail(0, "a", curves(0)),
        detail(1, "b", [], algo="sac", alpha="<b>auto</b>"),
        detail(2, "a", curves(100), tau="0.01"),
    ]
    path = tmp_path_factory.mktemp("page") / "index.html"
    path.write_bytes(render_document(made.document(runs=runs)).encode())
    return path


def row(page, name):
    return page.page.locator("#to-provenance tbody tr", has_text=name)


def open_run(page, name):
    row(page, name).locator("button").click()
    return page.page.get_by_role("dialog")


def cells(table):
    return [each.locator("th, td").all_inner_texts() for each in table.locator("tbody tr").all()]


def test_row_opens_run_compared_with_first_other_of_cell(opened, written):
    page = opened(written)
    row(page, NAMES[2]).locator("td").first.click()
    dialog = page.page.get_by_role("dialog", name=NAMES[2])
    expect(dialog.locator("select")).to_have_value(NAMES[0])
    expect(dialog.get_by_role("heading", name="Settings that differ: 2")).to_be_visible()
    assert cells(dialog.locator("table").first) == [["seed", "2", "0"], ["tau", "0.01", "0.005"]]


def test_compared_run_can_be_changed(opened, written):
    page = opened(written)
    dialog = open_run(page, NAMES[0])
    expect(dialog.locator("select")).to_have_value(NAMES[2])
    expect(dialog.locator("svg[role] g")).to_have_count(4)
    dialog.locator("select").focus()
    page.page.keyboard.press("ArrowUp")
    expect(dialog.locator("select")).to_have_value(NAMES[1])
    expect(dialog.locator("select")).to_be_focused()
    assert cells(dialog.locator("table").first) == [
        ["algo", "td3", "sac"],
        ["seed", "0", "1"],
        ["alpha", "not set", "<b>auto</b>"],
    ]
    # The other run has no curves.
    expect(dialog.locator("svg[role] g")).to_have_count(2)


def test_curve_of_run_is_drawn_with_tooltip(opened, written):
    page = opened(written)
    dialog = open_run(page, NAMES[0])
    dialog.locator("select").select_option(NAMES[1])
    svg = dialog.locator("svg[role]")
    assert svg.locator("text").all_text_contents()[:4] == ["0", "10", "20", "30"]
    # Evaluations at 20, 40 and 60 thousand steps are at thirds of the axis; a return of 500 is in
    # the middle of -15 to 1015.
    right = float(svg.get_attribute("width")) - 12
    path = svg.locator(".this.line0 path").get_attribute("d").removeprefix("M").split("L")
    x, y = np.array([[float(number) for number in point.split()] for point in path]).T
    assert x == pytest.approx(48 + (right - 48) * np.array([1 / 3, 2 / 3, 1]))
    height = 280 - 36 - 10
    assert y == pytest.approx(10 + height * (1 - (np.array([200, 400, 600]) + 15) / 1030))
    dialog.locator(".drawing").focus()
    page.page.keyboard.press("ArrowLeft")
    page.page.keyboard.press("ArrowLeft")
    at, *values = page.tip()
    assert at == "control steps (thousands): 40"
    assert values[:2] == ["this run: evaluation return", "400"]


def test_keyboard_opens_and_closes_run(opened, written):
    page = opened(written)
    button = row(page, NAMES[1]).locator("button")
    button.focus()
    page.page.keyboard.press("Enter")
    dialog = page.page.get_by_role("dialog", name=NAMES[1])
    expect(dialog).to_contain_text(NAMES[0])
    page.page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    expect(button).to_be_focused()
    # Tooltips of figures are shown again.
    assert page.point("curves", made.curves_figure(), 15_000, 500) != []
    expect(page.page.locator(".tip")).to_be_visible()


def test_button_or_click_outside_closes_run(opened, written):
    page = opened(written)
    dialog = open_run(page, NAMES[0])
    dialog.get_by_role("button", name="Close").click()
    expect(dialog).to_be_hidden()
    open_run(page, NAMES[0])
    page.page.mouse.click(2, 2)
    expect(dialog).to_be_hidden()


def test_link_opens_run_and_unknown_run_closes_it(opened, written):
    page = opened(written)
    dialog = open_run(page, NAMES[2])
    dialog.locator("select").select_option(NAMES[1])
    link = page.page.evaluate("location.href")
    page.page.keyboard.press("Escape")
    assert page.page.evaluate("location.hash") == ""
    other = opened(written)
    other.page.goto(link)
    other.page.reload()
    other.requests.clear()
    dialog = other.page.get_by_role("dialog", name=NAMES[2])
    expect(dialog.locator("select")).to_have_value(NAMES[1])
    other.page.evaluate("location.hash = '#view:run=unknown'")
    expect(dialog).to_be_hidden()


def test_settings_and_provenance_can_be_expanded(opened, written):
    page = opened(written)
    dialog = open_run(page, NAMES[1])
    dialog.get_by_text("All 4 settings").click()
    expect(dialog.get_by_role("cell", name="0.005")).to_have_count(1)
    dialog.get_by_text("Command, versions and machine").click()
    assert ["wall time (s)", "101.5"] in cells(dialog.locator("table").last)


def test_sorted_table_opens_same_run(opened, written):
    page = opened(written)
    page.page.locator("#to-provenance th", has_text="wall time").locator("button").dblclick()
    dialog = open_run(page, NAMES[2])
    expect(dialog.locator("h2")).to_have_text(NAMES[2])
    dialog.get_by_text("Command, versions and machine").click()
    assert ["wall time (s)", "102.5"] in cells(dialog.locator("table").last)


def test_filter_hides_runs(opened, written):
    page = opened(written)
    page.page.locator(".filters summary").click()
    page.page.locator(".filters").get_by_text("SAC", exact=True).click()
    expect(row(page, NAMES[1])).to_be_hidden()
    expect(row(page, NAMES[0])).to_be_visible()


def test_run_fits_on_phone(opened, written):
    page = opened(written, viewport=PHONE)
    dialog = open_run(page, NAMES[0])
    assert dialog.evaluate("(one) => one.scrollWidth <= one.clientWidth")
    box = dialog.locator("svg[role]").bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= PHONE["width"]


@pytest.fixture(scope="module")
def moved(tmp_path_factory):
    turned = FIRST._replace(target=np.array([np.nan, np.nan, np.pi]), episode_return=np.nan)
    runs = [
        detail(0, "a", curves(0), [FIRST, LAST]),
        detail(1, "a", curves(50)),
        detail(2, "a", [], [turned]),
    ]
    path = tmp_path_factory.mktemp("page") / "index.html"
    path.write_bytes(render_document(made.document(runs=runs)).encode())
    return path


def numbers(element, *names):
    return [float(element.get_attribute(name)) for name in names]


def test_paths_of_first_and_last_evaluation_are_drawn(opened, moved):
    page = opened(moved)
    dialog = open_run(page, NAMES[0])
    svg = dialog.get_by_role("img", name=f"Path of the robot of {NAMES[0]}")
    lines = svg.locator("g > path:not(.goal, .end)")
    scale, first, last = (lines.nth(i).get_attribute("d") for i in range(3))
    # x from 0 to 25 cm spans 280 pixels less 24 at each end; y from -5 to 5 cm points upwards.
    pixels = (280 - 2 * 24) / 0.25
    start = np.array([24, 140])
    read = [np.fromstring(d[1:].replace("L", " "), sep=" ").reshape(-1, 2) for d in (first, last)]
    assert read[0] == pytest.approx(start + pixels * np.array([[0, 0], [0, -0.05]]))
    assert read[1] == pytest.approx(start + pixels * np.array([[0, 0], [0.1, -0.02], [0.2, 0]]))
    assert numbers(svg.locator(".this circle.goal"), "cx", "cy") == pytest.approx(
        start + pixels * np.array([0.25, 0.05])
    )
    expect(svg.locator(".first .goal")).to_have_count(0)
    # The scale bar is the largest round length below a third of the drawing (10.06 cm).
    assert svg.locator("text").all_text_contents() == ["10 cm"]
    assert f"h{0.1 * pixels:g}" in scale
    ends = [svg.locator(f".{kind} .end").get_attribute("transform") for kind in ("first", "this")]
    turns = [float(end.rpartition("(")[2].rstrip(")")) for end in ends]
    assert turns == pytest.approx([-90, 0], abs=0.1)
    expect(dialog.locator(".paths figcaption")).to_have_text(
        "The robot seen from above, in the first episode of the evaluations after 20,000 control "
        "steps (thin line, return 12) and 60,000 control steps (return 612.3). A circle is the "
        "start; an arrowhead is the end and the robot's heading. A dashed circle is the target of "
        "the line with its color. A dashed line is the target's direction."
    )


@pytest.mark.parametrize(("page", "shown"), [("moved", True), ("written", False)])
def test_hint_mentions_path_if_one_is_recorded(opened, page, shown, request):
    section = opened(request.getfixturevalue(page)).page.locator("section")
    hint = section.get_by_text("Open a run to see")
    expect(hint).to_have_count(1)
    assert ("the path of its robot" in hint.inner_text()) is shown


def test_run_without_paths_has_no_path_drawing(opened, moved):
    dialog = open_run(opened(moved), NAMES[1])
    expect(dialog.locator("svg[role]")).to_have_count(1)
    expect(dialog.get_by_text("Path of the robot")).to_have_count(0)


def test_target_without_position_is_drawn_as_direction(opened, moved):
    dialog = open_run(opened(moved), NAMES[2])
    goal = dialog.locator(".paths .goal")
    expect(goal).to_have_count(1)
    numbers = [float(one) for one in re.split("[Ml ]", goal.get_attribute("d"))[1:]]
    # The line points left from the start at the lower edge and is a third of the drawing long.
    assert numbers == pytest.approx([140, 256, -280 / 3, 0], abs=0.1)
    expect(dialog.locator(".paths figcaption")).to_contain_text(
        "episode of the evaluation after 20,000 control steps. A circle"
    )


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_paths_fit_on_phone_and_have_contrast(opened, moved, scheme):
    page = opened(moved, viewport=PHONE, color_scheme=scheme)
    dialog = open_run(page, NAMES[0])
    assert dialog.evaluate("(one) => one.scrollWidth <= one.clientWidth")
    svg = dialog.locator(".paths svg")
    box = svg.bounding_box()
    assert box["width"] == pytest.approx(box["height"], abs=1)
    assert box["x"] + box["width"] <= PHONE["width"]
    stroke = "(one) => getComputedStyle(one).stroke"
    colors = [svg.locator(f".{kind} path").last.evaluate(stroke) for kind in ("first", "scale")]
    ink = svg.locator(".this path:not(.goal, .end)").evaluate(stroke)
    assert ink != colors[1]
    assert ink == dialog.evaluate("(one) => getComputedStyle(one).color")
