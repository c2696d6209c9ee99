"""Draws the pictures of the README: python docs/images/draw.py, headless or on a desktop."""

from pathlib import Path

from jbench.opengl import choose_backend

HERE = Path(__file__).parent

# The target of this episode stays in view of the fixed camera.
SEED = 5

# Of the portrait: pixels, and how many times larger it is drawn for smooth edges.
WIDTH, HEIGHT, FINER = 1280, 720, 2


def portrait() -> None:
    """Draws the robot from nearby, on the floor of 1 cm checks."""
    import mujoco
    from PIL import Image

    from jbench.tasks import model
    from jbench.tasks.robots import load_model

    robot = load_model()
    robot.vis.global_.offwidth, robot.vis.global_.offheight = FINER * WIDTH, FINER * HEIGHT
    robot.vis.global_.fovy = 26
    robot.body("target").pos = [0, 0, -1]  # below the floor: out of sight
    data = mujoco.MjData(robot)
    model.place(data, [1, 0, 0, 0])
    for _ in range(5000):  # a second, in which its springy legs come to rest
        mujoco.mj_step(robot, data)
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance = [0, 0.004, 0.0315], 0.205
    camera.azimuth, camera.elevation = 191, -18
    with mujoco.Renderer(robot, FINER * HEIGHT, FINER * WIDTH) as renderer:
        renderer.update_scene(data, camera)
        drawn = Image.fromarray(renderer.render())
    drawn.resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS).save(HERE / "robot.png", optimize=True)


def episodes() -> None:
    """Draws the hand-written policy of move_to_pose as an animation and as a strip."""
    from jbench.rendering.episode import Scene
    from jbench.rendering.write import render_to_file
    from jbench.tasks.heuristics import heuristic

    policy, task = heuristic("move_to_pose"), "move_to_pose"
    scene = Scene(task, seed=SEED, camera="spectator", width=480, height=360)
    path = HERE / "move_to_pose.gif"
    render_to_file(policy, scene, path, name="heuristic", speed=0.5, steps=400)
    scene = Scene(task, seed=SEED, camera="spectator", width=320, height=240)
    render_to_file(policy, scene, HERE / "strip.png", name="heuristic", steps=250)


if __name__ == "__main__":
    choose_backend()
    portrait()
    episodes()
