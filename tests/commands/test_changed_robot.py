"""A robot whose MuJoCo model changes while its module stays: another experiment in every verb."""

import json
import re

import pytest

from jbench.store import Results
from tests.command_line import TRAINING, jbench
from tests.user_code import words

ARM = '''
"""An arm whose model an environment variable changes."""
import os

from dm_control.mujoco import Physics
from dm_control.rl.control import Environment
from dm_control.suite.base import Task

MODEL = """
<mujoco model="arm">
  <option timestep="0.005"/>
  <default><geom condim="3"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1" rgba="1 0 0 1"/>
    <body name="arm" pos="0 0 .3">
      <joint name="shoulder" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder" gear="5" ctrlrange="-1 1" ctrllimited="true"/></actuator>
</mujoco>
"""


class Raise(Task):
    def initialize_episode(self, physics):
        physics.data.qpos[:] = self.random.uniform(-0.5, 0.5)

    def get_observation(self, physics):
        return {"q": physics.data.qpos.copy(), "v": physics.data.qvel.copy()}

    def get_reward(self, physics):
        return float(0.5 - 0.5 * physics.data.qpos[0] / (1 + abs(physics.data.qpos[0])))


def make(random=None):
    old, new = os.environ.get("CHANGE", "|").split("|")
    physics = Physics.from_xml_string(MODEL.replace(old, new) if old else MODEL)
    return Environment(physics, Raise(random=random), time_limit=1, control_timestep=0.01)
'''
TRAIN = ("train", "--task", "arm:make", "--algo", "td3", *TRAINING["td3"], "--steps", "200")
TRAIN += ("--seeds", "0-1", "--evaluate-episodes", "1", "--evaluate-every", "100")
CHANGED = "the robot's MuJoCo model has changed since"
DATE = r"\(\d{4}-\d\d-\d\d \d\d:\d\d UTC\)"

CHANGES = {
    "flag": '"0.005"/>|"0.005"><flag contact="disable" gravity="disable"/></option>',
    "condim": 'condim="3"|condim="1"',
    "solref": 'condim="3"|condim="3" solref="0.2 1"',
    "impratio": '"0.005"/>|"0.005" impratio="100" cone="elliptic"/>',
    "dynamics": "<motor |<general dyntype='filter' dynprm='.1' ",
    "gravcomp": '<body name="arm"|<body name="arm" gravcomp="1"',
}


@pytest.fixture
def typed(tmp_path):
    """A function that types a command beside the robot's module; returns code and words."""
    (tmp_path / "arm.py").write_text(ARM)

    def type(*arguments, code=0):
        done = jbench(*arguments, cwd=tmp_path)
        assert done.returncode == code, done.stdout + done.stderr
        return words(done.stdout + done.stderr)

    return type


def run_ids(tmp_path):
    return {record.id for record in Results(tmp_path / "results").scan("run")[0]}


@pytest.mark.slow
@pytest.mark.parametrize("change", CHANGES)
def test_changed_model_is_another_experiment(change, typed, tmp_path, monkeypatch):
    typed(*TRAIN)
    before = run_ids(tmp_path)
    run = min(before)
    typed("evaluate", run, "--episodes", "1")

    monkeypatch.setenv("CHANGE", CHANGES[change])
    assert f"{CHANGED} 2 runs were recorded" in typed(*TRAIN)
    assert before < run_ids(tmp_path)
    assert len(run_ids(tmp_path)) == 4
    said = typed("evaluate", run, "--episodes", "2", code=2)
    assert re.search(rf"{CHANGED} the run {run} was recorded {DATE}", said)
    said = typed("reproduce", run, "--episodes", "1", code=2)
    assert re.search(rf"{CHANGED} the run {run} was recorded {DATE}", said)
    assert "altered" not in said
    said = typed("verify")
    assert all(f"run {id}, of" in said for id in before)
    assert "About your code: that of 3 records has changed" in said

    report = jbench("report", "--format", "svg", "--json", cwd=tmp_path)
    rows = json.loads(report.stdout)["configurations"]
    names = {row["configuration"]: row["seeds"] for row in rows if row["returns"] == "evaluation"}
    assert [*names.values()] == [2, 2]
    assert all(re.search(r"robot [0-9a-f]{6} of \d{4}-\d\d-\d\d", name) for name in names)

    accepted = typed("evaluate", run, "--episodes", "2", "--accept-changed-code")
    assert "with changed code" in accepted


@pytest.mark.slow
@pytest.mark.usefixtures("rendering")
def test_picture_of_a_changed_robot_is_refused_or_marked(typed, tmp_path, monkeypatch):
    typed(*TRAIN)
    run = min(run_ids(tmp_path))
    render = ("render", run, "--out", "strip.png", "--steps", "20")
    assert "changed" not in typed(*render)
    (tmp_path / "strip.png").unlink()

    monkeypatch.setenv("CHANGE", CHANGES["gravcomp"])
    assert re.search(rf"{CHANGED} the run {run} was recorded {DATE}", typed(*render, code=2))
    assert not (tmp_path / "strip.png").exists()
    assert "with changed code" in typed(*render, "--accept-changed-code")
    assert (tmp_path / "strip.png").exists()


@pytest.mark.slow
def test_changed_color_is_no_change(typed, tmp_path, monkeypatch):
    typed(*TRAIN)
    before = run_ids(tmp_path)
    monkeypatch.setenv("CHANGE", "1 0 0 1|0 1 0 1")
    assert "2 of 2 runs are already finished" in typed(*TRAIN)
    assert run_ids(tmp_path) == before
    assert "About your code" not in typed("verify")
