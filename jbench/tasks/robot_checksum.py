"""The checksum of a robot: MuJoCo's compiled model without what only draws.

Two robots are the same if everything that can move them, or that a sensor measures, is the same.
The whole model counts, rather than a list of fields, so that fields of later versions of MuJoCo
count, too. Fields that are empty or zero are left out, since such versions add them.
"""

import hashlib
import re
from collections.abc import Iterable, Iterator
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

# Fields of MuJoCo's model and its options by which two robots differ, without fields that only
# draw.
_COMPARED = """
body_parentid body_pos body_quat body_mass body_inertia body_ipos jnt_type jnt_axis jnt_pos
jnt_range jnt_stiffness dof_damping dof_armature dof_frictionloss geom_type geom_size geom_pos
geom_quat geom_friction geom_contype geom_conaffinity site_pos tendon_stiffness tendon_damping
actuator_gear actuator_gainprm actuator_biasprm actuator_ctrlrange actuator_forcerange
"""
_OPTIONS = ("timestep", "gravity", "wind", "density", "viscosity", "integrator")

_DRAWN = re.compile(
    r"""
      (cam | light | mat | tex | skin)_.*          # cameras, lights, surfaces
    | n (cam | light | mat | tex(data)? | skin.* | user_cam) | vis
    | (geom | site | tendon | flex | jnt)_group    # but that of an actuator can disable it
    | .*_(rgba | matid) | tendon_width             # looks of parts
    | mesh_ (face)? (normal | texcoord) (adr | num)?
    | flex_ (elem)? texcoord (adr)? | flex_flatskin
    | n (meshnormal | meshtexcoord | flextexcoord)
    """,
    re.VERBOSE,
)
_NOT_PHYSICAL = re.compile(
    r"""
      names(_map)? | name_.*adr | nnames(_map)? | .*pathadr | n?paths      # names and places
    | n (arena | buffer | conmax | jmax | userdata | pluginstate)          # memory
    | signature | stat
    """,
    re.VERBOSE,
)
_DIGITS = 6  # other versions and processors round differently when they compile a model


def robot_checksum(environment: Any) -> str | None:
    """Returns the SHA-256 of the MuJoCo model of an environment, if it has one.

    Numbers are rounded to six digits.
    """
    model = compiled_model(environment)
    if model is None:
        return None
    return _digest(physical_fields(model))


def compiled_model(environment: Any) -> Any:
    """Returns the MuJoCo model of an environment, which dm_control wraps; None without one.

    The physics of an environment may be of another simulator.
    """
    model = getattr(getattr(environment, "physics", None), "model", None)
    model = getattr(model, "ptr", model)
    return model if isinstance(model, mujoco.MjModel) else None


def _digest(fields: Iterable[tuple[str, NDArray[np.float64]]]) -> str:
    """Returns the SHA-256 of fields by name: their shapes, and their numbers rounded."""
    digest = hashlib.sha256()
    for name, values in fields:
        numbers = " ".join(f"{number:.{_DIGITS}g}" for number in values.ravel())
        digest.update(f"{name} {values.shape} {numbers}\n".encode())
    return digest.hexdigest()


def physical_fields(model: Any) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yields name and values of each field of a compiled model that is part of its robot.

    Those with zeros alone are left out.
    """
    holders = {"": model, "opt.": model.opt, "stat.": model.stat}
    for prefix, holder in holders.items():
        for name in sorted(dir(holder)):
            if name.startswith("_") or (not prefix and _is_left_out(name)):
                continue
            if prefix == "stat." and name != "meaninertia":  # by which the solver scales
                continue
            numbers = _numbers(getattr(holder, name))
            if numbers is not None and numbers.any():
                yield f"{prefix}{name}", numbers

    # A rangefinder does not see what is transparent.
    yield "invisible geoms", np.flatnonzero(_alpha(model) == 0).astype(np.float64)
    if _has_camera_sensor(model):
        for name in sorted(name for name in dir(model) if name.startswith("cam_")):
            numbers = _numbers(getattr(model, name))
            if numbers is not None:
                yield name, numbers


def _is_left_out(name: str) -> bool:
    """Returns whether a field does not affect the physics: what is drawn, and counts."""
    return bool(_DRAWN.fullmatch(name) or _NOT_PHYSICAL.fullmatch(name))


def _numbers(value: object) -> NDArray[np.float64] | None:
    """Returns a field as numbers, or None if it is none."""
    if isinstance(value, bytes):  # texts of the XML, which code may read
        return np.frombuffer(value, np.uint8).astype(np.float64)
    if isinstance(value, bool | int | float | np.ndarray | np.number):
        array = np.asarray(value)
        if array.dtype.kind in "biuf":
            return np.atleast_1d(array).astype(np.float64) + 0.0  # without negative zeros
    return None


def _alpha(model: Any) -> NDArray[np.float64]:
    """Returns how opaque each geom is."""
    alpha = np.array(model.geom_rgba[:, 3], np.float64)
    of_material = model.geom_matid >= 0
    alpha[of_material] = model.mat_rgba[model.geom_matid[of_material], 3]
    return alpha


def _has_camera_sensor(model: Any) -> bool:
    """Returns whether a sensor depends on a camera."""
    camera = int(mujoco.mjtObj.mjOBJ_CAMERA)
    return bool((model.sensor_objtype == camera).any() or (model.sensor_reftype == camera).any())


def older_robot_checksum(environment: Any) -> str | None:
    """Returns the SHA-256 of the physical parameters of an environment's MuJoCo model, if any.

    They are those of the checksum of older records, which newer ones have beside the wider one of
    `robot_checksum`. They are rounded to six digits, so that other versions of MuJoCo compile the
    same model.
    """
    model = compiled_model(environment)
    if model is None:
        return None
    return _digest(_compared_fields(model))


def _compared_fields(model: Any) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yields name and values of each field of the older checksum."""
    for holder, names in ((model, _COMPARED.split()), (model.opt, _OPTIONS)):
        for name in names:
            values = np.asarray(getattr(holder, name), np.float64)
            yield name, np.atleast_1d(values) + 0.0  # without negative zeros
