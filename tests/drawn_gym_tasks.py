"""Gymnasium environments without MuJoCo physics that draw themselves, or fail to."""

import gymnasium
import numpy as np
from gymnasium.error import DependencyNotInstalled

from tests.gym_tasks import EPISODE, Cart, limited


class Drawn(Cart):
    """Draws its cart as a red column on white, 25 pictures per second, and may leave its rail."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 25}  # noqa: RUF012

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def has_fallen(self):
        return abs(float(self.state[0])) > 1.5

    def render(self):
        if self.render_mode is None:
            return None
        picture = np.full((24, 40, 3), 255, np.uint8)
        column = int(np.clip(20 + 10 * self.state[0], 0, 39))
        picture[:, column] = [255, 0, 0]
        return picture


class Narrows(Drawn):
    """Draws half of the width from the second picture of an environment on."""

    has_drawn = False

    def render(self):
        picture = super().render()
        shown = picture[:, 10:30] if self.has_drawn else picture
        self.has_drawn = True
        return shown


class RendersNoPixel(Drawn):
    def render(self):
        return np.zeros((0, 40, 3), np.uint8)


class WithoutMode(Drawn):
    metadata = {"render_modes": []}  # noqa: RUF012


class RendersNothing(Drawn):
    def render(self):
        return None


class RendersNumbers(Drawn):
    def render(self):
        return np.zeros((4, 4))


class RendersError(Drawn):
    def render(self):
        raise ValueError("no such color")


class LacksPackage(Drawn):
    def render(self):
        raise DependencyNotInstalled("paint is not installed, run `pip install paint`")


class Licensed(Drawn):
    """Takes a license when it is made, and returns it when it is closed."""

    licenses = 2
    taken = 0

    def __init__(self, render_mode=None):
        if Licensed.taken == Licensed.licenses:
            raise OSError("no license is free")
        Licensed.taken += 1
        super().__init__(render_mode)

    def close(self):
        Licensed.taken -= 1


def maker(kind):
    """Returns a function that makes an environment in a render mode."""
    return lambda render_mode=None: limited(lambda: kind(render_mode))()


drawn = maker(Drawn)
narrows = maker(Narrows)
licensed = maker(Licensed)
no_pixel = maker(RendersNoPixel)
without_mode = maker(WithoutMode)
nothing = maker(RendersNothing)
numbers = maker(RendersNumbers)
error = maker(RendersError)
lacks_package = maker(LacksPackage)
takes_no_mode = limited(Drawn)


def draws_always():
    """Takes no render mode, and has one."""
    return limited(lambda: Drawn("rgb_array"))()


def lacks_simulator():
    raise DependencyNotInstalled("paint is not installed, run `pip install paint`")


gymnasium.register("lab/Drawn-v0", "tests.drawn_gym_tasks:Drawn", max_episode_steps=EPISODE)
