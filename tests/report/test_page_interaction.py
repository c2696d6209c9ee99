"""Tests of interactions with a report's page in a real browser: legends, filters, links, saving."""

from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import expect

from jbench.report.analysis.statistics import Estimate
from jbench.report.data.cells import IMPORTED, OURS
from jbench.report.data.published import PUBLISHED
from jbench.report.data.returns import KINDS
from jbench.report.document import FigureItem, Section, TableItem
from jbench.report.figure import Axis, Figure, Panel, Series, Style
from jbench.report.leaderboard import Entry
from jbench.report.leaderboard import table as leaderboard_table
from jbench.report.page import render_document
from tests.report import page_documents as made
from tests.report.browser import DESKTOP, PHONE

COLORS = {"SAC": "#009e73", "TD3": "#cc79a7"}


def tagged_figure():
    """Returns two panels with a line of SAC and one of TD3 each."""
    x = np.array([0.0, 500, 1000])

    def line(task, algorithm, height):
        source = IMPORTED if (task, algorithm) == ("face_direction", "TD3") else "ours"
        tags = {"task": task, "algorithm": algorithm, "representation": "full", "source": source}
        more = {"entries": (algorithm, "median"), "tags": tags, "detail": "6 seeds"}
        return Series(x, x * height, Style(COLORS[algorithm]), algorithm, **more)

    panels = [
        Panel(
            task,
            Axis("control steps", (0, 1000)),
            Axis("return", (0, 1000)),
            [line(task, "SAC", 0.9), line(task, "TD3", 0.5)],
        )
        for task in ("face_direction", "move_to_pose")
    ]
    return Figure("Curves", panels, [("median", Style("#404040"))], ["Two tasks."])


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    frame = pd.DataFrame(
        {
            "task": ["face_direction", "face_direction", "move_to_pose"],
            "algorithm": ["SAC", "TD3", "TD3"],
            "observation": ["full", "full, bfloat16", "full"],
            "runs": ["ours", IMPORTED, "ours"],
            "median": [900, 500, 300],
        }
    )
    section = Section("All", [], [TableItem("returns", "Returns", "By algorithm.", frame)])
    document = made.document(
        sections=[section],
        headline="SAC solves face_direction.",
        overview=[FigureItem("tagged", "Curves", tagged_figure())],
        inventory=[("3", "runs"), ("1", "task")],
    )
    path = tmp_path_factory.mktemp("page") / "index.html"
    path.write_bytes(render_document(document).encode())
    return path


def entry(page, name):
    return page.page.locator("#tagged .legend button", has_text=name)


def lines(page):
    """Returns algorithm and task of the visible lines."""
    shown = page.page.locator("#tagged [data-of]:not(.gone)")
    pairs = shown.evaluate_all(
        "(all) => all.filter((one) => one.checkVisibility())"
        ".map((one) => [one.dataset.algorithm, one.dataset.task])"
    )
    return {tuple(pair) for pair in pairs}


def rows(page):
    texts = page.page.locator("#returns tbody tr").all()
    return [row.locator("td").first.inner_text() for row in texts if row.is_visible()]


def choose(page, name):
    page.page.locator(".filters summary").click()
    page.page.locator(".filters label", has_text=name).locator("input").click()


class TestLegend:
    def test_legend_entry_toggles_its_lines_in_every_panel(self, opened, written):
        page = opened(written)
        assert len(lines(page)) == 4
        entry(page, "SAC").click()
        expect(entry(page, "SAC")).to_have_attribute("aria-pressed", "false")
        assert lines(page) == {("TD3", "face_direction"), ("TD3", "move_to_pose")}
        entry(page, "SAC").press("Enter")
        assert len(lines(page)) == 4

    def test_hidden_line_is_not_in_tooltip(self, opened, written):
        page = opened(written)
        entry(page, "SAC").click()
        page.page.locator("#tagged .drawing").focus()
        page.page.keyboard.press("ArrowLeft")
        assert page.tip() == ["face_direction", "control steps: 1,000", "TD3 (6 seeds)", "500"]

    def test_hidden_line_stays_hidden_in_zoomed_panel(self, opened, written):
        page = opened(written)
        state = "#view:in+tagged=SAC&zoom+tagged+1=200+600"
        page.page.evaluate(f"location.hash = {state!r}")
        ticks = page.page.locator("#tagged .ticks text")
        expect(ticks).to_have_text(["200", "300", "400", "500", "600"])
        assert lines(page) == {("TD3", "face_direction"), ("TD3", "move_to_pose")}
        choose(page, "move_to_pose")
        assert lines(page) == {("TD3", "face_direction")}
        assert "zoom+tagged+1=200+600" in page.page.evaluate("location.hash")

    def test_focus_on_entry_fades_other_lines(self, opened, written):
        page = opened(written)
        entry(page, "TD3").focus()
        faint = page.page.locator("#tagged .faint")
        assert set(faint.evaluate_all("(all) => all.map((one) => one.dataset.algorithm)")) == {
            "SAC"
        }
        entry(page, "TD3").blur()
        expect(faint).to_have_count(0)


class TestFilters:
    def test_filter_applies_to_figures_and_tables(self, opened, written):
        page = opened(written)
        choose(page, "TD3")
        assert lines(page) == {("SAC", "face_direction"), ("SAC", "move_to_pose")}
        assert rows(page) == ["SAC"]
        expect(page.page.locator(".filters summary")).to_have_text("Filter (1 hidden)")

    def test_legend_lists_only_visible_lines(self, opened, written):
        page = opened(written)
        legend = page.page.locator("#tagged .legend")
        choose(page, "TD3")
        assert legend.inner_text().split() == ["SAC", "median"]
        page.page.locator(".filters label", has_text="TD3").locator("input").click()
        assert legend.inner_text().split() == ["SAC", "TD3", "median"]

    def test_link_with_values_that_report_lacks_hides_nothing(self, opened, written):
        page = opened(written)
        page.page.evaluate("location.hash = '#view:task=nope&source=nope&algorithm=TD3'")
        expect(page.page.locator(".filters summary")).to_have_text("Filter (1 hidden)")
        assert lines(page) == {("SAC", "face_direction"), ("SAC", "move_to_pose")}

    def test_link_to_section_keeps_state_in_address(self, opened, written):
        page = opened(written)
        link = page.page.locator("nav a[href^='#']").last
        link.click()
        assert page.page.evaluate("location.hash") == link.get_attribute("href")
        choose(page, "TD3")
        state = page.page.evaluate("location.hash")
        link.click()
        expect(page.page.locator(link.get_attribute("href"))).to_be_in_viewport()
        page.page.wait_for_function(f"location.hash === {state!r}")
        assert lines(page) == {("SAC", "face_direction"), ("SAC", "move_to_pose")}

    def test_filter_fits_on_phone(self, opened, written):
        page = opened(written, viewport=PHONE)
        page.page.locator(".filters summary").click()
        box = page.page.locator(".filters form").bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= PHONE["width"]

    def test_panel_of_hidden_task_is_hidden(self, opened, written):
        page = opened(written)
        choose(page, "move_to_pose")
        assert lines(page) == {("SAC", "face_direction"), ("TD3", "face_direction")}
        expect(page.page.locator("#tagged svg[role]").nth(1)).to_be_hidden()

    def test_common_properties_have_no_filter(self, opened, written):
        page = opened(written)
        names = page.page.locator(".filters legend").all_text_contents()
        assert names == ["task", "algorithm", "source"]

    def test_source_has_one_checkbox_for_figures_and_tables(self, opened, written):
        page = opened(written)
        boxes = page.page.locator(".filters input[name=source]")
        assert boxes.evaluate_all("(all) => all.map((box) => box.value)") == [IMPORTED, "ours"]
        choose(page, IMPORTED)
        assert ("TD3", "face_direction") not in lines(page)
        assert len(lines(page)) == 3
        assert rows(page) == ["SAC", "TD3"]

    def test_link_restores_filter_and_hidden_lines(self, opened, written):
        page = opened(written)
        choose(page, "move_to_pose")
        page.page.keyboard.press("Escape")
        entry(page, "SAC").click()
        link = page.page.evaluate("location.hash")
        other = opened(written)
        other.page.goto(written.as_uri() + link)
        other.page.reload()
        other.requests.clear()
        assert lines(other) == {("TD3", "face_direction")}
        assert rows(other) == ["SAC", "TD3"]

    def test_escape_closes_filter_and_returns_focus(self, opened, written):
        page = opened(written)
        choose(page, "TD3")
        page.page.keyboard.press("Escape")
        expect(page.page.locator(".filters form")).to_be_hidden()
        expect(page.page.locator(".filters summary")).to_be_focused()

    def test_arrow_keys_skip_hidden_panels(self, opened, written):
        page = opened(written)
        choose(page, "face_direction")
        page.page.locator("#tagged .drawing").focus()
        for key in ("ArrowLeft", "ArrowDown", "ArrowUp"):
            page.page.keyboard.press(key)
            assert page.tip()[0] == "move_to_pose", key

    def test_figure_without_visible_panel_is_not_saved(self, opened, written):
        page = opened(written)
        button = page.page.get_by_role("button", name="Save PNG")
        expect(button).to_be_visible()
        choose(page, "face_direction")
        expect(button).to_be_visible()
        page.page.locator(".filters label", has_text="move_to_pose").locator("input").click()
        expect(button).to_be_hidden()

    def test_entries_of_leaderboard_have_sources(self, opened, tmp_path):
        median = Estimate(900.0, 800.0, 950.0, 30.0)
        ranked = [Entry(one, "move_to_pose", "td3", "full", median, 6) for one in (OURS, PUBLISHED)]
        board = leaderboard_table(ranked, KINDS["evaluation"])
        path = tmp_path / "index.html"
        section = Section("All", [], [board])
        path.write_text(render_document(made.document(sections=[section])))
        page = opened(path)
        choose(page, PUBLISHED)
        entries = page.page.locator("#leaderboard tbody tr:visible td:nth-child(3)")
        assert entries.all_inner_texts() == ["runs"]


class TestSaving:
    def test_saved_svg_has_visible_lines_and_legend(self, opened, written, tmp_path):
        page = opened(written, color_scheme="dark")
        entry(page, "SAC").click()
        with page.page.expect_download() as download:
            page.page.get_by_role("button", name="Save SVG").click()
        assert download.value.suggested_filename == "tagged.svg"
        download.value.save_as(tmp_path / "tagged.svg")
        root = ElementTree.parse(tmp_path / "tagged.svg").getroot()
        strokes = {one.get("stroke") for one in root.iter()}
        assert COLORS["TD3"] in strokes
        assert COLORS["SAC"] not in strokes
        texts = [one.text for one in root.iter("{http://www.w3.org/2000/svg}text")]
        assert texts == ["TD3", "median"]

    @pytest.mark.parametrize(("viewport", "rows"), [(DESKTOP, 1), (PHONE, 2)])
    def test_saved_figure_has_rows_of_panels_as_page(
        self, opened, written, tmp_path, viewport, rows
    ):
        page = opened(written, viewport=viewport)
        with page.page.expect_download() as download:
            page.page.get_by_role("button", name="Save SVG").click()
        download.value.save_as(tmp_path / "tagged.svg")
        root = ElementTree.parse(tmp_path / "tagged.svg").getroot()
        panels = root.findall("{http://www.w3.org/2000/svg}svg[@role]")
        assert [one.get("aria-label") for one in panels] == [
            "Curves: face_direction", "Curves: move_to_pose"
        ]  # fmt: skip
        assert root.get("aria-label") is None
        first, second = ({name: float(one.get(name)) for name in ("x", "y", "width", "height")}
                         for one in panels)  # fmt: skip
        beside = (first["width"], 0) if rows == 1 else (0, first["height"])
        assert (second["x"], second["y"]) == pytest.approx(beside, abs=0.01)
        widths = [first["width"], second["width"]]
        right = float(root.get("viewBox").split()[2])
        assert right == pytest.approx(sum(widths) if rows == 1 else max(widths), abs=0.01)

    def test_saved_png_has_288_dpi(self, opened, written, tmp_path):
        page = opened(written)
        with page.page.expect_download() as download:
            page.page.get_by_role("button", name="Save PNG").click()
        download.value.save_as(tmp_path / "tagged.png")
        content = (tmp_path / "tagged.png").read_bytes()
        assert content.startswith(b"\x89PNG")
        width = int.from_bytes(content[16:20])
        boxes = "(all) => all.reduce((sum, one) => sum + one.viewBox.baseVal.width, 0)"
        points = page.page.locator("#tagged svg[role]").evaluate_all(boxes)
        assert width == pytest.approx(4 * points, abs=1)


class TestFirstScreen:
    def test_headline_and_figure_are_on_first_screen(self, opened, written):
        page = opened(written, viewport={"width": 1280, "height": 800})
        expect(page.page.locator(".headline")).to_be_in_viewport()
        box = page.page.locator("#tagged .drawing").bounding_box()
        assert box["y"] + box["height"] <= 800
        assert page.page.locator(".inventory div").all_inner_texts() == ["runs\n3", "task\n1"]

    def test_numbers_in_parentheses_are_fainter_than_words(self, opened, tmp_path):
        headline = "12 numbers (dae12) lower the return (-332 [-491, -214]; 6 seeds)."
        (tmp_path / "index.html").write_text(render_document(made.document(headline=headline)))
        asides = opened(tmp_path / "index.html").page.locator(".headline span")
        assert asides.all_inner_texts() == ["(-332 [-491, -214]; 6 seeds)"]
        soft, plain = (
            one.evaluate("(one) => getComputedStyle(one).color")
            for one in (asides, asides.locator(".."))
        )
        assert soft != plain

    def test_panels_are_stacked_on_phone(self, opened, written):
        page = opened(written, viewport=PHONE)
        panels = page.page.locator("#tagged svg[role]")
        first, second = (panels.nth(i).bounding_box() for i in range(2))
        assert second["y"] >= first["y"] + first["height"]
        for box in (first, second):
            assert box["x"] + box["width"] <= PHONE["width"]

    def test_first_column_of_table_is_sticky_on_phone(self, opened, written):
        page = opened(written, viewport=PHONE)
        box = page.page.locator("#returns .scroll")
        box.evaluate("(one) => { one.scrollLeft = 200; }")
        name = page.page.locator("#returns tbody th").first.bounding_box()
        assert name["x"] == pytest.approx(box.bounding_box()["x"], abs=2)
