"""axe-core finds nothing to mend in the page of the shipped runs."""

import pytest
from axe_playwright_python.sync_playwright import Axe

from jbench.report.contents import document
from jbench.report.page import render_document
from jbench.report.report import gather
from jbench.report.request import Request
from jbench.store import Results
from jbench.store.shipped import shipped

WIDE, NARROW = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
UNFOLD = (
    "document.querySelectorAll('main details, dialog details').forEach((one) => one.open = true)"
)

# What is drawn is hidden from screen readers by the role of its element; without it this is faster.
DROP = "document.querySelectorAll('.drawing svg > *').forEach((one) => one.remove())"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "index.html"
    made = document(gather(Results(shipped()), Request(claims=True)))
    path.write_bytes(render_document(made).encode())
    return path


def violations(page, **context):
    """Returns the rules that axe-core finds violated, with the elements."""
    page.page.evaluate(UNFOLD)
    page.page.evaluate(DROP)
    response = Axe().run(page.page, **context).response
    assert "color-contrast" in [rule["id"] for rule in response["passes"]]
    return {
        rule["id"]: [node["html"][:200] for node in rule["nodes"]]
        for rule in response["violations"]
    }


@pytest.mark.parametrize(
    ("viewport", "scheme"),
    [
        (WIDE, "light"),
        (NARROW, "dark"),
        pytest.param(WIDE, "dark", marks=pytest.mark.slow),
        pytest.param(NARROW, "light", marks=pytest.mark.slow),
    ],
)
def test_the_page_of_the_shipped_runs_its_filter_and_a_run(opened, written, viewport, scheme):
    page = opened(written, viewport=viewport, color_scheme=scheme)
    assert violations(page) == {}
    page.page.locator(".filters summary").click()
    assert violations(page, context="nav") == {}
    page.page.keyboard.press("Escape")
    page.page.locator("#to-provenance tbody button").first.click()
    assert violations(page, context="dialog") == {}


def test_what_is_wrong_is_found(opened, written):
    page = opened(written)
    page.page.evaluate("document.querySelector('.theme').removeAttribute('aria-label')")
    page.page.evaluate("document.querySelector('.theme').removeAttribute('title')")
    assert list(violations(page, context="nav")) == ["button-name"]
