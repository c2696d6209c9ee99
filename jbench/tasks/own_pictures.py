"""Pictures of an environment: of its MuJoCo physics, or those that its own `render` returns."""

from typing import Any

import mujoco
import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from jbench.errors import ERRORS_OF_OTHERS, RequestError, sentence_of_failure
from jbench.tasks.gym_as_dm_env import GymAsDmEnv
from jbench.tasks.robot_checksum import compiled_model
from jbench.tasks.worlds import ModelAndData

RENDER_MODE = "rgb_array"
"""Gymnasium's name of the mode in which `render` returns a picture."""


def mujoco_physics(environment: Any) -> ModelAndData | None:
    """Returns MuJoCo's model and data of an environment, if it has them."""
    model = compiled_model(environment)
    data = getattr(getattr(environment, "physics", None), "data", None)
    data = getattr(data, "ptr", data)  # which dm_control wraps and Gymnasium does not
    if model is not None and isinstance(data, mujoco.MjData):
        return ModelAndData(model, data)
    return None


def render_fps(environment: Any) -> float | None:
    """Returns the pictures per second, one for each control step, that an environment names."""
    if not isinstance(environment, GymAsDmEnv):
        return None
    fps = (environment.env.metadata or {}).get("render_fps")
    return float(fps) if isinstance(fps, int | float) and 0 < fps < np.inf else None


def check_can_draw(task: str, environment: Any) -> None:
    """Raises a RequestError if an environment without physics has no pictures of its own."""
    if not isinstance(environment, GymAsDmEnv):
        raise RequestError(
            f"{task} can't be drawn: it has no MuJoCo physics; return a gymnasium.Env whose render "
            "draws it."
        )

    env = environment.env
    modes = (env.metadata or {}).get("render_modes") or ()
    if RENDER_MODE not in modes and env.render_mode != RENDER_MODE:
        raise RequestError(
            f"{task} can't be drawn: it has no MuJoCo physics, and its metadata['render_modes'] "
            f"lacks {RENDER_MODE!r}; add that, and let its render return a picture."
        )


def check_draws(task: str, environment: GymAsDmEnv) -> None:
    """Raises a RequestError if an environment that can draw was made without its pictures."""
    mode = environment.env.render_mode
    if mode != RENDER_MODE:
        raise RequestError(
            f"{task} can't be drawn: its render_mode is {mode!r}; give its function the argument "
            f"render_mode, for which jbench passes {RENDER_MODE!r}."
        )


def own_picture(task: str, environment: GymAsDmEnv) -> NDArray[np.uint8]:
    """Returns the picture (height, width, 3) of an environment as a new array.

    Raises a RequestError if its `render` fails, lacks a package, or returns anything else.
    """
    try:
        returned: Any = environment.env.render()
    except DependencyNotInstalled as error:
        raise RequestError(f"{task} can't be drawn: {str(error).rstrip('.')}.") from None
    except ERRORS_OF_OTHERS as error:
        raise RequestError(
            f"{task} can't be drawn: its render fails ({sentence_of_failure(error)})."
        ) from error

    is_array = isinstance(returned, np.ndarray)
    if is_array and _is_picture(returned):
        return np.array(returned, order="C")

    found = type(returned).__name__
    if is_array:
        found = f"an array {returned.shape} of {returned.dtype}"
    raise RequestError(
        f"{task} can't be drawn: its render returns {found}, not an array (height, width, 3) of "
        "uint8."
    )


def _is_picture(returned: NDArray[Any]) -> bool:
    """Returns whether an array is (height, width, 3) of uint8, with one pixel or more."""
    has_three_colors = returned.ndim == 3 and returned.shape[2] == 3
    return has_three_colors and returned.dtype == np.uint8 and returned.size > 0
