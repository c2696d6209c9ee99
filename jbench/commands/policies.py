"""Commands that run a policy: evaluate, render, view."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Option

from jbench import names, task_specs, typed_values
from jbench.commands import options, output, parsing
from jbench.errors import RequestError
from jbench.numbers import whole
from jbench.settings.base import in_id
from jbench.settings.records import EvaluationSettings
from jbench.wording import counted

if TYPE_CHECKING:
    from jbench.array_types import FloatArray
    from jbench.store import Results

_TURN = 360  # degrees; a float has no digits for the direction of a huge angle

_POSE_SEED = options.whole_number(
    0, unit="SEED", most=names.MAX_SEED, help="Random seed of the pose and the target."
)


@options.with_settings(EvaluationSettings, "episodes", "seed", "states", "augment")
def evaluate(
    policy: str | None = options.POLICY,
    task: str | None = options.POLICY_TASK,
    target_yaw: float | None = options.number(
        None, unit="DEGREES", help="Target's yaw (default: random)."
    ),
    threads: int = options.THREADS,
    accept_changed_code: bool = options.ACCEPT_CHANGED_CODE,
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
    **chosen: Any,
) -> None:
    """Run episodes of any policy and save their returns."""
    from jbench.policies.code import policy_code, policy_provenance
    from jbench.policies.evaluate import evaluate as run_episodes
    from jbench.policies.evaluate import plan_evaluation
    from jbench.policies.sb3_zip import is_sb3_zip, recorded_name
    from jbench.settings.base import validated
    from jbench.sources import checksum
    from jbench.tasks.find import find_task

    if target_yaw is not None and not abs(target_yaw) <= _TURN:
        raise RequestError(
            f"--target-yaw {target_yaw:g}: type degrees from -{_TURN} to {_TURN}, such as 45."
        )

    database, policy, task = _find(results, policy, task, chosen["augment"], "face_direction")
    about = find_task(task)
    if target_yaw is not None:
        target_yaw = math.radians(target_yaw)

    saved_as = policy
    if is_sb3_zip(policy):
        saved_as = recorded_name(policy)

    settings = validated(
        EvaluationSettings,
        "the evaluation",
        task=task,
        specs=about.specs,
        policy=saved_as,
        target_yaw=target_yaw,
        code=policy_code(policy),
        sources=checksum(policy_provenance(policy).get("sources", {})),
        accepted=accepted_code(database, policy, accept_changed_code),
        **chosen,
    )
    settings = plan_evaluation(settings, database, policy).settings
    before = database.find("evaluation", settings.id)
    if before is not None and before.is_finished:
        output.say(f"The evaluation {settings.id} is already finished; nothing to do.")

    output.if_stopped("The episodes are not kept; the same command runs them again.")
    total = settings.episodes * settings.episode_steps
    with output.progress(f"evaluate {policy} {task}", total, "control steps") as progress:
        record = run_episodes(settings, database, threads, progress, policy)

    returns = record.read("policy_episodes")["episode_return"]
    summary = record.manifest.summary
    words = _returns_in_words(returns.to_numpy(), summary)
    output.say(f"{task}, {policy}: {words}{mark(settings.accepted)}; saved in {record.path}")
    output.document(output.described(record))


def _returns_in_words(returns: "FloatArray", summary: Mapping[str, float]) -> str:
    """Returns a sentence on the returns of episodes (episodes,); `summary` has their quantiles."""
    tails = ""
    if len(returns) > 9:
        tails = f" [10th {whole(summary['q10'])}, 90th {whole(summary['q90'])}]"

    return (
        f"mean return {whole(returns.mean())}, median {whole(summary['median'])}{tails}, "
        f"worst {whole(returns.min())}, over {counted(len(returns), 'episode')}"
    )


def render(
    policy: str | None = options.POLICY,
    out: Path | None = Option(
        None,
        parser=parsing.path,
        metavar="FILE",
        help="File: FILE.mp4, FILE.gif, or FILE.png, a strip of frames (default: jitterbug.mp4, or "
        "of another robot, TASK.mp4).",
    ),
    task: str | None = options.POLICY_TASK,
    camera: str | None = Option(
        None,
        help=f"Camera: {', '.join(task_specs.CAMERAS)} (default: tracking), or one of another "
        "robot's model (default: its first), or free for one that sees all of it.",
        autocompletion=lambda: task_specs.CAMERAS,
    ),
    seed: int = _POSE_SEED,
    steps: int | None = options.whole_number(
        None, unit="STEPS", least=1, help="Control steps (default: the whole episode)."
    ),
    augment: int | None = options.AUGMENT,
    accept_changed_code: bool = options.ACCEPT_CHANGED_CODE,
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """Render an episode of any policy as a video or a picture."""
    from jbench.opengl import backend_failure

    failure = backend_failure()
    from jbench.policies.find import find_policy
    from jbench.rendering.episode import Scene
    from jbench.rendering.write import default_size, render_to_file
    from jbench.tasks.find import find_task
    from jbench.tasks.pictures import FREE

    database, policy, task = _find(results, policy, task, augment, "move_to_pose")
    about = find_task(task)
    if failure is not None and about.has_physics:
        raise failure
    if camera is not None and about.cameras is not None:
        typed_values.known("camera", camera, (*about.cameras, FREE))

    if out is None:
        out = Path(video_name(about.robot))

    length = about.episode_steps
    if steps is None:
        steps = length
    if steps > length:
        raise RequestError(f"--steps {steps}: an episode of {task} has {length} control steps.")

    scene = Scene(task, seed, camera, *default_size(out), augment)
    runner = find_policy(database, policy, task, seed, accept_changed_code)
    with output.progress(f"render {policy} {task}", steps, "control steps") as progress:
        last = render_to_file(runner, scene, out, name=policy, steps=steps, progress=progress)

    accepted = accepted_code(database, policy, accept_changed_code)
    output.say(f"{out}: {last.time:.1f} s, return {whole(last.episode_return)}{mark(accepted)}")
    output.document({"path": str(out), "episode_return": last.episode_return, "accepted": accepted})


def video_name(robot: str) -> str:
    """Returns the name of the file of a video, if the user typed none; see `Task.robot`."""
    return f"{in_id(robot).replace('/', '.')}.mp4"


def view(
    policy: str | None = options.POLICY,
    task: str | None = options.POLICY_TASK,
    seed: int = _POSE_SEED,
    augment: int | None = options.AUGMENT,
    accept_changed_code: bool = options.ACCEPT_CHANGED_CODE,
    results: Path = options.READ_RESULTS,
) -> None:
    """Watch a policy in MuJoCo's interactive viewer.

    It needs a desktop.
    """
    from jbench.policies.find import find_policy
    from jbench.rendering.episode import Scene
    from jbench.rendering.viewer import view as open_viewer

    database, policy, task = _find(results, policy, task, augment, "move_to_pose")
    runner = find_policy(database, policy, task, seed, accept_changed_code)
    steps = open_viewer(runner, Scene(task, seed, augment=augment))
    output.say(f"Watched {steps} control steps.")


def accepted_code(database: "Results", policy: str, accept_changed: bool) -> str | None:
    """Returns a checksum of a policy's code if it has changed, and the user accepts that."""
    from jbench.policies.code import changed_code

    if not accept_changed:
        return None
    return changed_code(database, policy)


def mark(accepted: str | None) -> str:
    """Returns what stands beside the results of code that has changed."""
    return "" if accepted is None else ", with changed code"


def _find(
    results: Path, policy: str | None, task: str | None, augment: int | None, default_task: str
) -> tuple["Results", str, str]:
    """Returns the results, the policy's full name, and the task.

    The task is the one that was typed, or trained on, or the default. Prints notes on it, and if
    the robot is not one that the agent was trained on.
    """
    from jbench.policies.find import full_name
    from jbench.tasks.find import checked_task

    if policy is None:
        policy = names.HEURISTIC

    database, name = database_and_policy(results, policy)
    name, run = full_name(database, name)
    if task is not None:
        output.note_task(checked_task(task))
    elif run is not None:
        task = run.task

    if run is not None and isinstance(run.augment, int):
        trained_on = range(run.augment, run.augment + run.robots)
        if augment not in trained_on:
            _note_robot(name, augment, trained_on)

    return database, name, task or default_task


def _note_robot(policy: str, augment: int | None, trained_on: range) -> None:
    """Prints that a policy runs on another robot than the augmented ones of its training."""
    robot = "the plain robot"
    if augment is not None:
        robot = f"the augmented robot {augment}"

    last = trained_on[-1]
    seeds = f"{trained_on[0]} to {last}"
    its_robot = "its last robot"
    if len(trained_on) == 1:
        seeds = f"{last}"
        its_robot = "its robot"

    output.say(
        f"Note: {policy} was trained on augmented robot {seeds}, but this is {robot}; "
        f"type --augment {last} for {its_robot}."
    )


def database_and_policy(results: Path, policy: str) -> tuple["Results", str]:
    """Returns writable results, and the policy's name: reference/ID with `--results reference`."""
    from jbench.policies.located import SHIPPED

    is_run = "/" in policy and not policy.startswith(SHIPPED)
    if is_run and names.is_reference(results):
        policy = f"{SHIPPED}{policy}"

    return parsing.results_to_write(parsing.writable(results)), policy
