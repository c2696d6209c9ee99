"""Tests of a report's page in a real browser: security, tables, figures, downloads, themes."""

import io
import re
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from playwright.sync_api import expect

from jbench.report.document import FigureItem, Section, TableItem, Value
from jbench.report.figure import Axis, Band, Panel, Series, Style
from jbench.report.page import colors, render_document
from tests.report import page_documents as made
from tests.report.browser import PHONE, BrowserPage

# matplotlib warns that its font has no control characters.
pytestmark = pytest.mark.filterwarnings("ignore:Glyph")

SLOW = pytest.mark.slow
EXACT = 5e-5
"""Relative tolerance: values under the pointer are shown with 5 digits."""


@pytest.fixture
def listener():
    """A local HTTP server that records the requested paths."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            self.server.asked.append(self.path)
            self.send_error(404)

        def log_message(self, *args):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.asked = []
    thread = Thread(target=server.serve_forever)
    thread.start()
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "index.html"
    path.write_bytes(render_document(made.document()).encode())
    return path


class TestSecurity:
    @pytest.mark.parametrize("guarded", [True, False])
    def test_security_policy_blocks_injected_content(
        self, chromium, written, tmp_path, listener, guarded
    ):
        here = f"http://127.0.0.1:{listener.server_port}"
        text = written.read_text().replace(
            "</main>",
            f'</main><script>window.hacked = 1</script><img src="{here}/a.png">'
            f'<b style="color: red" onclick="window.hacked = 1">b</b>'
            f'<iframe src="{here}/b"></iframe>',
        )
        if not guarded:  # without the policy the content is not blocked
            text = text.replace("Content-Security-Policy", "X-None")
        path = tmp_path / "index.html"
        path.write_text(text)
        page = BrowserPage(chromium, path)
        page.page.locator("b", has_text=re.compile("^b$")).click()
        if guarded:
            page.page.wait_for_function("window.violations.length >= 5")
        found = set(page.page.evaluate("window.violations"))
        policies = {"script-src-elem", "script-src-attr", "style-src-attr", "img-src", "frame-src"}
        assert found == (policies if guarded else set())
        assert page.page.evaluate("window.hacked") == (None if guarded else 1)
        assert sorted(listener.asked) == ([] if guarded else ["/a.png", "/b"])
        page.context.close()

    def test_hostile_names_are_shown_as_text(self, opened, tmp_path):
        path = tmp_path / "index.html"
        path.write_bytes(render_document(made.hostile_document()).encode())
        page = opened(path)
        expect(page.page.locator("h1")).to_contain_text(made.HOSTILE[0])
        expect(page.page.locator("figure")).to_have_count(len(made.HOSTILE))
        assert page.page.locator("figure h3").all_inner_texts()[:4] == list(made.HOSTILE[:4])
        for button in page.page.locator("thead button").all()[: len(made.HOSTILE)]:
            button.click()
        figures = page.page.locator("figure .drawing")
        for i in range(len(made.HOSTILE)):
            figures.nth(i).focus()
            page.page.keyboard.press("ArrowLeft")
            expect(page.page.locator(".tip .near span").nth(1)).not_to_be_empty()
        # Right-to-left controls are shown as escapes and do not reverse any text.
        assert "evil\\u202egnp.exe" in page.page.locator("h1").inner_text()


class TestTables:
    RETURNS = "final return: median [10th, 90th]"

    @pytest.mark.parametrize(
        ("heading", "rising"),
        [
            pytest.param("algorithm", ["ddpg", "PPO", "sac", "td3", "td10"], marks=SLOW),
            (RETURNS, ["-3 [-5, -1]", "99 [98, 100]", "668 [659, 676]", "1,000 [990, 1,000]", ""]),
            pytest.param("seeds", ["1", "2", "9", "10", "100"], marks=SLOW),
            pytest.param("published median", ["1e-05", "40", "963.2", "1,234,568", ""], marks=SLOW),
            ("verdict", ["contradicted", "supported", "undecided", "not tested", ""]),
        ],
    )
    def test_heading_sorts_ascending_descending_and_resets(self, opened, written, heading, rising):
        page = opened(written)
        before = page.column(heading)
        head = page.page.locator("#final-returns th", has_text=heading)
        expect(head).to_have_attribute("aria-sort", "none")
        head.locator("button").click()
        expect(head).to_have_attribute("aria-sort", "ascending")
        assert page.column(heading) == rising
        head.locator("button").click()
        expect(head).to_have_attribute("aria-sort", "descending")
        present = [text for text in rising if text]
        assert page.column(heading) == present[::-1] + [""] * rising.count("")
        head.locator("button").click()
        expect(head).to_have_attribute("aria-sort", "none")
        assert page.column(heading) == before

    def test_keyboard_sorts_one_column_at_a_time(self, opened, written):
        page = opened(written)
        headings = page.page.locator("#final-returns thead th")
        headings.nth(0).locator("button").focus()
        page.page.keyboard.press("Enter")
        page.page.keyboard.press("Tab")
        page.page.keyboard.press("Space")
        sorts = headings.evaluate_all("(all) => all.map((head) => head.ariaSort)")
        assert sorts == ["none", "ascending", "none", "none", "none"]
        assert page.column("algorithm") == ["sac", "td10", "td3", "ddpg", "PPO"]

    def test_sorting_keeps_rows_together(self, opened, written):
        page = opened(written)
        page.page.locator("#final-returns th", has_text="seeds").locator("button").click()
        row = page.page.locator("#final-returns tbody tr").nth(3).locator("th, td")
        assert row.all_inner_texts() == ["td3", "668 [659, 676]", "10", "963.2", "supported"]
        expect(row.nth(1)).to_have_class("number best")


class TestFigures:
    @pytest.mark.parametrize("row", [11, *(pytest.param(row, marks=SLOW) for row in (0, 29))])
    def test_tooltip_shows_values_at_pointer(self, opened, written, row):
        page = opened(written)
        figure = made.curves_figure()
        data = made.CURVES.iloc[row]
        shown = page.point("curves", figure, data.control_steps, data.td3 + 20)
        title, where, *values = shown
        assert (title, where) == (
            "face_direction", f"control steps (thousands): {data.control_steps / 1000:g}"
        )  # fmt: skip
        shown = dict(zip(values[::2], values[1::2], strict=True))
        assert set(shown) == {"TD3 (10 seeds)", "DDPG (10 seeds)"}
        numbers = [float(text) for text in re.findall(r"[\d.]+", shown["TD3 (10 seeds)"])]
        assert numbers == pytest.approx([data.td3, data.td3_low, data.td3_high], rel=EXACT)
        assert float(shown["DDPG (10 seeds)"]) == pytest.approx(data.ddpg, rel=EXACT)
        near = page.page.locator(".tip .near span").nth(1)
        expect(near).to_have_text("TD3 (10 seeds)")

    def test_tooltip_is_hidden_outside_panel(self, opened, written):
        page = opened(written)
        figure = made.curves_figure()
        assert page.point("curves", figure, 15_000, 500) != []
        assert page.point("curves", figure, 15_000, 1080) == []
        expect(page.page.locator(".tip")).to_be_hidden()
        expect(page.page.locator(".mark")).to_have_count(0)

    def test_tooltip_on_logarithmic_axis(self, opened, written):
        page = opened(written)
        figure = made.log_figure()
        tip = page.point("errors", figure, 7.9, 0.011, panel=1)
        assert tip == ["latents: 8", "pca", "0.01"]

    def test_tooltip_shows_cells_of_heat_map(self, opened, written):
        page = opened(written)
        figure = made.matrix_figure()
        for (row, column), value in np.ndenumerate(made.MATRIX):
            tip = page.point("matrix", figure, column + 0.3, row - 0.3)
            names = [made.ALGORITHMS[column], made.TASKS[row], f"final return: {value:g}"]
            assert tip == (names if np.isfinite(value) else [])

    def test_arrow_keys_move_through_values(self, opened, written):
        page = opened(written)
        page.page.locator("#curves .drawing").focus()
        page.page.keyboard.press("ArrowLeft")
        assert page.tip()[1] == "control steps (thousands): 29"
        page.page.keyboard.press("ArrowRight")
        assert page.tip()[1] == "control steps (thousands): 30"
        page.page.keyboard.press("Escape")
        expect(page.page.locator(".tip")).to_be_hidden()
        page.page.locator("#matrix .drawing").focus()
        page.page.keyboard.press("ArrowRight")
        assert page.tip() == ["TD3", "face_direction", "final return: 12.5"]

    def test_tooltip_stays_inside_window(self, opened, written):
        page = opened(written, viewport=PHONE)
        page.page.locator("#curves .drawing").focus()
        for _ in range(35):
            page.page.keyboard.press("ArrowLeft")
            box = page.page.locator(".tip").bounding_box()
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= PHONE["width"]

    def test_tooltip_does_not_cover_panel_on_phone(self, opened, written):
        page = opened(written, viewport=PHONE)
        page.point("curves", made.curves_figure(), 15_000, 500)
        panel = page.page.locator("#curves svg[role]").bounding_box()
        tip = page.page.locator(".tip").bounding_box()
        below = tip["y"] >= panel["y"] + panel["height"] - 1
        assert below or tip["y"] + tip["height"] <= panel["y"] + 1


class TestDownload:
    @pytest.mark.parametrize("scripts", [True, False])
    def test_data_of_figure_can_be_downloaded(self, opened, written, tmp_path, scripts, chromium):
        # Without scripts, `assert_quiet` can't be evaluated.
        page = (
            opened(written)
            if scripts
            else BrowserPage(chromium, written, java_script_enabled=False)
        )
        with page.page.expect_download() as download:
            page.page.locator("#curves .download").click()
        assert download.value.suggested_filename == "curves.csv"
        download.value.save_as(tmp_path / "curves.csv")
        pd.testing.assert_frame_equal(
            pd.read_csv(tmp_path / "curves.csv"), made.CURVES, check_dtype=False, rtol=1e-9
        )
        if not scripts:
            page.context.close()

    @pytest.mark.parametrize("scripts", [True, False])
    def test_large_data_are_decompressed_if_scripts_run(self, chromium, tmp_path, scripts):
        frame = pd.DataFrame({"name": ["é, 🦾"] * 20_000, "x": np.linspace(0, 1, 20_000)})
        item = FigureItem("large", "Large", made.curves_figure(), frame)
        path = tmp_path / "index.html"
        section = Section("S", [], [item])
        path.write_bytes(render_document(made.document(sections=[section])).encode())
        page = BrowserPage(chromium, path, java_script_enabled=scripts)
        with page.page.expect_download() as download:
            page.page.locator("#large .download").click()
        assert download.value.suggested_filename == ("large.csv" if scripts else "large.csv.gz")
        download.value.save_as(tmp_path / download.value.suggested_filename)
        saved = pd.read_csv(tmp_path / download.value.suggested_filename)
        pd.testing.assert_frame_equal(saved, frame, check_dtype=False, rtol=1e-8)
        assert page.trouble == []
        page.context.close()

    def test_every_table_can_be_downloaded(self, opened, written, tmp_path):
        page = opened(written)
        names = page.page.locator(".download").evaluate_all("(all) => all.map((a) => a.download)")
        assert names == ["final_returns.csv", "curves.csv", "provenance.csv"]
        with page.page.expect_download() as download:
            page.page.locator("#to-provenance .download").click()
        download.value.save_as(tmp_path / "provenance.csv")
        pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "provenance.csv"), made.provenance())


def _contrast(one, other):
    return colors._contrast(one, other)


class TestAppearance:
    def test_text_has_contrast_in_light_and_dark_theme(self, opened, written):
        papers = []
        for scheme in ("light", "dark"):
            page = opened(written, color_scheme=scheme)
            paper = page.color(".item", "backgroundColor")
            papers.append(paper)
            for selector in ("p", "h1", ".soft", ".made", "td", "thead button", ".best strong"):
                assert _contrast(page.color(selector, "color"), paper) >= 4.5, (scheme, selector)
            # The background of a figure is that of its item.
            ground = page.color("#curves .drawing [fill='#ffffff']", "fill")
            assert ground == paper
            assert _contrast(page.color("#curves .drawing svg", "fill"), ground) >= 4.5
            for line in page.page.locator(
                "#curves .drawing g[clip-path], #curves .drawing path"
            ).all():
                stroke = line.get_attribute("stroke")
                if stroke in ("#0072b2", "#d00000"):
                    shown = line.evaluate("(element) => getComputedStyle(element).stroke")
                    rgb = tuple(int(part) for part in re.findall(r"\d+", shown)[:3])
                    assert _contrast(rgb, ground) >= 3
            # Numbers in a heat map are not themed, because its colors are not.
            assert page.color("#matrix [fill='rgb(26,26,26)']", "fill") == (26, 26, 26)
        assert papers == [(255, 255, 255), colors.PAPER]

    @pytest.mark.parametrize("figure", ["curves", "errors"])
    def test_no_pixel_of_dark_figure_is_darker_than_background(self, opened, written, figure):
        page = opened(written, color_scheme="dark")
        picture = page.page.locator(f"#{figure} .drawing").first.screenshot()
        pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=int)
        ground = np.array(colors.PAPER)
        assert (pixels == ground).all(axis=2).mean() > 0.5
        assert pixels.max(axis=2).min() >= ground.min()

    def test_button_toggles_theme(self, opened, written):
        page = opened(written)
        for paper in (colors.PAPER, (255, 255, 255)):
            page.page.locator("button.theme").click()
            assert page.color(".item", "backgroundColor") == paper

    def test_page_fits_width_of_phone(self, opened, written, tmp_path):
        hostile = tmp_path / "hostile.html"
        hostile.write_bytes(render_document(made.hostile_document()).encode())
        for path in (written, hostile):
            page = opened(path, viewport=PHONE)
            width = page.page.evaluate("document.documentElement.scrollWidth")
            assert width == PHONE["width"]
            wide = page.page.locator(".scroll").evaluate_all(
                "(all) => all.filter((box) => box.scrollWidth > box.clientWidth).length"
            )
            assert wide > 0

    def test_figures_fit_or_scroll_on_phone(self, opened, written):
        page = opened(written, viewport=PHONE)
        for box in page.page.locator(".drawing").all():
            figure = box.locator("xpath=ancestor::figure")
            fits = box.evaluate("(one) => one.scrollWidth <= one.clientWidth")
            assert fits or "scrolls" in figure.get_attribute("class").split()

    def test_print_shows_all_content_in_light_theme(self, opened, written):
        page = opened(written, color_scheme="dark")
        page.page.locator("button.theme").click()
        page.page.locator("button.theme").click()
        page.page.emulate_media(media="print")
        hidden = page.page.locator(".scroll, .long").evaluate_all(
            "(all) => all.filter((box) => box.scrollHeight > box.clientHeight + 1"
            " && getComputedStyle(box).overflowY !== 'visible').length"
        )
        assert hidden == 0
        expect(page.page.locator("nav")).to_be_hidden()
        for name in ("figure", "table", "h2", "figcaption", ".problems", ".notes", ".made"):
            for element in page.page.locator(name).all():
                expect(element).to_be_visible()
        assert page.color(".item", "backgroundColor") == (255, 255, 255)
        assert _contrast(page.color("main p", "color"), (255, 255, 255)) >= 7

    def test_printed_table_has_title_and_fits_page(self, opened, tmp_path):
        heading = "control steps to half the published best: median, number {}"
        frame = pd.DataFrame([[f"{i} of 10" for i in range(10)]])
        frame = frame.map(lambda text: Value(text, float(text[0])))
        frame.columns = [heading.format(i) for i in range(10)]
        item = TableItem("speed", "Control steps to a return", "", frame, folded=True)
        path = tmp_path / "index.html"
        sections = [Section("S", [], [item])]
        path.write_text(render_document(made.document(sections=sections)))
        landscape = round((297 - 2 * 12) / 25.4 * 96)  # pixels of A4 without margins
        page = opened(path, viewport={"width": landscape, "height": 700})
        page.page.emulate_media(media="print")
        expect(page.page.get_by_role("heading", name=item.title)).to_be_visible()
        box = page.page.locator("#speed table").bounding_box()
        assert box["x"] + box["width"] <= landscape

    def test_page_prints_on_a4(self, opened, written):
        page = opened(written)
        printed = page.page.pdf(prefer_css_page_size=True)
        assert printed.startswith(b"%PDF-")
        # A4 portrait, and landscape for wide tables and figures.
        sizes = set(re.findall(rb"/MediaBox ?\[0 0 ([\d.]+) ([\d.]+)\]", printed))
        assert {(round(float(w)), round(float(h))) for w, h in sizes} == {(595, 842), (842, 595)}

    def test_page_without_scripts_is_plain_document(self, chromium, written):
        page = BrowserPage(chromium, written, java_script_enabled=False)
        for text in ("No task is solved.", "668 [659, 676]", "Across seeds.", "jbench report"):
            expect(page.page.get_by_text(text).first).to_be_visible()
        expect(page.page.locator("button")).to_have_count(0)
        expect(page.page.locator(".drawing svg[role]")).to_have_count(4)
        page.context.close()


@pytest.mark.parametrize(("figures", "size"), [(1, 5e6), pytest.param(5, 10e6, marks=SLOW)])
def test_page_of_200_long_runs_is_small_and_works(opened, tmp_path, figures, size):
    # Each figure has 20 cells of 10 seeds and 5000 episodes, thinned as for drawing.
    rng = np.random.default_rng(0)
    steps = np.arange(1, 4902, 8) * 1000.0
    items = []
    for i in range(figures):
        series = []
        for j in range(20):
            y = rng.normal(500, 100, len(steps))
            series.append(
                Series(steps, y, Style(f"C{j % 10}"), f"cell {j}", [Band(y - 50, y + 50)])
            )
        returns = Axis("episode return", (-15, 1015))
        figure = made.curves_figure(
            Panel("face_direction", Axis("control steps", (0, steps[-1])), returns, series)
        )
        data = pd.DataFrame(rng.uniform(0, 1000, (20 * 4901, 8)), columns=list("abcdefgh"))
        items.append(FigureItem(f"figure{i}", "Curves", figure, data))
    runs = made.provenance(200)
    sections = [Section("All", [], [*items, TableItem("runs", "Runs", "", runs)])]
    path = tmp_path / "index.html"
    path.write_bytes(render_document(made.document(sections=sections, provenance=runs)).encode())
    assert path.stat().st_size < size
    page = opened(path)
    tip = page.point(f"figure{figures - 1}", figure, 2.5e6, 500)
    # 13 of 20 lines are shown; the others are counted.
    assert tip[0] == "face_direction"
    assert tip[-1] in ("and 6 more", "and 7 more")
    page.page.locator("#runs th", has_text="wall time").locator("button").dblclick()
    assert page.column("wall time (s)", "#runs table")[:2] == ["299.5", "298.5"]
