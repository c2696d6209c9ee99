"""Tests of the HTML of a report's page, without a browser: elements, policy, values, downloads."""

import base64
import gzip
import hashlib
import io
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest

from jbench.report.document import FigureItem, Section, TableItem, Value
from jbench.report.figure import Axis, Band, Figure, HeatMap, Panel, Series, Style
from jbench.report.page import (
    colors,
    downloads,
    legends,
    render_document,
    tables,
    text,
    tooltips,
    vector,
)
from jbench.report.page.items import share_each
from tests.report import page_documents as made

# matplotlib warns that its font has no control characters.
pytestmark = pytest.mark.filterwarnings("ignore:Glyph")


class Page(HTMLParser):
    """The elements of a page with their attributes, and the text of scripts and styles."""

    def __init__(self, page):
        super().__init__()
        self.elements, self.open, self.scripts, self.styles, self.text = [], [], [], [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in ("meta", "link"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        kept = {"script": self.scripts, "style": self.styles}
        kept.get(self.open[-1] if self.open else "", self.text).append(data)

    def values_of(self, name):
        return [attrs[name] for _, attrs in self.elements if name in attrs]


@pytest.fixture(scope="module")
def rendered():
    return render_document(made.document())


@pytest.fixture(scope="module")
def page(rendered):
    return Page(rendered)


class TestPage:
    def test_page_is_reproducible_byte_for_byte(self, rendered):
        assert render_document(made.document()) == rendered

    def test_elements_are_closed_and_ids_are_unique(self, page):
        assert page.open == []
        ids = page.values_of("id")
        assert len(ids) == len(set(ids))
        links = [link for link in page.values_of("href") if link.startswith("#")]
        assert links
        assert {link[1:] for link in links} <= set(ids)
        clips = page.values_of("clip-path")
        assert clips
        assert {link.removeprefix("url(#").removesuffix(")") for link in clips} <= set(ids)

    def test_summary_is_first_and_provenance_last(self, rendered):
        order = ["<h1>", "No task is solved.", "The run a/b can", ">Final returns</h2>",
                 ">Curves</h2>", "Only 2 seeds", ">Runs</h2>"]  # fmt: skip
        positions = [rendered.index(part) for part in order]
        assert positions == sorted(positions)

    def test_security_policy_permits_only_own_style_and_script(self, page):
        (policy,) = [
            attrs["content"]
            for tag, attrs in page.elements
            if attrs.get("http-equiv") == "Content-Security-Policy"
        ]
        (style,), script = page.styles, page.scripts[-1]
        hashes = [
            base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
            for content in (style, script)
        ]
        assert policy.split("; ") == [
            "default-src 'none'",
            f"style-src 'sha256-{hashes[0]}'",
            f"script-src 'sha256-{hashes[1]}'",
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
        ]

    def test_page_loads_no_external_resource(self, page, rendered):
        assert not re.search(r"https?://|//[a-z]|@import", rendered.partition("<body>")[2])
        assert set(page.values_of("src")) == set()
        assert {link[:5] for link in page.values_of("href")} <= {"data:", *("#" + i[:4] for i in page.values_of("id"))}  # fmt: skip # noqa: E501
        assert "style" not in {name for _, attrs in page.elements for name in attrs}

    def test_command_is_shown_once(self, page):
        assert page.text.count("jbench report --window 5 --results 'my results'") == 1

    def test_contents_list_every_section_in_order(self, page):
        sections = [dict(attributes)["id"] for tag, attributes in page.elements if tag == "section"]
        assert sections[1] == "to-problems"
        links = [link for link in page.values_of("href") if link.startswith("#to-")]
        assert links == [f"#{id}" for id in sections]

    def test_items_with_same_name_have_different_ids(self):
        item = TableItem("same", "Same", "", pd.DataFrame({"a": [1]}))
        page = Page(render_document(made.document(sections=[Section("Same", [], [item, item])])))
        assert [i for i in page.values_of("id") if i.startswith("same")] == ["same", "same-2"]

    def test_names_never_collide_with_ids_of_page_parts(self):
        frame = pd.DataFrame({"a": [1]})
        names = ("Summary", "Problems", "Notes", "to-summary", "to provenance", "?")
        sections = [Section(n, [], [TableItem(n, n, "", frame)]) for n in names]
        ids = Page(render_document(made.document(sections=sections))).values_of("id")
        assert len(ids) == len(set(ids))

    def test_empty_document_is_valid_page(self):
        empty = made.document(
            summary=[], problems=[], notes=[], sections=[], provenance=pd.DataFrame()
        )
        page = Page(render_document(empty))
        assert page.open == []
        assert "There are no runs." in page.text
        assert "Notes" not in page.text


class TestHostile:
    def test_hostile_names_are_escaped(self):
        page = Page(render_document(made.hostile_document()))
        assert page.open == []
        assert [tag for tag, _ in page.elements if tag in ("img", "b")] == []
        assert [name for _, attrs in page.elements for name in attrs if name.startswith("on")] == []
        # The page's own script and one script of values per figure.
        assert len(page.scripts) == 1 + len(made.HOSTILE)
        for name in made.HOSTILE:
            assert text.plain(name) in page.text

    def test_page_has_no_control_characters(self):
        written = render_document(made.hostile_document()).encode().decode()
        assert not re.search("[\x00-\x08\x0b-\x1f\u202a-\u202e\u2066-\u2069]", written)
        assert "evil\\u202egnp.exe\\u2066\\u0000\\u001b[31m\\ud800" in written

    @pytest.mark.parametrize(
        ("given", "shown"),
        [
            ("a\nb\tc", "a\nb\tc"),
            ("\u202e", "\\u202e"),
            ("<\x07>", "&lt;\\u0007&gt;"),
            ("\"'&", "&quot;&#x27;&amp;"),
            ("שלום é 🦾", "שלום é 🦾"),
        ],
    )
    def test_control_characters_are_shown_as_escapes(self, given, shown):
        assert text.html(given) == shown

    def test_json_cannot_close_its_element(self):
        assert text.json_block(["</script>", "<!--"]) == '["\\u003c/script>","\\u003c!--"]'


class TestDrawing:
    def test_drawing_has_attributes_instead_of_styles_and_exact_coordinates(self):
        drawing = vector.element(made.curves_figure(), "a-", "Title")
        assert "style" not in drawing.svg
        assert "<!--" not in drawing.svg
        # A panel of 4.9 - 0.68 - 0.16 - 0.06 = 4 by 2.5 inches, 0.76 from the left, with 0.24 for
        # tick labels and 0.15 for the axis label below it, and 0.3 for its title above it.
        assert drawing.svg.startswith('<svg role="img" aria-label="Title" width="352.8pt"')
        assert 'viewBox="0 0 352.8 ' in drawing.svg
        (box,) = drawing.boxes
        assert box == pytest.approx((54.72, 21.6, 342.72, 201.6))
        for color in ("#cc79a7", "#0072b2", "#d00000", "#ffffff"):
            assert color in drawing.colors
        # The line of td3 begins at 1000 steps and a return of 20.25, here in points:
        # 54.72 + 288 / 30, and 201.6 - (20.25 + 15) / 1030 * 180 = 195.44.
        assert "M 64.3 195.4 " in drawing.svg

    def test_panels_are_numbered_despite_second_scale(self):
        panel = made.curves_panel()
        second = replace(panel, x=replace(panel.x, opposite=("episodes", 0.001)))
        svg = vector.element(made.curves_figure(second, panel), "a-", "").svg
        assert re.findall(r'data-panel="(\d)"', svg) == ["0", "1"]
        assert svg.count('<svg role="img"') == 2
        first, other = (
            len(re.findall('data-tick="x"', part)) for part in svg.split("<svg role")[1:]
        )
        assert first == 2 * other > 0

    def test_drawing_is_reproducible(self):
        for figure in (made.curves_figure(), made.matrix_figure()):
            assert vector.element(figure, "a-", "") == vector.element(figure, "a-", "")

    def test_colors_in_heat_map_are_not_themed(self):
        drawing = vector.element(made.matrix_figure(), "a-", "")
        assert drawing.svg.count('"rgb(26,26,26)"') == 5
        assert "#1a1a1a" not in drawing.svg
        # Nor are the ground of cells without runs (0.93 of white) and its hatching (0.75).
        (pattern,) = re.findall("<pattern.*?</pattern>", drawing.svg)
        assert '"rgb(191,191,191)"' in pattern
        assert not re.search('"#[0-9a-f]{6}"', pattern)
        assert {"#bfbfbf", "#ededed"} & drawing.colors == set()

    def test_white_ground_of_framed_cell_is_not_themed(self):
        figure = made.matrix_figure()
        heat_map = figure.panels[0].heat_map
        texts = [replace(text, framed=True) for text in heat_map.texts[:1]]
        panel = replace(figure.panels[0], heat_map=replace(heat_map, texts=texts))
        svg = vector.element(replace(figure, panels=[panel]), "a-", "").svg
        assert "rgb(153,153,153)" in svg  # the frame, 0.6 of white
        assert "rgb(255,255,255)" in svg

    def test_large_heat_map_is_raster_image(self):
        values = np.random.default_rng(0).uniform(size=(80, 80))
        axis, edges = Axis("", (0, 80)), np.arange(81.0)
        heat_map = HeatMap(edges, edges, values, "", (0, 1), is_map=True)
        figure = Figure("", [Panel("", axis, axis, heat_map=heat_map)])
        svg = vector.element(figure, "a-", "").svg
        # The second image is matplotlib's color bar.
        assert svg.count("<image") == 2
        assert 'href="data:image/png;base64,' in svg
        assert len(svg) < 200_000

    def test_lines_with_too_many_points_are_raster_image(self):
        # Three lines of 30 points, and a band of 30 above and 30 below.
        figure = made.curves_figure()
        assert figure.corners == 3 * 30 + 2 * 30
        assert "<image" not in vector.element(figure, "a-", "", max_points=150).svg
        assert vector.element(figure, "a-", "", max_points=149).svg.count("<image") >= 1


class TestColors:
    def test_dark_theme_swaps_black_and_white(self):
        assert colors.on_dark("#ffffff") == "#181b21"
        assert colors.on_dark("#000000") == "#e6e9ed"

    def test_dark_theme_lightens_colors_with_low_contrast(self):
        # Contrast with #181b21 (luminance 0.0108), by hand: #e69f00 has a luminance of 0.436, so
        # 0.486 / 0.0608 = 8.0; #0000ff one of 0.0722, so 2.0.
        assert colors.on_dark("#e69f00") == "#e69f00"
        lighter = colors.on_dark("#0000ff")
        assert lighter.endswith("ff")
        assert lighter > "#4"

    def test_style_sheet_has_same_theme_colors(self, rendered):
        for color in (colors.PAPER, colors.INK):
            name = "#" + "".join(f"{part:02x}" for part in color)
            assert re.search(rf"--(paper|ink): light-dark\(#\w+, {name}\)", rendered)


BOX = (43.2, 28.8, 410.4, 244.8)


def values_of(*series, y=None):
    """Returns the tooltip values of a panel with these series."""
    x = Axis("latents", (0, 10))
    figure = made.curves_figure(Panel("", x, y or Axis("error", (0, 10)), series))
    (panel,) = tooltips.panels(figure, [BOX])
    return panel


class TestTooltipValues:
    def test_panel_has_values_of_lines_bands_and_axes(self):
        (panel,) = tooltips.panels(made.curves_figure(), [BOX])
        assert panel["title"] == "face_direction"
        assert panel["box"] == [*BOX]
        assert panel["x"] == {
            "label": "control steps (thousands)",
            "log": False,
            "limits": [0, 30000],
            "unit": 0.001,
            "opposite": None,
            "ticks": None,
        }
        # A series without a label and a threshold have no values.
        td3, ddpg = panel["lines"]
        assert (td3["label"], ddpg["label"]) == ("TD3 (10 seeds)", "DDPG (10 seeds)")
        assert td3["color"].startswith("light-dark(#cc79a7,")
        assert td3["x"] == made.CURVES["control_steps"].tolist()
        assert td3["y"] == made.CURVES["td3"].tolist()
        assert td3["bands"] == [made.CURVES[["td3_low", "td3_high"]].to_numpy().tolist()]
        assert ddpg["bands"] == []

    def test_missing_values_are_omitted(self):
        nan = np.nan
        x, y = np.array([1, 2, 3, np.inf]), np.array([5.0, nan, 7.0, 8.0])
        band = Band(np.array([4.0, nan, nan, nan]), np.array([6.0, nan, nan, nan]))
        (line,) = values_of(Series(x, y, Style("0.2"), "a", [band]))["lines"]
        assert (line["x"], line["y"]) == ([1, 3], [5, 7])
        assert line["bands"] == [[[4, 6], None]]

    def test_partly_dotted_curve_is_one_line(self):
        x, y = np.arange(4.0), np.array([5.0, 6, 7, 8])
        partial = np.array([False, False, True, True])
        (line,) = values_of(Series(x, y, Style("0.2"), "a", partial=partial))["lines"]
        assert (line["x"], line["y"]) == ([0, 1, 2, 3], [5, 6, 7, 8])

    @pytest.mark.parametrize(("count", "most"), [(1, 400), (400, 400), (401, 400), (4901, 400)])
    def test_long_lines_are_thinned_evenly_and_keep_both_ends(self, count, most):
        kept = tooltips.thinned(np.arange(count), most)
        assert len(kept) <= most
        assert (kept[0], kept[-1]) == (0, count - 1)
        steps = np.diff(kept)
        assert len(set(steps[:-1])) <= 1
        assert len(kept) > min(count, most) / 2

    def test_zero_is_omitted_on_logarithmic_axis(self):
        bins = Series(
            np.array([0.5, 1.5, 3, 6]),
            np.array([2.0, 1, 0, 3]),
            Style("#cc79a7"),
            "a",
            edges=np.array([0.0, 1, 2, 4, 8]),
        )
        (line,) = values_of(bins)["lines"]
        assert (line["x"], line["y"]) == ([0.5, 1.5, 3, 6], [2, 1, 0, 3])
        (line,) = values_of(bins, y=Axis("", (0.5, 4), log=True))["lines"]
        assert (line["x"], line["y"]) == ([0.5, 1.5, 6], [2, 1, 3])

    def test_many_lines_share_point_budget_of_page(self):
        # Each figure has two labeled series.
        figures = [made.curves_figure()] * 100
        assert tooltips.points_each(figures[:1]) == 400
        assert tooltips.points_each(figures) == 300

    def test_heat_map_has_tick_names_and_values(self):
        (panel,) = tooltips.panels(made.matrix_figure(), [BOX])
        assert panel["x"]["ticks"] == [[0, "DDPG"], [1, "TD3"]]
        assert panel["x"]["unit"] == 1
        assert panel["y"]["limits"] == [2.5, -0.5]
        assert panel["grid"]["label"] == "final return"
        assert panel["grid"]["x"] == [-0.5, 0.5, 1.5]
        assert panel["grid"]["values"] == [[910, 12.5], [450, None], [0, 668.25]]

    def test_panel_without_data_has_no_values(self):
        (panel,) = tooltips.panels(made.log_figure(), [BOX, BOX])
        assert panel["x"]["label"] == "latents"


class TestDownloads:
    def read(self, link):
        (address,) = re.findall(r'href="data:text/csv;charset=utf-8,([^"]*)"', link)
        assert re.fullmatch(r"[\x20-\x7e]*", address)
        return pd.read_csv(io.StringIO(unquote(address.replace("&#x27;", "'"))))

    def test_link_holds_all_rows(self):
        frame = pd.DataFrame({"name": ["a, b", 'c"d', "e\nf", "50% #1&2"], "x": [1, 0.1 + 0.2, np.nan, 1e-9]})  # fmt: skip # noqa: E501
        link = downloads.link("my data", frame, 100)
        assert 'download="my data.csv"' in link
        assert "(CSV, 1 KB)" in link
        pd.testing.assert_frame_equal(self.read(link), frame, rtol=1e-9)

    def test_formatted_values_are_written_as_numbers(self):
        read = self.read(downloads.link("t", made.TABLE, 1000))
        assert list(read) == [
            "algorithm",
            "final return: median [10th, 90th]",
            "seeds",
            "published median",
            "verdict",
        ]
        assert read.iloc[1, 1:3].tolist() == [1000, 9]

    def test_large_table_is_thinned_and_labeled(self):
        frame = pd.DataFrame({"a": range(1000), "b": 1.5})
        link = downloads.link("t", frame, 500)
        assert "one of every 4 of 1,000 rows, to keep the page small" in link
        assert self.read(link)["a"].tolist() == list(range(0, 1000, 4))

    def test_large_data_are_compressed(self):
        frame = pd.DataFrame({"a": np.linspace(0, 1, 10_000), "b": ["text"] * 10_000})
        link = downloads.link("t", frame, 20_000)
        assert 'download="t.csv.gz"' in link
        (packed,) = re.findall('href="data:application/gzip;base64,([^"]*)"', link)
        assert downloads.link("t", frame, 20_000) == link
        content = gzip.decompress(base64.b64decode(packed))
        pd.testing.assert_frame_equal(
            pd.read_csv(io.BytesIO(content)), frame, check_dtype=False, rtol=1e-8
        )

    def test_numbers_are_rounded_to_nine_digits(self):
        values = [0.1 + 0.2, 1 / 3, -2e9 / 3, 1e300 / 3, 5e-324, 0.0, math.nan, math.inf, 4950500]
        flat = downloads.flat(pd.DataFrame({"a": values}))["a"].tolist()
        assert flat[:4] == [0.3, 0.333333333, -666666667, 3.33333333e299]
        assert flat[4:6] == [5e-324, 0]
        assert math.isnan(flat[6])
        assert flat[7:] == [math.inf, 4950500]

    def test_empty_table_has_no_link(self):
        assert downloads.link("t", pd.DataFrame({"a": []}), 10) == ""

    @pytest.mark.parametrize(
        ("sizes", "total", "share"),
        # 10 + 20 fit and leave 70 for two items; all fit; a single item; no item.
        [((500, 10, 20, 90), 100, 35), ((5, 5), 100, 5), ((500,), 100, 100), ((), 100, 1)],
    )
    def test_large_items_share_budget_left_by_small_items(self, sizes, total, share):
        assert share_each(sizes, total) == share


class TestLegend:
    @pytest.mark.parametrize("dash", ["--", "-.", (0, (8, 1.5))])
    def test_marker_does_not_cover_gap_of_dashes(self, dash):
        width, middle = 1.5, 13  # points; the swatch is 26 points wide
        style = Style("#cc79a7", dash, width, marker="o", size=3)
        shown = legends.legend(Figure("F", [], [("TD3", style)]), set())
        first, gap, *_ = map(float, re.search('dasharray="([^"]*)"', shown)[1].split())
        offset = float(re.search('dashoffset="([^"]*)"', shown)[1])
        # The first dash is as far from the middle of the swatch on both sides.
        assert -offset + first / 2 == pytest.approx(middle, abs=0.05)
        assert middle + first / 2 + gap < 26


class TestTables:
    def test_cells_have_sort_keys(self):
        table = tables.table(made.TABLE, "Final returns")
        assert '<th scope="col" class="number">seeds</th>' in table
        assert '<th scope="row">td3</th>' in table
        assert (
            '<td class="number best" data-sort="668.0"><strong>668 [659, 676]</strong></td>'
            in table
        )
        assert '<td class="number" data-missing></td>' in table
        assert '<td data-sort="10">undecided</td>' in table

    @pytest.mark.parametrize(
        ("value", "shown"),
        [
            (5_000_000, "5,000,000"),
            (np.int64(-7), "-7"),
            (30000.0, "30,000"),
            (1234.56, "1,235"),
            (667.849, "667.8"),
            (0.00123456, "0.001235"),
            (-0.0, "0"),
        ],
    )
    def test_numbers_are_shortened(self, value, shown):
        assert tables.number_text(value) == shown

    def test_cells_of_unusual_types_are_shown(self):
        frame = pd.DataFrame(
            {"a": [float("inf"), True, pd.NaT, pd.Timestamp("2026-11-21"), [1], Value("x", "y")]},
            dtype=object,
        )
        shown = re.findall(r'<th scope="row"[^>]*>(.*?)</th>', tables.table(frame, ""))
        assert shown == ["inf", "yes", "", "2026-11-21 00:00:00", "[1]", "x"]

    def test_rows_are_tagged_with_source_and_representation(self):
        frame = pd.DataFrame(
            {"observation": ["full, bfloat16"], "runs": ["imported, not verified"]}
        )
        row = '<tr data-tags data-representation="full" data-source="imported, not verified">'
        assert row in tables.table(frame, "")

    def test_columns_may_share_name(self):
        frame = pd.DataFrame([[1, 2]], columns=["a", "a"])
        assert tables.table(frame, "").count(">a</th>") == 2
        assert list(downloads.flat(frame)) == ["a", "a'"]


def test_inventory_names_numbers_before_their_values():
    # HTML requires a <dt> before its <dd>.
    page = render_document(made.document(inventory=[("3", "runs")]))
    assert "<div><dt>runs</dt><dd>3</dd></div>" in page


def test_figures_have_separate_path_ids():
    items = [FigureItem(f"f{i}", "F", made.curves_figure(), made.CURVES) for i in range(2)]
    page = Page(render_document(made.document(sections=[Section("S", [], items)])))
    paths = [attrs["href"] for tag, attrs in page.elements if tag == "use"]
    assert {href.split("-")[0] for href in paths} == {"#f0", "#f1"}
