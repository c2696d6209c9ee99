"""Fixtures of all tests, and their thread limits, renderer and hypothesis profile."""

import ctypes.util
import gc
import json
import os

import pytest
from hypothesis import settings

from jbench.cores import ONE_THREAD
from jbench.opengl import OFF
from jbench.task_specs import EPISODE_STEPS
from tests import order
from tests.page_cache import leave_in_page_cache

leave_in_page_cache()

# Libraries read this when they are first imported, and processes inherit it. `make test` runs a
# process on each core; more threads would only wait for each other.
os.environ.update(ONE_THREAD)

# pytest-xdist sets it in its workers, and tables would break their lines there.
os.environ.pop("COLUMNS", None)

# dm_control and MuJoCo read this once, when they are first imported.
if not os.environ.get("MUJOCO_GL"):
    os.environ["MUJOCO_GL"] = "osmesa" if ctypes.util.find_library("OSMesa") else "disable"

# No deadline, so that a busy machine fails no test. The examples are the same in every run.
settings.register_profile("jbench", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("jbench")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Imports all tests without the garbage collector, which then leaves their modules alone.

    In each worker it would take a quarter of the time of collection, and seconds of the tests.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(20_000, 20, 20)  # by default, it takes a twenty-fifth of the tests
        gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Keeps tests that have something in common in one of several processes."""
    if (count := order.workers()) > 1:
        items[:] = order.in_shares(items, count)


def pytest_sessionfinish():
    """Lets Python collect the modules when it exits; some of their libraries insist on it."""
    gc.unfreeze()


@pytest.fixture
def rendering():
    """Skips the test on a machine that cannot draw pictures off the screen."""
    if os.environ["MUJOCO_GL"].lower() in OFF:
        pytest.skip("no off-screen renderer: install libosmesa6")


@pytest.fixture
def brief_measurements(monkeypatch):
    """Measures the speed of training on few steps and updates."""
    monkeypatch.setattr("jbench.training.speed._STEPS", 10)
    monkeypatch.setattr("jbench.training.speed._UPDATES", 2)


@pytest.fixture
def undrawn(monkeypatch):
    """Leaves the figures of reports out, which take most of their time."""
    monkeypatch.setattr("jbench.report.figures.charts", lambda frames: [])


@pytest.fixture
def coarse_pictures(rendering, monkeypatch):
    """Draws with coarse shadows and edges, which without a GPU take most of a picture's time."""
    from jbench.rendering import episode
    from jbench.tasks.jitterbug import task

    load = task.load_model

    def load_coarse(*arguments, **options):
        model = load(*arguments, **options)
        model.vis.quality.shadowsize, model.vis.quality.offsamples = 64, 0
        return model

    monkeypatch.setattr(task, "load_model", load_coarse)
    monkeypatch.setattr(episode, "_SHADOW_TEXELS", 64)


@pytest.fixture
def run_command(capsys):
    """Returns a function that runs a command: exit code, standard output, standard error.

    What it prints with --json must fit the schema of its document.
    """
    from jbench.cli import main
    from tests.json_documents import check_document

    def run(*arguments, results=None):
        where = () if results is None else ("--results", str(results))
        capsys.readouterr()
        code = main([*map(str, arguments), *where])
        out, err = capsys.readouterr()
        check_document(arguments, out)
        return code, out, err

    return run


@pytest.fixture
def refused(run_command):
    """Returns a function that runs a command that must fail; it returns the only line printed."""

    def run(*arguments, results=None, code=2):
        ended, out, err = run_command(*arguments, results=results)
        assert (ended, out, err[:7], err.count("\n")) == (code, "", "Error: ", 1)
        return err

    return run


@pytest.fixture
def document(run_command):
    """Returns a function that runs a command with --json and reads what it prints."""

    def run(*arguments, results=None, code=0):
        ended, out, err = run_command(*arguments, "--json", results=results)
        assert ended == code, err
        return json.loads(out)

    return run


@pytest.fixture
def forked_workers(monkeypatch):
    """Forks the workers that a command in this process starts; see `tests/forking.py`."""
    from tests.forking import fork_workers

    fork_workers(monkeypatch)


@pytest.fixture
def short_encoder_evaluation():
    """Evaluates encoders on two episodes of the hand-written policy, not ten."""
    from tests import short_encoders

    with short_encoders.short_encoder_evaluation():
        yield


@pytest.fixture(scope="session")
def demo_results(tmp_path_factory):
    """A results directory like that of `make demo`; tests that write must copy it."""
    from jbench.store import Results
    from tests.demo_results import add_demo
    from tests.short_episodes import short_episodes

    results = Results(tmp_path_factory.mktemp("demo") / "results")
    with short_episodes(EPISODE_STEPS):  # the first test that needs them may be of shorter ones
        add_demo(results)
    return results
