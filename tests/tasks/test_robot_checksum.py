"""Two robots are the same if all that can move them is the same."""

import mujoco
import numpy as np
import pytest

from jbench.store import Results
from jbench.store.shipped import shipped
from jbench.tasks.environment_task import EnvironmentTask
from jbench.tasks.find import find_task
from jbench.tasks.robot_checksum import older_robot_checksum, physical_fields, robot_checksum
from tests.training.small_runs import small_run

XML = """
<mujoco>
  <option timestep="0.005"/>
  <visual><global offwidth="640"/></visual>
  <asset>
    <texture name="sky" type="skybox" builtin="flat" rgb1="1 0 0" width="4" height="24"/>
    <material name="red" rgba="1 0 0 1"/>
    <mesh name="wedge" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1"/>
    <hfield name="hills" nrow="2" ncol="2" size="1 1 .1 .1" elevation="0 1 0 1"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <camera name="side" pos="0 -2 1"/>
    <geom type="hfield" hfield="hills"/>
    <body name="upper" pos="0 0 .5">
      <joint name="shoulder" axis="0 1 0" damping=".1" stiffness="1" springref="10"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" material="red"/>
      <site name="tip" pos=".3 0 0"/>
      <body name="lower" pos=".3 0 0">
        <joint name="elbow" axis="0 1 0" range="-1 1" limited="true"/>
        <geom type="mesh" mesh="wedge"/>
        <site name="end" pos=".1 0 0"/>
      </body>
    </body>
  </worldbody>
  <tendon><spatial name="rope" stiffness="1"><site site="tip"/><site site="end"/></spatial></tendon>
  <equality><joint joint1="shoulder" joint2="elbow" active="false"/></equality>
  <contact><exclude body1="upper" body2="lower"/></contact>
  <actuator>
    <general joint="shoulder" dyntype="filter" dynprm=".1" ctrlrange="-1 1" ctrllimited="true"/>
  </actuator>
  <sensor><gyro site="tip"/></sensor>
  <keyframe><key qpos="0 .1"/></keyframe>
  <custom><numeric name="weight" data="3"/></custom>
</mujoco>
"""


class Environment:
    """An environment as that of dm_control, with a compiled model."""

    def __init__(self, model):
        self.physics = self
        self.model = model


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(XML)


def checksum(model):
    return robot_checksum(Environment(model))


def fields(holder):
    """Returns the arrays of a struct of MuJoCo by name, and its numbers."""
    values = {n: getattr(holder, n) for n in dir(holder) if not n.startswith("_")}
    return {n: v for n, v in values.items() if isinstance(v, int | float | np.ndarray)}


def changes(model):
    """Yields the name of a field of the model, changing one after another and changing it back."""
    for holder, prefix in ((model, ""), (model.opt, "opt.")):
        for name, value in fields(holder).items():
            if isinstance(value, np.ndarray):
                if value.size == 0 or value.dtype.kind not in "iufb":
                    continue
                before = value.copy()
                value.flat[0] = not value.flat[0] if value.dtype.kind == "b" else value.flat[0] + 1
                yield prefix + name
                value[...] = before
            elif prefix:  # numbers of the model itself are sizes, which can't be set
                setattr(holder, name, value + 1)
                yield prefix + name
                setattr(holder, name, value)


@pytest.mark.slow
def test_each_field_of_the_compiled_model_that_can_move_it_makes_another_robot(model):
    before, same, seen = checksum(model), set(), set()
    for name in changes(model):
        seen.add(name)
        if checksum(model) == before:
            same.add(name)
    assert checksum(model) == before
    drawn = {name for name in same if name.startswith(("cam_", "light_", "tex_", "mat_"))}
    others = same - drawn
    assert others == {
        *("geom_group", "geom_matid", "geom_rgba", "jnt_group", "site_group", "site_matid"),
        *("site_rgba", "tendon_group", "tendon_matid", "tendon_rgba", "tendon_width"),
        *("hfield_pathadr", "mesh_pathadr", "mesh_normal", "mesh_normaladr", "mesh_normalnum"),
        *("mesh_texcoordadr", "mesh_texcoordnum", "names_map"),
        *("mesh_facenormal", "mesh_facetexcoord"),
        *(name for name in seen if name.startswith("name_")),
    }
    assert {"geom_condim", "geom_solref", "geom_margin", "opt.impratio", "opt.cone"} <= seen
    assert {"opt.disableflags", "opt.iterations", "body_gravcomp", "eq_active0"} <= seen
    assert {"actuator_dynprm", "jnt_actfrcrange", "mesh_vert", "hfield_data", "key_qpos"} <= seen


@pytest.mark.parametrize(
    ("before", "after", "is_same"),
    [
        ('timestep="0.005"', 'timestep="0.005" impratio="100" cone="elliptic"', False),
        ('timestep="0.005"/>', 'timestep="0.005"><flag contact="disable"/></option>', False),
        ("<geom type=", '<geom condim="1" type=', False),
        ("<geom type=", '<geom solref=".2 1" type=', False),
        ('springref="10"', 'springref="20"', False),
        ('active="false"', 'active="true"', False),
        ('dynprm=".1"', 'dynprm=".2"', False),
        ('data="3"', 'data="4"', False),
        ('pos="0 -2 1"', 'pos="0 -3 1"', True),
        ('rgba="1 0 0 1"', 'rgba="0 1 0 1"', True),
        ('rgba="1 0 0 1"', 'rgba="0 1 0 0"', False),  # a rangefinder sees through it
        ('rgb1="1 0 0"', 'rgb1="0 0 1"', True),
        ('offwidth="640"', 'offwidth="800"', True),
        ('name="elbow"', 'name="knee"', True),
        ("<sensor>", '<sensor><framepos objtype="camera" objname="side"/>', False),
    ],
)
def test_checksum_changes_only_if_an_episode_may_differ(model, before, after, is_same):
    text = XML.replace(before, after).replace(
        'joint2="elbow"', 'joint2="knee"' if "knee" in after else 'joint2="elbow"'
    )
    assert (checksum(mujoco.MjModel.from_xml_string(text)) == checksum(model)) == is_same


def test_camera_counts_where_a_sensor_measures_it():
    text = XML.replace("<sensor>", '<sensor><framepos objtype="camera" objname="side"/>')
    moved = text.replace('pos="0 -2 1"', 'pos="0 -3 1"')
    first, second = map(mujoco.MjModel.from_xml_string, (text, moved))
    assert checksum(first) != checksum(second)


def test_rounding_and_empty_fields_are_left_out(model):
    before = checksum(model)
    model.opt.gravity[2] *= 1 + 1e-9
    assert checksum(model) == before
    assert all(values.any() for name, values in physical_fields(model) if "invisible" not in name)


def test_environment_without_mujoco_has_none():
    assert robot_checksum(object()) is None
    assert older_robot_checksum(object()) is None


def test_older_checksum_of_the_shipped_robot_is_as_recorded():
    runs, _ = Results(shipped()).scan("run", "gym.Hopper-v5/")
    recorded = {run.settings["specs"]["model"] for run in runs}
    assert recorded == {find_task("gym:Hopper-v5").specs.model}


ARM = """
<mujoco model="arm">
  <option timestep="0.005" {option}>{flag}</option>
  <default><geom condim="{condim}" solref="{solref}" rgba="{rgba}"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1"/>
    <body name="arm" pos="0 0 .3">
      <joint name="shoulder" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder" gear="5" ctrlrange="-1 1" ctrllimited="true"/></actuator>
</mujoco>
"""
PLAIN = {"option": "", "flag": "", "condim": 3, "solref": ".02 1", "rgba": "1 0 0 1"}


def arm_run(timestep=0.01, files=("task.py",), **changes):
    """Returns the settings of a run of an arm of a user."""
    from dm_control.mujoco import Physics
    from dm_control.rl.control import Environment as Control
    from dm_control.suite.base import Task

    class Still(Task):
        def get_observation(self, physics):
            return {"angle": physics.data.qpos.copy()}

        def get_reward(self, physics):
            return 0.0

        def initialize_episode(self, physics):
            pass

    def make(seed):
        physics = Physics.from_xml_string(ARM.format(**{**PLAIN, **changes}))
        return Control(physics, Still(random=seed), control_timestep=timestep, time_limit=10)

    task = EnvironmentTask("arm:make", make, files=dict.fromkeys(files, "1"))
    lengths = {"steps": 1000, "evaluate_every": 1000, "evaluate_episodes": 1}
    return small_run("td3", {}, task="arm:make", specs=task.specs, **lengths)


@pytest.mark.parametrize(
    ("changes", "is_same"),
    [
        ({}, True),
        ({"rgba": "0 0 1 1"}, True),
        ({"option": 'impratio="100" cone="elliptic"'}, False),
        ({"flag": '<flag contact="disable" gravity="disable"/>'}, False),
        ({"condim": 1}, False),
        ({"solref": ".2 1"}, False),
        ({"timestep": 0.02}, False),
        ({"files": ("task.py", "reward.py")}, False),
    ],
)
def test_run_of_another_robot_has_another_id(changes, is_same):
    assert (arm_run(**changes).id == arm_run().id) == is_same
