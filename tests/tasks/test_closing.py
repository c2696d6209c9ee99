"""Tests of what closes environments, and of a `close` that fails: a warning, the work is kept."""

import re
import signal
import warnings

import numpy as np
import pytest

import jbench
from jbench.datasets import find_dataset
from jbench.errors import RequestError, WorkWarning
from jbench.store import Results
from jbench.tasks.find import find_task
from jbench.tasks.gym import RobotEnv
from jbench.tasks.vector import RobotVectorEnv
from tests import mistaken_gym_tasks
from tests.command_line import SMALL
from tests.drawn_gym_tasks import Licensed
from tests.gym_tasks import EPISODE

MISTAKEN = "tests.mistaken_gym_tasks"
LICENSED = "tests.drawn_gym_tasks:licensed"
FAILS = f"{MISTAKEN}:fails_to_close"
QUITS = f"{MISTAKEN}:quits_at_close"
GONE = (
    r"its close fails \(OSError: the simulator is gone, line \d+ of \w+\.py\); no result is lost\."
)


def made(task, count):
    """Returns worlds of a task, whose sizes were read from an environment that was closed."""
    with warnings.catch_warnings(action="ignore"):
        return find_task(task).worlds(count)


def test_every_environment_is_closed_and_their_error_is_a_warning():
    worlds = made(FAILS, 3)
    closed = mistaken_gym_tasks.FailsToClose.closed
    with pytest.warns(WorkWarning, match=f"^{FAILS}: {GONE}$"):
        worlds.close()
    assert mistaken_gym_tasks.FailsToClose.closed == closed + 3


def test_exit_in_close_is_a_warning():
    sentence = rf"^{QUITS}: its close fails \(SystemExit: no license, line \d+ of \w+\.py\); no res"
    with pytest.warns(WorkWarning, match=sentence), find_task(QUITS).worlds(1):
        pass


def test_error_of_close_hides_no_other():
    with (
        pytest.warns(WorkWarning, match=GONE),
        pytest.raises(ZeroDivisionError),
        find_task(FAILS).worlds(1),
    ):
        raise ZeroDivisionError


def test_environment_that_is_made_for_each_episode_goes_on():
    worlds = made("tests.odd_tasks:FailsToClose", 1)
    for _ in range(2):
        with pytest.warns(WorkWarning, match=GONE):
            worlds.reset([np.random.default_rng(0)])
        worlds.check()


def test_reason_of_a_refusal_is_not_that_of_close(run_command):
    task = f"{MISTAKEN}:fails_to_close_pixels"
    code, _, err = run_command("tasks", task)
    assert code == 2
    warning, error = err.splitlines()
    assert re.fullmatch(f"Warning: {task}: {GONE}", warning)
    assert "its observation is a picture" in error


def test_environments_before_one_that_cannot_be_made_are_closed():
    with pytest.raises(RequestError, match="OSError: no license is free"):
        find_task(LICENSED).worlds(3)
    assert Licensed.taken == 0


def test_environments_that_cannot_be_made_again_to_draw_are_closed_once(monkeypatch):
    with find_task(LICENSED).worlds(2) as worlds:
        assert Licensed.taken == 2
        monkeypatch.setattr(Licensed, "licenses", 1)
        with pytest.raises(RequestError, match="no license is free"):
            worlds.prepare_pictures()
        assert Licensed.taken == 0
    assert Licensed.taken == 0


@pytest.mark.parametrize("make", [RobotEnv, lambda *a, **view: RobotVectorEnv(a[0], 2, **view)])
def test_environments_of_a_view_that_does_not_exist_are_closed(make):
    with pytest.raises(RequestError, match="has no camera side"):
        make(LICENSED, render_mode="rgb_array", camera="side")
    assert Licensed.taken == 0


TRAIN = ("train", "--algo", "td3", "--steps", 4 * EPISODE, "--seeds", "0-1", *SMALL)


@pytest.mark.usefixtures("forked_workers")
def test_commands_warn_once_and_keep_their_work(run_command, tmp_path):
    for command in (("collect", "--steps", 3 * EPISODE), ("evaluate", "random"), TRAIN):
        code, _, err = run_command(*command, "--task", FAILS, results=tmp_path)
        assert code == 0, err
        assert len(re.findall(f"(?m)^Warning: {FAILS}: {GONE}$", err)) == 1
        assert "Traceback" not in err

    results = Results(tmp_path)
    assert find_dataset(results, task=FAILS).control_steps == 3 * EPISODE
    for kind, count in (("evaluation", 1), ("run", 2)):
        assert [record.status for record in results.scan(kind)[0]] == ["finished"] * count


@pytest.fixture
def ctrl_c():
    """Ctrl-C interrupts this process, which may have been started to ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("forked_workers", "ctrl_c")
def test_interrupt_of_close_in_a_worker_is_an_error_of_its_code(run_command, tmp_path):
    task = f"{MISTAKEN}:is_stopped_at_close"
    code, _, err = run_command(*TRAIN, "--task", task, results=tmp_path)
    assert code == 1
    assert "failed: Code that jbench called ended the process (KeyboardInterrupt, line " in err
    assert "died without a message" not in err


@pytest.mark.filterwarnings("ignore::jbench.errors.WorkWarning")
def test_recorded_run_is_finished_though_its_environment_fails_to_close(tmp_path):
    about = {"task": FAILS, "algo": "still", "seed": 0, "steps": EPISODE, "results": tmp_path}
    with jbench.record(**about) as recording:
        env = recording.env()
        env.reset()
        for _ in range(EPISODE):
            env.step(np.zeros(1, np.float32))
        env.close()

    assert recording.finished
