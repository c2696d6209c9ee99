"""The page in a real browser, and its size, policy and words."""

import itertools
import re
from functools import cached_property

import numpy as np
import pandas as pd
import pytest
from axe_playwright_python.sync_playwright import Axe

from jbench.report import page
from jbench.report.figures import charts
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.report.texts import clean, map_texts
from jbench.store.shipped import shipped_results
from tests.report.browser import DESKTOP, HOSTILE, PHONE, SIDEWAYS

WORDS = """() => {
  const body = document.body.cloneNode(true);
  const parts = "table, script, svg, dialog, pre, .filters, .tools";
  body.querySelectorAll(parts).forEach((e) => e.remove());
  return body.textContent.split(/\\s+/).filter((word) => word).length;
}"""


@pytest.fixture(scope="module")
def shipped():
    return Frames(shipped_results(), Request(command="jbench report --results reference"))


@pytest.fixture(scope="module")
def shipped_page(shipped, tmp_path_factory):
    path = tmp_path_factory.mktemp("shipped") / "index.html"
    path.write_text(page.render(shipped, charts(shipped)))
    return path


def add_runs(fabric, *names, seeds=2, **changes):
    """Adds young runs, as those of the demo."""
    for name, seed in itertools.product(names, range(seeds)):
        returns = np.linspace(100, 400 + 50 * seed, 25)
        evaluated = {25_000: float(returns[-1])}
        fabric.run(returns, seed, evaluated=evaluated, representation=name, **changes)


def written(found, tmp_path):
    path = tmp_path / "index.html"
    path.write_text(page.render(found, charts(found)))
    return path


def hostile(found):
    """Returns frames in which names are those of an enemy."""
    name = HOSTILE + "\x07"

    def replaced(text):
        return text.replace("dae12", name) if isinstance(text, str) else text

    made = [key for key, value in vars(Frames).items() if isinstance(value, cached_property)]
    for key in ("metrics", "paths", *(key for key in made if not key.startswith("_"))):
        if isinstance(frame := getattr(found, key), pd.DataFrame):
            for column in frame.select_dtypes(["object", "str"]):
                frame[column] = frame[column].map(replaced)
            setattr(found, key, map_texts(frame))
    found.headline, found.notes, found.problems = (
        clean(f"{name} wins."),
        [clean(name)],
        [clean(name)],
    )
    return found


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.slow)])
def test_shipped_page_is_accessible_and_short(shipped_page, opened, scheme):
    shown = opened(shipped_page, color_scheme=scheme).page
    assert shipped_page.stat().st_size < 2_000_000
    assert shown.evaluate("document.documentElement.scrollHeight") < 8000
    assert shown.evaluate(WORDS) <= 1200
    for fold in shown.locator("details.fold > summary").all():
        fold.click()
    assert Axe().run(shown).response["violations"] == []
    cut = "(boxes) => boxes.filter((e) => e.scrollWidth > e.clientWidth).map((e) => e.ariaLabel)"
    assert shown.locator(".scroll").evaluate_all(cut) == []


@pytest.mark.slow
def test_same_frames_give_the_same_bytes_and_nothing_but_its_own_script_may_run(
    shipped, shipped_page
):
    text = page.render(shipped, charts(shipped))
    assert text == shipped_page.read_text()
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]+)"', text)
    assert "unsafe" not in policy
    assert "default-src &#39;none&#39;" in policy
    assert not re.search(r"<[^>]+\sstyle=", text)
    ids = re.findall(r'\sid="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'href="#([^"]+)"', text)) <= set(ids)


@pytest.mark.slow
def test_legends_hide_and_isolate_by_mouse_and_key(shipped_page, opened):
    shown = opened(shipped_page).page
    figure = shown.locator("#representations")

    def seen():
        entries = figure.locator(".legend button").all()
        marks = "(e, n) => [...e.querySelectorAll(`svg [data-series='${n}']`)]"
        return [
            figure.evaluate(f"{marks}.every((m) => m.style.display !== 'none')", number)
            for number in (entry.get_attribute("data-series") for entry in entries)
        ]

    entry = figure.get_by_role("button", name="planar", exact=True)
    index = [e.inner_text() for e in figure.locator(".legend button").all()].index("planar")
    assert all(seen())
    entry.click()
    assert [i for i, on in enumerate(seen()) if not on] == [index]
    entry.focus()
    shown.keyboard.press("Enter")
    assert all(seen())
    entry.dblclick()
    assert [i for i, on in enumerate(seen()) if on] == [index]
    entry.press("Shift+Enter")
    assert all(seen())


@pytest.mark.slow
def test_switches_show_another_axis_and_the_other_returns(shipped_page, opened):
    shown = opened(shipped_page).page
    figure = shown.locator("#representations")
    classes = "(e) => [...e.querySelectorAll('.panel > svg')].filter((s) => s.checkVisibility())"
    classes += ".map((s) => s.getAttribute('class'))"
    assert set(figure.evaluate(classes)) == {"evaluation linear"}
    figure.get_by_role("button", name="Log axis").click()
    figure.get_by_role("button", name="Training returns").click()
    assert set(figure.evaluate(classes)) == {"training log"}
    figure.get_by_role("button", name="Evaluation returns").press("Enter")
    assert set(figure.evaluate(classes)) == {"evaluation log"}


@pytest.mark.slow
def test_tips_name_the_nearest_mark(shipped_page, opened):
    shown = opened(shipped_page).page
    panel = shown.locator("#representations .panel", has_text="face_direction, TD3").first
    panel.scroll_into_view_if_needed()
    line = panel.locator("svg").first.locator("[data-series='2']").last
    box = line.locator("path").last.bounding_box()
    shown.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert re.match(r"planar at 100,000: \d+ \[\d+, \d+\], n = 10", shown.inner_text(".tip"))


@pytest.mark.slow
def test_figures_are_saved_with_colors_of_their_own(shipped_page, opened, tmp_path):
    shown = opened(shipped_page).page
    figure = shown.locator("#algorithms")
    for name, begin in (("SVG", b"<svg"), ("PNG", b"\x89PNG")):
        with shown.expect_download() as download:
            figure.get_by_role("button", name=name).click()
        download.value.save_as(tmp_path / name)
        content = (tmp_path / name).read_bytes()
        assert content.startswith(begin)
        assert b"var(" not in content


@pytest.mark.slow
def test_saved_panels_have_the_legend_of_their_visible_series(shipped_page, opened, tmp_path):
    figure = (shown := opened(shipped_page).page).locator("#representations")
    figure.get_by_role("button", name="dae12", exact=True).click()
    with shown.expect_download() as download:
        figure.get_by_role("button", name="SVG").click()
    download.value.save_as(tmp_path / "saved.svg")
    saved = opened(tmp_path / "saved.svg").page
    assert saved.locator("svg > text").all_text_contents() == [
        "full",
        "scaled",
        "planar",
        "published, training",
    ]
    assert saved.locator("svg > svg").count() == 4


@pytest.mark.slow
def test_runs_are_sorted_filtered_searched_and_opened(shipped_page, opened):
    shown = opened(shipped_page).page
    table = shown.locator("#table-runs")
    finals = "(e) => [...e.tBodies[0].rows].filter((r) => !r.hidden).map((r) => r.cells[5].dataset)"
    head = table.get_by_role("button", name="final return")
    head.click()
    head.click()
    values = [float(one["value"]) for one in table.locator("table").evaluate(finals)]
    assert values == sorted(values, reverse=True)
    table.locator("select").first.select_option("move_in_direction")
    table.get_by_role("searchbox").fill("planar")
    assert table.locator("output").inner_text() == "30 of 409"
    table.locator("tr[data-run]:visible button").first.press("Enter")
    dialog = shown.locator("dialog")
    assert "move_in_direction/td3/planar" in dialog.locator("h2").inner_text()
    facts = dialog.locator(".facts").inner_text()
    assert re.match(r"move_in_direction, TD3, planar.*, seed \d, steps 100k, final return ", facts)
    assert dialog.locator(".curve .mark").count() == 1
    rows = dict(row.split("\t")[:2] for row in dialog.locator("tbody tr").all_inner_texts())
    assert (rows["task"], rows["algo"]) == ("move_in_direction", "td3")
    assert Axe().run(shown).response["violations"] == []
    shown.keyboard.press("Escape")
    assert not dialog.is_visible()


@pytest.mark.slow
def test_later_steps_are_sorted_after_all_others(shipped_page, opened):
    shown = opened(shipped_page).page
    table = shown.locator("#table-final_returns table")
    table.get_by_role("button", name="steps to 900").click()
    cells = table.locator("tbody tr td:last-child").all()
    values = [float(cell.get_attribute("data-value") or "-inf") for cell in cells]
    assert values == sorted(values)
    assert np.isinf(values[-1])
    assert np.isfinite(values).any()


def test_metrics_of_a_run_are_curves_in_its_dialog(fabric, tmp_path, opened):
    fabric.run(
        [100.0] * 8, metrics={"loss": (0.5, 0.25), "<b>x</b>": (1.0, 1.0), "no": (np.nan,) * 2}
    )
    shown = opened(written(Frames(fabric.results), tmp_path)).page
    shown.locator("tr[data-run] button").click()
    dialog = shown.locator("dialog")
    curves = dialog.get_by_label("Curve", exact=True)
    assert curves.inner_text().split() == ["training", "return", "loss", "<b>x</b>"]
    curves.select_option("loss")
    texts = dialog.locator(".curve text").all_text_contents()
    assert texts == ["0.25", "0.375", "0.5", "2,000 steps"]
    assert dialog.locator(".curve .mark").count() == 1


@pytest.mark.slow
def test_everything_that_a_mouse_can_do_a_keyboard_can(shipped_page, opened):
    shown = opened(shipped_page).page
    selector = "button, a[href], select, input, summary, .scroll"
    assert shown.locator(selector).count() > 0
    assert shown.locator(selector).evaluate_all("(all) => all.every((e) => e.tabIndex >= 0)")
    row = "(rows) => rows.every((row) => row.querySelector('button'))"
    assert shown.locator("tr[data-run]").count() > 0
    assert shown.locator("tr[data-run]").evaluate_all(row)


@pytest.mark.slow
def test_page_is_readable_without_scripts(shipped_page, opened):
    shown = opened(shipped_page, java_script_enabled=False).page
    assert shown.locator("#representations .panel > svg:visible").count() == 6
    shown.locator(".verdict summary").first.click()
    assert shown.locator(".verdict[open] small").first.is_visible()


@pytest.mark.parametrize(
    "case",
    [
        pytest.param("shipped", marks=pytest.mark.slow),
        pytest.param("young", marks=pytest.mark.slow),
        pytest.param("variants", marks=pytest.mark.slow),
        "one run",
        # test_hostile_names_run_nothing has such names in a file.
        pytest.param("hostile", marks=pytest.mark.slow),
    ],
)
def test_no_page_scrolls_sideways_or_loads_anything(fabric, opened, tmp_path, case, request):
    if case == "shipped":
        path = request.getfixturevalue("shipped_page")
    else:
        names = ["full"] if case == "one run" else ["full", "dae12"]
        add_runs(fabric, *names, seeds=len(names))
        if case == "variants":
            hyperparameters = {"learning_rate": 1e-5, "batch_size": 1024, "tau": 0.005}
            changes = {"time_limit": "terminal", "hyperparameters": hyperparameters}
            add_runs(fabric, *names, **changes)
        found = Frames(fabric.results)
        path = written(hostile(found) if case == "hostile" else found, tmp_path)
    shown = opened(path, viewport=PHONE).page
    assert shown.evaluate(SIDEWAYS) <= 0
    assert Axe().run(shown).response["violations"] == []
    boxes = "(boxes) => boxes.map((box) => box.scrollWidth - box.clientWidth)"
    assert not any(shown.locator("#reduction .scroll").evaluate_all(boxes))
    if case == "hostile":
        legend = shown.locator("#representations .legend").inner_text()
        assert HOSTILE in legend
    if case == "one run":
        assert shown.locator("main > section").count() <= 5
        assert not shown.locator("#returns, #reduction, #pairs").count()


@pytest.mark.slow
def test_tables_of_verdicts_fit_a_laptop(opened, shipped_page):
    shown = opened(shipped_page, viewport=DESKTOP).page
    boxes = "(boxes) => boxes.map((box) => box.scrollWidth - box.clientWidth)"
    assert not any(shown.locator("#reduction .scroll").evaluate_all(boxes))


@pytest.mark.slow
def test_young_page_shows_both_representations_at_once(fabric, opened, tmp_path):
    add_runs(fabric, "full", "dae12")
    path = written(Frames(fabric.results), tmp_path)
    shown = opened(path).page
    first = shown.locator("main > section").first
    assert first.get_attribute("id") == "representations"
    assert "evaluation" in first.get_attribute("class")
    names = first.locator(".legend button").all_inner_texts()
    assert names == ["full", "dae12", "published, training"]
    # Two seeds say nothing about their variability.
    heads = shown.locator("#reduction thead tr").last.locator("th").all_inner_texts()
    assert heads == ["final return", "speed"]
    assert "variability" not in shown.locator("main").inner_text()


@pytest.mark.slow
def test_long_name_in_a_legend_leaves_the_only_panel_its_width(fabric, opened, tmp_path):
    common = {"batch_size": 64, "hidden_layers": [128, 128], "learning_starts": 5000}
    for rate in (1e-3, 1e-4, 1e-5):
        add_runs(fabric, "full", hyperparameters={"learning_rate": rate, **common})
    figure = opened(written(Frames(fabric.results), tmp_path)).page.locator("#algorithms")
    panel = figure.locator(".panels").bounding_box()
    assert panel["width"] > 0.7 * figure.bounding_box()["width"]


@pytest.mark.slow
def test_watched_page_reloads_itself_and_links_no_files(fabric, opened, tmp_path):
    add_runs(fabric, "full")
    shown = opened(written(Frames(fabric.results, Request(watched=True)), tmp_path)).page
    assert shown.locator("meta[http-equiv=refresh]").count() == 1
    assert shown.locator("a[download]").count() == 0


@pytest.mark.slow
def test_panels_to_unfold_are_as_wide_as_others_and_named_once(shipped_page, opened):
    figure = opened(shipped_page).page.locator("#encoders")
    figure.evaluate("(figure) => (figure.closest('details').open = true)")
    figure.locator(".more > summary").click()
    first, *_, last = (panel.bounding_box()["width"] for panel in figure.locator(".panel").all())
    assert last == first
    named = figure.page.locator("#predictions .more > summary").text_content().split("; ")
    assert len(named) == len(set(named))


@pytest.mark.slow
def test_panels_beside_each_other_begin_at_one_height(shipped_page, opened):
    shown = opened(shipped_page).page
    places = shown.locator("#representations .panel:visible").evaluate_all(
        """(panels) => panels.map((panel) => {
          const svg = [...panel.querySelectorAll("svg")].find((one) => one.checkVisibility());
          const title = panel.querySelector("h3").getBoundingClientRect();
          const top = panel.getBoundingClientRect().top;
          return [top, title.height, svg.getBoundingClientRect().top];
        })"""
    )
    rows = {row: [place[1:] for place in places if place[0] == row] for row, *_ in places}
    # Of the first three titles, one has two lines.
    assert max(height for height, _ in rows[min(rows)]) > min(
        height for height, _ in rows[min(rows)]
    )
    assert all(len({svg for _, svg in row}) == 1 for row in rows.values())


@pytest.mark.slow
def test_legends_have_the_marks_that_are_drawn(shipped_page, opened):
    figure = opened(shipped_page).page.locator("#predictions")
    pairs = figure.locator(".legend path").evaluate_all(
        "(marks) => marks.map((mark) => mark.getAttribute('d') + mark.getAttribute('fill'))"
    )
    assert len(set(pairs)) == len(pairs) > 8


@pytest.mark.slow
def test_page_prints_without_tools(shipped_page, opened):
    shown = opened(shipped_page).page
    shown.emulate_media(media="print")
    assert not shown.locator(".tools").first.is_visible()
    assert not shown.locator("#table-runs").is_visible()
    shown.set_viewport_size({"width": 718, "height": 1000})  # A4 without its margins
    assert shown.evaluate(SIDEWAYS) <= 0
