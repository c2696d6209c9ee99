"""Draws the portrait of the README: python docs/images/draw.py, headless or on a desktop."""

from pathlib import Path

from jbench.opengl import choose_backend

HERE = Path(__file__).parent

# Of the portrait: pixels, and how many times larger it is drawn for smooth edges.
WIDTH, HEIGHT, FINER = 1280, 720, 2


def portrait() -> None:
    """Draws the robot from nearby, on the floor of 1 cm checks."""
    import mujoco
    import numpy as np
    from PIL import Image

    from jbench.tasks.jitterbug import model
    from jbench.tasks.jitterbug.robots import load_model

    robot = load_model()
    robot.vis.global_.offwidth, robot.vis.global_.offheight = FINER * WIDTH, FINER * HEIGHT
    robot.vis.global_.fovy = 26
    robot.body("target").pos = [0, 0, -1]  # below the floor: out of sight
    data = mujoco.MjData(robot)
    model.place(data, np.array([1.0, 0.0, 0.0, 0.0]))
    for _ in range(5000):  # a second, in which its springy legs come to rest
        mujoco.mj_step(robot, data)
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance = [0, 0.004, 0.0315], 0.205
    camera.azimuth, camera.elevation = 191, -18
    with mujoco.Renderer(robot, FINER * HEIGHT, FINER * WIDTH) as renderer:
        renderer.update_scene(data, camera)
        drawn = Image.fromarray(renderer.render())
    drawn.resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS).save(HERE / "robot.png", optimize=True)


if __name__ == "__main__":
    choose_backend()
    portrait()
