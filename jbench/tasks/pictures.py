"""Pictures of the worlds of an environment, of whichever robot."""

import os
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench import opengl
from jbench.errors import RequestError
from jbench.tasks.task import Task
from jbench.tasks.worlds import ModelAndData, Worlds
from jbench.wording import in_prose

FREE = "free"
"""Name of the camera that sees the whole model, which every robot has."""

FREE_CAMERA = -1
"""Number of that camera."""


@dataclass(frozen=True)
class View:
    """How an environment is drawn.

    Attributes:
        mode: such as "rgb_array", or None for no pictures.
        camera: name of a camera of the model, or "free"; None for the task's, or the model's
            first, or the free one.
        width, height: of a picture, in pixels, at least 1; a world without MuJoCo physics draws
            itself, in a size of its own.
    """

    mode: str | None = None
    camera: str | None = None
    width: int = 640
    height: int = 480


class Pictures:
    """Draws the worlds of an environment, from the first call of `draw` on."""

    def __init__(self, task: Task, worlds: Worlds, view: View, modes: Collection[str]) -> None:
        """Finds the camera; RequestError if the mode is none of `modes`, or there is no such view.

        The worlds are those of the task.
        """
        if view.mode not in (None, *modes):
            raise RequestError(f"render_mode {view.mode!r} is not one of {in_prose(modes)}.")

        sides = (view.width, view.height)
        if not all(isinstance(side, int | np.integer) and side > 0 for side in sides):
            raise RequestError(
                "width and height must be whole numbers of pixels of at least 1, not "
                f"{view.width!r} and {view.height!r}."
            )

        self._task = task
        self._worlds = worlds
        self._view = view
        self._camera = FREE_CAMERA
        self._artists = dict[int, Artist]()  # by world
        if view.mode is None and view.camera is None:
            return
        if task.has_physics:
            self._camera = self._find_camera(view.camera or task.default_camera)
        else:
            self._check_own_pictures()

    def physics(self, world: int) -> ModelAndData:
        """Returns MuJoCo's model and data of a world; a RequestError if it has none."""
        physics = self._worlds.physics(world)
        if physics is None:
            raise RequestError(f"{self._task.name} has no MuJoCo physics.")
        return physics

    def draw(self, world: int) -> NDArray[np.uint8] | None:
        """Returns a picture (height, width, 3), or shows it in mode "human"; see `Artist.draw`."""
        view = self._view
        if view.mode is None:
            return None

        if not self._task.has_physics:
            return self._worlds.picture(world)

        return self._artist(world).draw(view.mode)

    def _artist(self, world: int) -> "Artist":
        """Returns what draws a world; worlds that share their data share it."""
        model, data = self.physics(world)
        artist = self._artists.get(world)
        if artist is not None and artist.data is data:
            return artist

        if artist is not None:  # of an environment that has made its model again
            artist.close()
        sharing = (other for other in self._artists.values() if other.data is data)
        artist = next(sharing, None)
        if artist is None:
            artist = Artist(model, data, self._camera, self._view.width, self._view.height)

        self._artists[world] = artist
        return artist

    def begin(self) -> None:
        """Frees what draws the last episode, if the next one may have another model or terrain."""
        if not self._artists:
            return
        if not self._task.has_one_model or self.physics(0).model.nhfield:
            self.close()

    def close(self) -> None:
        """Closes windows and frees renderers; the next picture makes them again."""
        for artist in self._artists.values():
            artist.close()
        self._artists.clear()

    def __getstate__(self) -> dict[str, Any]:
        """Returns what is copied: all but what draws."""
        return {**vars(self), "_artists": {}}

    def _check_own_pictures(self) -> None:
        """Raises a RequestError if worlds without physics can't be drawn, or not in this view."""
        name = self._task.name
        if self._view.mode == "human":
            raise RequestError(
                f"{name} has no MuJoCo physics to show in a window; render_mode='rgb_array' "
                "returns the pictures that it draws itself."
            )
        if self._view.mode is not None:
            self._worlds.prepare_pictures()
        if self._view.camera is not None:
            raise RequestError(
                f"{name} has no camera {self._view.camera}: it draws itself; leave the camera out."
            )

    def _find_camera(self, name: str | None) -> int:
        """Returns the number of a camera; None is the model's first, or the free one."""
        model = self.physics(0).model
        cameras = [model.camera(number).name for number in range(model.ncam)]
        if name is None:
            return 0 if cameras else FREE_CAMERA
        if name in cameras:
            return cameras.index(name)
        if name == FREE:
            return FREE_CAMERA
        raise RequestError(
            f"{self._task.name} has no camera {name}; it has {in_prose([*cameras, FREE])}."
        )


class Artist:
    """Draws a model and its data in a window or as pictures, from the first call of `draw` on.

    Attributes:
        data: that is drawn.
    """

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
        self.data = data
        # Drawn in its place, since what is computed for a picture would change the episode: rewards
        # and observations of some robots have positions from before the last physics step.
        self._drawn = mujoco.MjData(model)
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

        mujoco.mj_copyData(self._drawn, self._model, self.data)
        # Positions of bodies and cameras are those before the last physics step.
        mujoco.mj_forward(self._model, self._drawn)
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
            self._drawn,
            width=self._width,
            height=self._height,
            camera_id=self._camera,
        )
