"""Tests of augmented robots: the distribution of their draws, and the edited models."""

import dataclasses
import math

import mujoco
import numpy as np
import pytest

from jbench.errors import WorkError
from jbench.task_specs import PHYSICS_STEPS
from jbench.tasks.jitterbug import model, robots
from jbench.tasks.jitterbug.robots import LEGS, Morphology, load_model

NONE = (0.0, 0.0, 0.0)

# Knees of the plain robot in the torso's frame, in centimeters.
KNEES = {1: (2.87, 3.28, 3.3), 2: (2.87, -3.08, 3.5), 3: (-2.87, -3.08, 3.5), 4: (-2.87, 3.28, 3.3)}


def only(leg, shift):
    """Shifts of four knees or feet, of which only that of `leg` is not zero."""
    return tuple(shift if number == leg else NONE for number in LEGS)


@pytest.fixture
def plain(robot):
    return robot


@pytest.fixture(scope="module")
def draws():
    """300 morphologies as drawn, without the check that the robots stand."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(robots, "is_usable", lambda morphology: True)
        return [robots.draw.__wrapped__(seed, vary_masses=True) for seed in range(300)]


def ends(robot, geom):
    """Both ends (2, 3) of a cylinder, its first end first, in the torso's frame at rest."""
    data = mujoco.MjData(robot)
    mujoco.mj_forward(robot, data)
    half_axis = data.geom(geom).xmat.reshape(3, 3)[:, 2] * robot.geom(geom).size[1]
    # MuJoCo's cylinder points from its second end to its first.
    return data.geom(geom).xpos - [0, 0, model.REST_HEIGHT] + [half_axis, -half_axis]


def test_model_without_shifts_equals_plain_robot(general):
    robot, parts = robots.build(Morphology(seed=0)), ("body_", "jnt_", "dof_", "geom_", "actuator_")
    for field in [name for name in dir(general) if name.startswith(parts)]:
        found, expected = getattr(robot, field), getattr(general, field)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-15, err_msg=field)
    assert robot.npair == general.npair == 0
    assert robot.opt.disableflags == general.opt.disableflags


@pytest.mark.parametrize(
    ("leg", "axis"),
    # A knee 3 mm to the left and 2 mm back: (2.32 + .3, -2.68 - .2) for leg 1, and so on.
    [(1, (2.62, -2.88)), (2, (-2.62, -3.48)), (3, (2.02, -3.48)), (4, (-2.02, -2.88))],
)
def test_axes_of_shoulder_and_elbow_follow_knee(leg, axis):
    robot = robots.build(Morphology(seed=0, knees=only(leg, (0.003, 0.002, -0.001))))
    for joint in ("shoulder", "elbow"):
        found = robot.joint(f"leg{leg}_{joint}").axis
        np.testing.assert_allclose(found, (*(axis / np.linalg.norm(axis)), 0), atol=1e-12)


@pytest.mark.parametrize("leg", LEGS)
def test_moved_knee_and_foot_move_all_attached_parts_and_no_other_leg(plain, leg):
    shift, step = np.array((0.003, -0.002, 0.001)), np.array((0.001, 0.002, 0.003))
    moved = {"knees": only(leg, tuple(shift)), "feet": only(leg, tuple(step))}
    robot = robots.build(Morphology(seed=0, **moved))
    knee = np.array(KNEES[leg]) / 100 + shift
    (upper_knee, hip), (foot, lower_knee) = (
        ends(robot, f"leg{leg}_{part}") for part in ("upper", "lower")
    )
    for found in (upper_knee, lower_knee, robot.geom(f"leg{leg}_knee").pos):
        np.testing.assert_allclose(found, knee, atol=1e-12)
    elbows = [which.joint(f"leg{leg}_elbow").pos for which in (robot, plain)]
    np.testing.assert_allclose(elbows[0] - elbows[1], shift, atol=1e-12)
    np.testing.assert_allclose(hip, ends(plain, f"leg{leg}_upper")[1], atol=1e-12)
    np.testing.assert_allclose(foot, ends(plain, f"leg{leg}_lower")[0] + step, atol=1e-12)
    np.testing.assert_allclose(robot.geom(f"leg{leg}_foot").pos, foot, atol=1e-12)
    changed = {
        robot.geom(i).name
        for i in range(robot.ngeom)
        if np.abs(robot.geom_pos[i] - plain.geom_pos[i]).max() > 1e-12
    }
    assert changed == {f"leg{leg}_{part}" for part in ("upper", "knee", "lower", "foot")}


def test_motor_mass_is_moved_and_resized(plain):
    robot = robots.build(
        Morphology(seed=0, mass=(0.001, -0.0005, 0.002), mass_semi_axes=(0.001, -0.001, 0.0005))
    )
    np.testing.assert_allclose(robot.geom("mass").pos, (0.0053, -0.0045, 0.028), atol=1e-12)
    np.testing.assert_allclose(robot.geom("mass").size, (0.009, 0.009, 0.0035), atol=1e-12)
    # Steel ellipsoid 4/3 pi a b c, and an unchanged thread pi r^2 h.
    steel = 7700 * math.pi * (4 / 3 * 0.009 * 0.009 * 0.0035 + 0.001**2 * 0.0125)
    assert robot.body("mass").mass[0] == pytest.approx(steel, rel=1e-9)


def test_densities_change_masses_of_their_parts(plain):
    robot = robots.build(
        Morphology(seed=0, torso_upper_density=11.5, torso_lower_density=-70, default_density=770)
    )
    # Volumes by hand: boxes of 11 x 12 x 22 and 16 x 12 x 16 mm.
    boxes = 2904e-9 * 50 + 3072e-9 * 700
    plain_boxes = 2904e-9 * 38.5 + 3072e-9 * 770
    steel = plain.body("jitterbug").mass[0] - plain_boxes
    assert robot.body("jitterbug").mass[0] == pytest.approx(1.1 * steel + boxes, rel=1e-9)
    assert robot.body("mass").mass[0] == pytest.approx(1.1 * plain.body("mass").mass[0], rel=1e-9)
    # The feet are not of steel: 4/3 pi (3 mm)^3 at 1100.
    foot = 4 / 3 * math.pi * 0.003**3 * 1100
    wire = plain.body("leg1_lower").mass[0] - foot
    assert robot.body("leg1_lower").mass[0] == pytest.approx(1.1 * wire + foot, rel=1e-9)
    assert robot.body("target").mass[0] == 0


def test_gear_changes_torque():
    robot = robots.build(Morphology(seed=0, gear=0.001))
    data = mujoco.MjData(robot)
    data.ctrl[0] = 1
    mujoco.mj_forward(robot, data)
    assert data.qfrc_actuator[model.MOTOR] == pytest.approx(0.00933, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "deviations"),
    [
        ("knees", (0.003, 0.003, 0.002)),
        ("feet", (0.003, 0.003, 0.002)),
        ("mass_semi_axes", (0.0007, 0.0007, 0.0007)),
        ("torso_upper_density", 10),
        ("torso_lower_density", 80),
        ("default_density", 200),
        ("gear", 0.001),
    ],
)
def test_shifts_have_reference_deviations_and_zero_mean(draws, name, deviations):
    shifts = np.array([getattr(morphology, name) for morphology in draws])
    np.testing.assert_allclose(shifts.std(axis=0) / deviations, 1, atol=0.15)
    # The mean of 300 is within 0.2 deviations of zero, which is 3.5 of its standard errors.
    assert np.abs(shifts.mean(axis=0) / deviations).max() < 0.2


def test_motor_mass_shift_is_truncated_normal(draws):
    x, y, z = np.array([morphology.mass for morphology in draws]).T
    assert x.std() == pytest.approx(0.0015, rel=0.15)
    assert x.min() < -0.003
    for shift, deviation in ((y, 0.002), (z, 0.001)):
        cut = shift == -0.001
        assert shift.min() == -0.001
        # The share of a normal distribution below -0.001, and the spread of the positive shifts.
        below = 0.5 * math.erfc(0.001 / deviation / math.sqrt(2))
        assert cut.mean() == pytest.approx(below, abs=0.08)
        above = shift[shift > 0]
        assert np.sqrt(np.mean(above**2)) == pytest.approx(deviation, rel=0.15)


def test_seed_determines_morphology():
    first = robots.draw(3)
    robots.draw.cache_clear()
    assert robots.draw(3) == first
    assert first.seed == 3
    assert robots.draw(4).knees != first.knees


def test_masses_vary_only_with_vary_masses():
    morphology = robots.draw(5)
    varied = robots.draw(5, vary_masses=True)
    names = ("torso_upper_density", "torso_lower_density", "default_density", "gear")
    assert [getattr(morphology, name) for name in names] == [0] * 4
    assert all(getattr(varied, name) for name in names)
    assert dataclasses.replace(varied, **dict.fromkeys(names, 0.0)) == morphology


@pytest.mark.parametrize("vary_masses", [False, True])
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 25))]
)
def test_robot_stands_and_steps_without_warning(seed, vary_masses):
    robot = load_model(seed, vary_masses=vary_masses)
    assert robots.standing_reward(robot) > 0.9
    data = mujoco.MjData(robot)
    model.place(data, np.array([1.0, 0, 0, 0]))
    for control in np.random.default_rng(seed).uniform(-1, 1, 100):
        data.ctrl[0] = control
        mujoco.mj_step(robot, data, nstep=PHYSICS_STEPS)
        assert np.isfinite([*data.qpos, *data.qvel]).all()
    assert not data.warning.number.any()
    assert data.time == pytest.approx(1)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mass_semi_axes", (-0.009, 0.0, 0.0)),  # a size below zero
        ("torso_upper_density", -40.0),
        ("feet", ((0.0, 0.0, 0.03), (0.0, 0.0, 0.03), NONE, NONE)),  # short legs on one side
    ],
)
def test_robot_that_cannot_compile_or_stand_is_not_usable(name, value):
    assert robots.is_usable(Morphology(seed=0))
    assert not robots.is_usable(Morphology(seed=0, **{name: value}))


def test_unusable_draw_is_redrawn_and_counted(monkeypatch):
    refused = []

    def third_time(morphology):
        refused.append(morphology)
        return len(refused) == 3

    first = robots.draw(7)
    monkeypatch.setattr(robots, "is_usable", third_time)
    third = robots.draw.__wrapped__(7)
    assert refused[0] == first
    assert third.redraws == 2
    assert (third, third.seed) == (refused[2], 7)
    assert len({morphology.knees for morphology in refused}) == 3


def test_seed_without_usable_robot_is_error(monkeypatch):
    monkeypatch.setattr(robots, "is_usable", lambda morphology: False)
    with pytest.raises(WorkError, match="101 draws of seed 7 stands"):
        robots.draw.__wrapped__(7)
