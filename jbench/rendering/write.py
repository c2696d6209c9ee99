"""Writing an episode as a video, an animation, or a strip of images."""

import contextlib
import importlib.util
import io
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from jbench.errors import RequestError, WorkError
from jbench.policies.find import ActingPolicy
from jbench.rendering import episode
from jbench.rendering.episode import Frame, Picture, Scene, render_episode
from jbench.store.files import check_output, write_atomic
from jbench.tasks.find import find_task
from jbench.wording import in_prose

SUFFIXES = (".mp4", ".gif", ".png")  # supported file suffixes: video, animation, strip of images

_INTERVAL = 0.04  # s between the images of a video or an animation, before rounding to steps
_MOMENTS = 6  # images in a strip
_PALETTE_PICTURES = 8  # from which an animation's palette is computed
_GIF_TICK = 0.01  # s, in which a GIF counts time
_VIDEO_QUALITY = 8  # out of 10; a minute of 640 x 480 pixels takes about 10 MB


def default_size(path: Path) -> tuple[int, int]:
    """Returns the default width and height (pixels) for a file's suffix."""
    if path.suffix.lower() == ".png":
        return 320, 240
    return 640, 480


def _check(path: Path) -> None:
    """Raises a RequestError if a picture or video can't be written there."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise RequestError(
            f"--out {path}: nothing writes such files; end the name in {in_prose(SUFFIXES)}."
        )

    # Gymnasium's renderer imports imageio, too.
    needed = ["imageio"]
    if suffix == ".mp4":
        needed.append("imageio_ffmpeg")

    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        raise RequestError(
            f"{suffix} needs {' and '.join(missing)}: type pip install 'jbench[render]'."
        )

    check_output(path)


def render_to_file(
    policy: ActingPolicy,
    scene: Scene,
    path: Path,
    *,
    name: str,
    speed: float = 1.0,
    steps: int | None = None,
    progress: Callable[[int], object] = lambda steps: None,
) -> Frame:
    """Writes an episode in the format of the file's suffix; returns the last frame.

    Raises a RequestError if the file can't be written, and a WorkError if the disk fails.

    Args:
        name: of the policy, for the text in a video or an animation.
        speed: of a video or an animation, a multiple of 0.25: 1 for real time.
        steps: control steps to show; None for the whole episode.
        progress: called with the number of completed control steps.
    """
    _check(path)
    suffix = path.suffix.lower()
    is_strip = suffix == ".png"
    task = find_task(scene.task)
    if steps is None:
        steps = task.episode_steps

    stride = max(1, round(speed * _INTERVAL / scene.timestep))
    seconds = stride * scene.timestep / speed  # between two images
    if is_strip:  # whose images are equally spaced, with the first and last
        moments = np.linspace(0, steps, min(_MOMENTS, steps + 1)).round().astype(int).tolist()
        draw: Callable[[Frame], Picture] = episode.strip_picture
    else:
        moments = [*range(0, steps, stride), steps]
        title = f"{scene.task}, {name}"
        draw = partial(episode.video_picture, title=title, note=_note(scene, speed))

    # Only the last frame is kept, since a long video would fill the memory.
    last_frame: list[Frame] = []

    def pictures() -> Iterator[Picture]:
        for frame in render_episode(policy, scene, moments, progress):
            last_frame[:] = [frame]
            yield draw(frame)

    if suffix == ".mp4":
        content = mp4(pictures(), seconds)
    elif suffix == ".gif":
        content = gif(list(pictures()), seconds)
    else:
        buffer = io.BytesIO()
        Image.fromarray(np.hstack(list(pictures()))).save(buffer, "PNG", optimize=True)
        content = buffer.getvalue()

    write_atomic(path, content)
    return last_frame[0]


def _note(scene: Scene, speed: float) -> str:
    """Returns the note in a video: its camera, its scale and its speed, if there is one to say."""
    task = find_task(scene.task)
    notes = []
    camera = scene.camera or task.default_camera
    if camera:
        notes.append(f"{camera} camera")
    if task.scale:
        notes.append(task.scale)
    if speed != 1:
        notes.append(f"{speed:g} x real time")

    return ", ".join(notes)


def gif(pictures: Sequence[Picture], seconds: float = _INTERVAL) -> bytes:
    """Returns a looping animation of images (height, width, 3), some seconds apart.

    A GIF counts time in hundredths of a second: images are shown for different times, if their
    distance is none, so that the whole animation lasts as long as it should.
    """
    indices = np.linspace(0, len(pictures) - 1, min(_PALETTE_PICTURES, len(pictures))).astype(int)
    sample = Image.fromarray(np.vstack([pictures[index] for index in indices]))
    palette = sample.quantize(256, method=Image.Quantize.MEDIANCUT)
    # Dithering would flicker and make the file three times as large.
    images = [
        Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)
        for picture in pictures
    ]
    ends = np.round(np.arange(len(pictures) + 1) * seconds / _GIF_TICK).astype(int)
    durations = (np.diff(ends) * round(1000 * _GIF_TICK)).tolist()  # ms
    buffer = io.BytesIO()
    later = {"save_all": True, "append_images": images[1:], "duration": durations}
    images[0].save(buffer, "GIF", loop=0, optimize=True, **later)
    return buffer.getvalue()


def mp4(pictures: Iterator[Picture], seconds: float = _INTERVAL) -> bytes:
    """Returns an H.264 video that any browser plays, of pictures some seconds apart.

    Odd sizes are padded by repeating the last row or column. Raises a RequestError if the library
    has no ffmpeg for this machine, and a WorkError if ffmpeg failed.
    """
    import imageio.v2
    import imageio_ffmpeg

    try:
        imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError:
        raise RequestError(
            "imageio-ffmpeg has no ffmpeg for this machine: install ffmpeg, or name a .gif."
        ) from None

    options: dict[str, Any] = {
        "fps": 1 / seconds,
        "codec": "libx264",
        "quality": _VIDEO_QUALITY,
        "macro_block_size": 2,  # colors are per 2 x 2 pixels
        "ffmpeg_log_level": "error",
        # The index comes first, so that the video plays while it loads.
        "output_params": ["-movflags", "+faststart"],
    }
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "video.mp4"
        try:
            with contextlib.closing(imageio.v2.get_writer(path, **options)) as writer:
                for picture in pictures:
                    odd = [(0, size % 2) for size in picture.shape[:2]]
                    writer.append_data(np.pad(picture, [*odd, (0, 0)], mode="edge"))
        except OSError as error:
            raise WorkError(f"ffmpeg failed: {str(error).splitlines()[0]}.") from None

        if not path.exists():
            raise WorkError("ffmpeg wrote nothing; its messages are above.")
        return path.read_bytes()
