"""Writing an episode as a video, an animation, or a strip of images."""

import importlib.util
import io
import itertools
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from jbench.errors import RequestError, WorkError
from jbench.names import EPISODE_STEPS
from jbench.policies.find import ActingPolicy
from jbench.rendering.episode import (
    Frame,
    Picture,
    Scene,
    render_episode,
    strip_steps,
    video_steps,
)
from jbench.rendering.overlay import strip_picture, video_picture
from jbench.store.files import make_directory, write_atomic

SUFFIXES = (".mp4", ".gif", ".png")
"""Supported file suffixes: video, animation, strip of images."""

_VIDEO_SIZE = (640, 480)
_MOMENT_SIZE = (320, 240)

# Browsers slow down animations with shorter intervals (s).
_MIN_GIF_INTERVAL = 0.02

# Images from which an animation's palette is computed.
_PALETTE_PICTURES = 8

# Out of 10; a minute of 640 x 480 pixels takes about 10 MB.
_VIDEO_QUALITY = 8


@dataclass(frozen=True)
class Rendered:
    """A written file.

    Attributes:
        pictures: number of images.
        seconds: simulated time from the start of the episode to the last image.
        episode_return: at the last image.
    """

    path: Path
    pictures: int
    seconds: float
    episode_return: float


def default_size(path: Path) -> tuple[int, int]:
    """Returns the default width and height (pixels) for a file's suffix."""
    return _MOMENT_SIZE if path.suffix.lower() == ".png" else _VIDEO_SIZE


def check_output(path: Path) -> None:
    """Checks that a file can be written, before anything is simulated.

    Raises:
        RequestError: if the suffix is not in `SUFFIXES`, a library is missing, or the directory is
            not writable.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise RequestError(
            f"--out {path}: nothing writes such files; end the name in {', '.join(SUFFIXES)}."
        )
    # Gymnasium's renderer imports imageio, too.
    needed = ("imageio", "imageio_ffmpeg") if suffix == ".mp4" else ("imageio",)
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        raise RequestError(
            f"{suffix} needs {' and '.join(missing)}: type pip install 'jbench[render]'."
        )
    make_directory(path.parent)
    if path.is_dir():
        raise RequestError(f"--out {path} is a directory; name a file.")


def render_to_file(
    policy: ActingPolicy,
    scene: Scene,
    path: Path,
    *,
    name: str,
    frames_per_second: float = 25,
    speed: float = 1.0,
    moments: int = 6,
    steps: int = EPISODE_STEPS,
    progress: Callable[[int], object] = lambda steps: None,
) -> Rendered:
    """Writes an episode of a policy as a video, an animation, or a strip of images.

    Args:
        path: of the file; its suffix determines the format.
        frames_per_second: of a video or an animation.
        speed: of a video or an animation: 1 for real time, 0.5 for half speed.
        moments: number of images in a strip.
        steps: control steps to show.
        progress: called with the number of completed control steps.

    Raises:
        RequestError: if the file can't be written.
        WorkError: if the disk is full or fails.
    """
    check_output(path)
    suffix = path.suffix.lower()
    at: Collection[int]
    if suffix == ".png":
        at, interval = strip_steps(moments, steps), 0.0
    else:
        at, interval = video_steps(frames_per_second, speed, steps)
    if suffix == ".gif":
        _check_gif(interval)
    title, note = f"{scene.task}, {name}", f"{scene.camera} camera"
    if speed != 1:
        note += f", {speed:g} x real time"
    last_frame: list[Frame] = []

    def pictures() -> Iterator[Picture]:
        for frame in render_episode(policy, scene, at, progress):
            # Only the last frame is kept, since a long video would fill the memory.
            last_frame[:] = [frame]
            is_strip = suffix == ".png"
            yield strip_picture(frame) if is_strip else video_picture(frame, title, note)

    if suffix == ".mp4":
        content = mp4(pictures(), (scene.width, scene.height), interval)
    elif suffix == ".gif":
        content = gif(list(pictures()), interval)
    else:
        content = png_strip(list(pictures()))
    write_atomic(path, content)
    return Rendered(path, len(at), last_frame[0].time, last_frame[0].episode_return)


def _check_gif(interval: float) -> None:
    if interval < _MIN_GIF_INTERVAL:
        raise RequestError(
            f"No .gif of {1 / interval:g} frames a second; it has at most "
            f"{1 / _MIN_GIF_INTERVAL:g}."
        )


def png_strip(pictures: Sequence[Picture]) -> bytes:
    """Returns a PNG with images (height, width, 3) side by side."""
    buffer = io.BytesIO()
    Image.fromarray(np.hstack(pictures)).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def gif(pictures: Sequence[Picture], interval: float) -> bytes:
    """Returns a looping animation.

    Args:
        pictures: (height, width, 3) each, all of the same size.
        interval: seconds between images. The file counts hundredths, so single images may be
            shown a hundredth longer or shorter, but the whole has the right length.
    """
    indices = np.linspace(0, len(pictures) - 1, min(_PALETTE_PICTURES, len(pictures))).astype(int)
    sample = Image.fromarray(np.vstack([pictures[index] for index in indices]))
    palette = sample.quantize(256, method=Image.Quantize.MEDIANCUT)
    # Dithering would flicker and make the file three times as large.
    images = [
        Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)
        for picture in pictures
    ]
    starts = [round(100 * interval * number) for number in range(len(images) + 1)]
    buffer = io.BytesIO()
    images[0].save(
        buffer,
        "GIF",
        save_all=True,
        append_images=images[1:],
        duration=[10 * (end - start) for start, end in itertools.pairwise(starts)],
        loop=0,
        optimize=True,
    )
    return buffer.getvalue()


def mp4(pictures: Iterator[Picture], size: tuple[int, int], interval: float) -> bytes:
    """Returns an H.264 video that any browser plays.

    Args:
        pictures: (height, width, 3) each; odd sizes are padded by repeating the last row or column.
        size: width and height (pixels).
        interval: seconds between images.

    Raises:
        RequestError: if the library has no ffmpeg for this machine.
        WorkError: if ffmpeg failed.
    """
    import imageio_ffmpeg

    try:
        imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError:
        raise RequestError(
            "imageio-ffmpeg has no ffmpeg for this machine: install ffmpeg, or name a .gif."
        ) from None
    odd = (size[0] % 2, size[1] % 2)
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "video.mp4"
        writer = imageio_ffmpeg.write_frames(
            str(path),
            (size[0] + odd[0], size[1] + odd[1]),
            fps=1 / interval,
            codec="libx264",
            quality=_VIDEO_QUALITY,
            macro_block_size=2,  # colours are stored per 2 x 2 pixels
            ffmpeg_log_level="error",
            # The index comes first, so that the video plays while it loads.
            output_params=["-movflags", "+faststart"],
        )
        writer.send(None)
        try:
            for picture in pictures:
                writer.send(np.pad(picture, ((0, odd[1]), (0, odd[0]), (0, 0)), mode="edge"))
        except OSError as error:
            raise WorkError(f"ffmpeg failed: {str(error).splitlines()[0]}.") from None
        finally:
            writer.close()
        if not path.exists():
            raise WorkError("ffmpeg wrote nothing; its messages are above.")
        return path.read_bytes()
