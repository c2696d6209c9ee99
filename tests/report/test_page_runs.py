"""The runs of a report's page, one by one, in a real browser."""

import numpy as np
import pytest
from playwright.sync_api import expect

from jbench.report.document import RunCurve, RunDetail
from jbench.report.page import render_document
from tests.report import page_documents as made
from tests.report.browser import PHONE

STEPS = np.array([20_000.0, 40_000, 60_000])
NAMES = made.provenance()["run"].tolist()


def detail(number, cell, curves=(), **changes):
    settings = {"algo": "td3", "seed": str(number), "tau": "0.005", **changes}
    tags = {"task": "face_direction", "algorithm": settings["algo"].upper(), "source": "ours"}
    return RunDetail(NAMES[number], ("ours", cell), settings, curves, tags)


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


def test_a_row_opens_its_run_beside_the_first_other_of_its_cell(opened, written):
    page = opened(written)
    row(page, NAMES[2]).locator("td").first.click()
    dialog = page.page.get_by_role("dialog", name=NAMES[2])
    expect(dialog.locator("select")).to_have_value(NAMES[0])
    expect(dialog.get_by_role("heading", name="Settings that differ: 2")).to_be_visible()
    assert cells(dialog.locator("table").first) == [["seed", "2", "0"], ["tau", "0.01", "0.005"]]


def test_another_run_can_be_chosen(opened, written):
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


def test_its_curve_is_drawn_and_read(opened, written):
    page = opened(written)
    dialog = open_run(page, NAMES[0])
    dialog.locator("select").select_option(NAMES[1])
    svg = dialog.locator("svg[role]")
    assert svg.locator("text").all_text_contents()[:4] == ["0", "10", "20", "30"]
    # Evaluations at 20, 40 and 60 thousand steps: thirds of the axis; a return of 500 is in the
    # middle of -15 to 1015.
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


def test_the_keyboard_opens_and_closes_it(opened, written):
    page = opened(written)
    button = row(page, NAMES[1]).locator("button")
    button.focus()
    page.page.keyboard.press("Enter")
    dialog = page.page.get_by_role("dialog", name=NAMES[1])
    expect(dialog).to_contain_text(NAMES[0])
    page.page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    expect(button).to_be_focused()
    # Values are shown beside figures again.
    assert page.point("curves", made.curves_figure(), 15_000, 500) != []
    expect(page.page.locator(".tip")).to_be_visible()


def test_a_button_and_a_click_beside_it_close_it(opened, written):
    page = opened(written)
    dialog = open_run(page, NAMES[0])
    dialog.get_by_role("button", name="Close").click()
    expect(dialog).to_be_hidden()
    open_run(page, NAMES[0])
    page.page.mouse.click(2, 2)
    expect(dialog).to_be_hidden()


def test_a_link_opens_the_run_and_back_closes_it(opened, written):
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


def test_settings_and_provenance_unfold(opened, written):
    page = opened(written)
    dialog = open_run(page, NAMES[1])
    dialog.get_by_text("All 4 settings").click()
    expect(dialog.get_by_role("cell", name="0.005")).to_have_count(1)
    dialog.get_by_text("Command, versions and machine").click()
    assert ["wall time (s)", "101.5"] in cells(dialog.locator("table").last)


def test_a_sorted_table_opens_the_same_run(opened, written):
    page = opened(written)
    page.page.locator("#to-provenance th", has_text="wall time").locator("button").dblclick()
    dialog = open_run(page, NAMES[2])
    expect(dialog.locator("h2")).to_have_text(NAMES[2])
    dialog.get_by_text("Command, versions and machine").click()
    assert ["wall time (s)", "102.5"] in cells(dialog.locator("table").last)


def test_the_filter_hides_runs(opened, written):
    page = opened(written)
    page.page.locator(".filters summary").click()
    page.page.locator(".filters").get_by_text("SAC", exact=True).click()
    expect(row(page, NAMES[1])).to_be_hidden()
    expect(row(page, NAMES[0])).to_be_visible()


def test_a_run_fits_on_a_phone(opened, written):
    page = opened(written, viewport=PHONE)
    dialog = open_run(page, NAMES[0])
    assert dialog.evaluate("(one) => one.scrollWidth <= one.clientWidth")
    box = dialog.locator("svg[role]").bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= PHONE["width"]
