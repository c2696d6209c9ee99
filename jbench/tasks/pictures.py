"""Pictures of MuJoCo models, of whichever robot."""

import os
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench import opengl
from jbench.errors import RequestError

FREE_CAMERA = -1


class Artist:
    """Draws a model and its data in a window or as pictures, from the first call of `draw` on."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, camera: int, width: int, height: int
    ) -> None:
        """Enlarges the model's offscreen buffer if necessary.

        Args:
            camera: number of a camera of the model, or `FREE_CAMERA`.
            width, height: of a picture, in pixels.
        """
        # Pixels outside the offscreen buffer would be black.
        buffer = model.vis.global_
        buffer.offwidth = max(buffer.offwidth, width)
        buffer.offheight = max(buffer.offheight, height)
        self._model = model
        self._data = data
        self._camera = camera
        self._width = width
        self._height = height
        self._renderer: Any = None

    def draw(self, mode: str) -> NDArray[np.uint8] | None:
        """Returns a picture (height, width, 3) in mode "rgb_array", or shows it in mode "human".

        Raises:
            RequestError: if MUJOCO_GL names no backend and none works, or if there is no display
                for "human"; a ValueError.
        """
        if self._renderer is None:
            self._renderer = self._make(mode)

        # Positions of bodies and cameras are those before the last physics step.
        mujoco.mj_forward(self._model, self._data)
        # Another robot may have made its own context current.
        self._renderer._get_viewer(mode).make_context_current()
        picture = self._renderer.render(mode)
        # Gymnasium returns a view with negative strides, which torch refuses.
        return None if picture is None else np.ascontiguousarray(picture)

    def close(self) -> None:
        """Closes windows and frees the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _make(self, mode: str) -> Any:
        """Returns a renderer of MuJoCo, or a RequestError that says what it lacks."""
        if mode == "human":
            # Gymnasium's window would end the process.
            if not opengl.open_display():
                raise RequestError(
                    "There is no display to open a window on; render_mode='rgb_array' draws "
                    "without one."
                )
        elif os.environ.get("MUJOCO_GL", "").strip().lower() in ("", *opengl.OFF):
            opengl.choose_backend()

        # Deferred, since this import looks for a window system.
        from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer

        return MujocoRenderer(
            self._model,
            self._data,
            width=self._width,
            height=self._height,
            camera_id=self._camera,
        )
