"""Tests that the example notebook runs, with few steps and short episodes."""

import os
import sys
from pathlib import Path

import nbclient
import nbformat
import pytest

from tests.command_line import with_short_episodes
from tests.documentation import ROOT


@pytest.mark.slow
def test_quickstart_notebook_trains_reports_and_queries(tmp_path, monkeypatch):
    (tmp_path / "site").mkdir()
    monkeypatch.setenv("PYTHONPATH", with_short_episodes(tmp_path / "site")["PYTHONPATH"])
    monkeypatch.setenv("JBENCH_STEPS", "1000")
    # The virtual environment of the tests may not be activated.
    scripts = str(Path(sys.executable).parent)
    monkeypatch.setenv("PATH", os.pathsep.join([scripts, os.environ["PATH"]]))
    notebook = nbformat.read(ROOT / "examples" / "quickstart.ipynb", as_version=4)
    nbformat.validate(notebook)
    resources = {"metadata": {"path": tmp_path}}
    nbclient.NotebookClient(notebook, timeout=1200, resources=resources).execute()
    assert (tmp_path / "notebook-results" / "report" / "index.html").exists()
    cells = {cell["id"]: cell for cell in notebook.cells}
    shown = cells["code-7"]["outputs"][-1]["data"]["text/plain"]
    # A row for each seed, and no others.
    assert [line.split()[1:3] for line in shown.splitlines()[1:]] == [["0", "1000"], ["1", "1000"]]
