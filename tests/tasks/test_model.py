"""Tests of the MuJoCo model against reference values of masses, positions and sizes."""

import mujoco
import numpy as np
import pytest

from jbench.tasks.jitterbug import model

MASSES = {
    **{"jitterbug": 0.00499303, "mass": 0.00804326},
    **dict.fromkeys(("leg1_upper", "leg4_upper"), 0.00039760),
    **dict.fromkeys(("leg2_upper", "leg3_upper"), 0.00042354),
    **{f"leg{leg}_lower": 0.00070948 for leg in (1, 2, 3, 4)},
}

# In the order of qpos: where the joint is in the world at rest, and its axis.
HINGES = {
    "leg2_shoulder": ((0.003, 0.0035, 0.049), (-2.32, -3.68, 0)),
    "leg2_elbow": ((0.0287, -0.0308, 0.068), (-2.32, -3.68, 0)),
    "leg3_shoulder": ((-0.003, 0.0035, 0.049), (2.32, -3.68, 0)),
    "leg3_elbow": ((-0.0287, -0.0308, 0.068), (2.32, -3.68, 0)),
    "leg1_shoulder": ((0.003, 0.0035, 0.049), (2.32, -2.68, 0)),
    "leg1_elbow": ((0.0287, 0.0328, 0.068), (2.32, -2.68, 0)),
    "leg4_shoulder": ((-0.003, 0.0035, 0.049), (-2.32, -2.68, 0)),
    "leg4_elbow": ((-0.0287, 0.0328, 0.068), (-2.32, -2.68, 0)),
    "motor": ((0, -0.004, 0.050), (0, 0, 1)),
}

# Radius and both ends, in the world at rest.
CYLINDERS = {
    "crank_shaft": (0.002, (0, 0, 0.026), (0, 0.012, 0.026)),
    "leg2_upper": (0.00061, (0.0287, -0.0308, 0.070), (0.005, 0.0035, 0.050)),
    "leg2_lower": (0.00061, (0.0287, -0.0308, 0.005), (0.0287, -0.0308, 0.070)),
    "leg3_upper": (0.00061, (-0.0287, -0.0308, 0.070), (-0.005, 0.0035, 0.050)),
    "leg3_lower": (0.00061, (-0.0287, -0.0308, 0.005), (-0.0287, -0.0308, 0.070)),
    "leg1_upper": (0.00061, (0.0287, 0.0328, 0.068), (0.003, 0.0035, 0.049)),
    "leg1_lower": (0.00061, (0.0287, 0.0328, 0.003), (0.0287, 0.0328, 0.068)),
    "leg4_upper": (0.00061, (-0.0287, 0.0328, 0.068), (-0.003, 0.0035, 0.049)),
    "leg4_lower": (0.00061, (-0.0287, 0.0328, 0.003), (-0.0287, 0.0328, 0.068)),
    "motor_thread": (0.001, (0, -0.004, 0.050), (0, -0.004, 0.0625)),
}

# Kind, sizes, and center in the world at rest.
SOLIDS = {
    "torso_upper": ("box", (0.0055, 0.006, 0.011), (0, 0, 0.040)),
    "torso_lower": ("box", (0.008, 0.006, 0.008), (0, 0, 0.021)),
    "crank_handle": ("ellipsoid", (0.014, 0.006, 0.0005), (0, 0.017, 0.026)),
    "mass": ("ellipsoid", (0.008, 0.010, 0.003), (0.0043, -0.004, 0.061)),
    "leg2_foot": ("sphere", (0.003,), (0.0287, -0.0308, 0.005)),
    "leg3_foot": ("sphere", (0.003,), (-0.0287, -0.0308, 0.005)),
    "leg1_foot": ("sphere", (0.003,), (0.0287, 0.0328, 0.003)),
    "leg4_foot": ("sphere", (0.003,), (-0.0287, 0.0328, 0.003)),
    "target": ("sphere", (0.01,), (0, 0, 0.035)),
}


@pytest.fixture
def at_rest(robot):
    data = mujoco.MjData(robot)
    model.place(data, np.array([1.0, 0, 0, 0]))
    mujoco.mj_forward(robot, data)
    return data


def touching(robot, data):
    return [{robot.geom(geom).name for geom in contact.geom} for contact in data.contact]


def test_ten_bodies_weigh_17_5165_grams_in_total(robot):
    masses = {robot.body(i).name: mass for i, mass in enumerate(robot.body_mass) if mass > 0}
    assert masses == pytest.approx(MASSES, abs=1e-8)
    assert robot.body_mass.sum() == pytest.approx(0.0175165, abs=5e-8)


@pytest.mark.parametrize(("geom", "expected"), CYLINDERS.items())
def test_cylinder_has_its_radius_and_ends(robot, at_rest, geom, expected):
    radius, *ends = expected
    half_axis = at_rest.geom(geom).xmat.reshape(3, 3)[:, 2] * robot.geom(geom).size[1]
    found = [at_rest.geom(geom).xpos + sign * half_axis for sign in (-1, 1)]
    assert robot.geom(geom).type[0] == mujoco.mjtGeom.mjGEOM_CYLINDER
    assert robot.geom(geom).size[0] == radius
    np.testing.assert_allclose(sorted(map(tuple, np.round(found, 12))), sorted(ends), atol=1e-9)


@pytest.mark.parametrize(("geom", "expected"), SOLIDS.items())
def test_solid_has_its_shape_and_position(robot, at_rest, geom, expected):
    kind, size, center = expected
    assert robot.geom(geom).type[0] == getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")
    np.testing.assert_array_equal(robot.geom(geom).size[: len(size)], size)
    np.testing.assert_allclose(at_rest.geom(geom).xpos, center, atol=1e-12)


def test_sizes_of_state_and_order_of_joints(robot):
    assert (robot.nq, robot.nv, robot.nu) == (16, 15, 1)
    assert [robot.joint(i).name for i in range(robot.njnt)] == ["root", *HINGES]
    assert robot.jnt_qposadr.tolist() == [0, *range(7, 16)]


@pytest.mark.parametrize(("joint", "expected"), HINGES.items())
def test_hinge_has_its_position_axis_and_spring(robot, at_rest, joint, expected):
    anchor, axis = expected
    stiffness, damping = (0, 0) if joint == "motor" else (0.4, 1e-5)
    np.testing.assert_allclose(at_rest.joint(joint).xanchor, anchor, atol=1e-12)
    np.testing.assert_allclose(at_rest.joint(joint).xaxis, axis / np.linalg.norm(axis), atol=1e-12)
    assert robot.joint(joint).type[0] == mujoco.mjtJoint.mjJNT_HINGE
    assert not robot.joint(joint).limited[0]
    assert robot.joint(joint).stiffness[0] == stiffness
    assert robot.dof_damping[robot.joint(joint).dofadr[0]] == damping


@pytest.mark.parametrize(
    ("control", "speed", "torque"),
    [
        (1, 0, 0.00833),
        (-0.5, 0, -0.004165),
        (0, 100, -0.00833 * 0.6664),  # 0.8 * 0.00833 * 100 = 0.6664
        (1, 150, 0.00833 * 0.0004),  # no-load speed: 0.8 * 0.00833 * 150 = 0.9996
        (3, 0, 0.00833),  # clipped to 1
        (-3, 100, -0.00833 * 1.6664),  # clipped to -1
    ],
)
def test_motor_torque_is_that_of_velocity_servo(robot, at_rest, control, speed, torque):
    at_rest.ctrl[0] = control
    at_rest.qvel[model.MOTOR] = speed
    mujoco.mj_forward(robot, at_rest)
    np.testing.assert_allclose(at_rest.qfrc_actuator, [0] * 14 + [torque], rtol=1e-9)


def test_options_are_mujoco_defaults_except_timestep(general):
    default = mujoco.MjModel.from_xml_string("<mujoco/>").opt
    names = [name for name in dir(default) if not name.startswith("_") and name != "timestep"]
    assert {"integrator", "solver", "cone", "tolerance", "gravity"} <= set(names)
    for name in names:
        np.testing.assert_array_equal(getattr(general.opt, name), getattr(default, name), name)
    assert general.opt.timestep == 0.0002
    assert general.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER


def test_target_has_neither_mass_nor_contacts(robot, at_rest):
    # At rest the target overlaps the torso, so a target with contacts would touch it.
    assert at_rest.body("target").xpos.tolist() == at_rest.body("jitterbug").xpos.tolist()
    at_rest.qpos[2] = 0.02  # the feet penetrate the floor
    mujoco.mj_forward(robot, at_rest)
    assert at_rest.ncon > 0
    assert not any({"target", "target_pointer"} & pair for pair in touching(robot, at_rest))
    assert robot.body("target").mass[0] == 0


def test_cameras_have_expected_order_and_directions(robot, at_rest):
    names = [robot.camera(i).name for i in range(robot.ncam)]
    assert names == ["overhead", "spectator", "tracking", "ego"]
    # A camera looks along its -z axis: down from above, and where the robot faces (-y).
    look = {name: -at_rest.camera(name).xmat.reshape(3, 3)[:, 2] for name in names}
    np.testing.assert_allclose(look["overhead"], [0, 0, -1], atol=1e-12)
    assert look["ego"][1] < -0.9
    assert robot.camera("ego").bodyid[0] == robot.body("jitterbug").id
    assert robot.camera("tracking").mode[0] == mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM
    assert robot.camera("spectator").bodyid[0] == 0


def test_robot_stands_at_rest_on_its_four_feet(robot, at_rest):
    mujoco.mj_step(robot, at_rest, nstep=2500)  # 0.5 s
    assert at_rest.body("jitterbug").xmat[8] > 0.999
    # The front feet start 2 mm above the floor, so the torso's frame sinks by a part of that.
    np.testing.assert_allclose(at_rest.qpos[:3], [0, 0, 0.034], atol=0.0015)
    np.testing.assert_allclose(at_rest.qvel[: model.MOTOR], 0, atol=0.01)  # the motor turns freely
    feet = [{"floor", f"leg{leg}_foot"} for leg in (2, 3, 1, 4)]
    assert touching(robot, at_rest) == feet
