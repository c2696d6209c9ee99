"""Accessibility tests of a report's page with axe-core: it finds no violation."""

import itertools

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe

from jbench.report.contents import document
from jbench.report.page import render_document
from jbench.report.report import gather
from jbench.report.request import Request
from jbench.store import Results
from jbench.store.shipped import shipped
from tests.report.conftest import FabricatedResults

WIDE, NARROW = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
UNFOLD = (
    "document.querySelectorAll('main details, dialog details').forEach((one) => one.open = true)"
)

# The role of a drawing hides its content from screen readers; removing the content saves time.
DROP = "document.querySelectorAll('.drawing svg > *').forEach((one) => one.remove())"


SHIPPED = pytest.param("shipped", marks=pytest.mark.slow)


@pytest.fixture(scope="module", params=["fabricated", SHIPPED])
def written(request, tmp_path_factory):
    """The page of a few fabricated runs, or of the shipped runs."""
    folder = tmp_path_factory.mktemp("page")
    results = Results(shipped()) if request.param == "shipped" else fabricated(folder / "results")
    made = document(gather(results, Request(claims=True)))
    path = folder / "index.html"
    path.write_bytes(render_document(made).encode())
    return path


def fabricated(path):
    """Returns results of two algorithms on two representations."""
    fabric = FabricatedResults(path)
    for algo, representation in itertools.product(("td3", "sac"), ("full", "dae12")):
        for seed in range(2):
            evaluated = {20_000: 300.0 + seed, 40_000: 950.0 + seed}
            settings = {"algo": algo, "representation": representation}
            fabric.run(np.linspace(0, 900, 40), seed, evaluated=evaluated, **settings)
    return fabric.results


def violations(page, **context):
    """Returns the rules that axe-core reports as violated, with the elements."""
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
        (NARROW, "dark"),
        pytest.param(WIDE, "light", marks=pytest.mark.slow),
        pytest.param(WIDE, "dark", marks=pytest.mark.slow),
        pytest.param(NARROW, "light", marks=pytest.mark.slow),
    ],
)
def test_page_filter_and_run_dialog_have_no_violation(opened, written, viewport, scheme):
    page = opened(written, viewport=viewport, color_scheme=scheme)
    assert violations(page) == {}
    page.page.locator(".filters summary").click()
    assert violations(page, context="nav") == {}
    page.page.keyboard.press("Escape")
    page.page.locator("#to-provenance tbody button").first.click()
    assert violations(page, context="dialog") == {}


def test_missing_button_label_is_reported(opened, written):
    page = opened(written)
    page.page.evaluate("document.querySelector('.theme').removeAttribute('aria-label')")
    page.page.evaluate("document.querySelector('.theme').removeAttribute('title')")
    assert list(violations(page, context="nav")) == ["button-name"]
