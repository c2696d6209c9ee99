"""An episode as a file: a video, an animation, or a strip of moments."""

import importlib.util
import io
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

ENDINGS = (".mp4", ".gif", ".png")
"""What a file's name may end in: a video, an animation, a strip of moments."""

_VIDEO_SIZE = (640, 480)
_MOMENT_SIZE = (320, 240)

# Browsers slow down animations with a shorter time between their pictures (s).
_SHORTEST_GIF_INTERVAL = 0.02

# Pictures from which an animation's colours are chosen.
_PALETTE_PICTURES = 8

# Of 10; a minute of 640 x 480 pixels takes about 10 MB.
_VIDEO_QUALITY = 8


@dataclass(frozen=True)
class Rendered:
    """What was written.

    Attributes:
        path: of the file.
        pictures: number of them in it.
        seconds: of the episode that it shows.
        episode_return: at the end of what it shows.
    """

    path: Path
    pictures: int
    seconds: float
    episode_return: float


def default_size(path: Path) -> tuple[int, int]:
    """Returns width and height (pixels) of a picture that suit a file's ending."""
    return _MOMENT_SIZE if path.suffix.lower() == ".png" else _VIDEO_SIZE


def check_output(path: Path) -> None:
    """Checks that a file of this name can be written, before anything is simulated.

    Raises:
        RequestError: if its ending is none of `ENDINGS`, a library is missing, or it lies where
            nothing may be written.
    """
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise RequestError(
            f"--out {path}: nothing writes such files; end the name in {', '.join(ENDINGS)}."
        )
    # Gymnasium's renderer imports imageio, too.
    needed = ("imageio", "imageio_ffmpeg") if ending == ".mp4" else ("imageio",)
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        raise RequestError(
            f"{ending} needs {' and '.join(missing)}: type pip install 'jbench[render]'."
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
    """Writes an episode of a policy as a video, an animation, or a strip of moments.

    Args:
        policy: for plain observations of the task.
        scene: which episode, and how to look at it.
        path: of the file; its ending, one of `ENDINGS`, says which.
        name: of the policy, to be written in.
        frames_per_second: of a video or an animation.
        speed: of a video or an animation: 1 for real time, 0.5 for half speed.
        moments: number of pictures in a strip.
        steps: control steps to show.
        progress: told the number of control steps done.

    Raises:
        RequestError: if no such file can be written.
        WorkError: if the disk is full or refuses.
    """
    check_output(path)
    ending = path.suffix.lower()
    at: Collection[int]
    if ending == ".png":
        at, interval = strip_steps(moments, steps), 0.0
    else:
        at, interval = video_steps(frames_per_second, speed, steps)
    if ending == ".gif":
        _check_gif(interval)
    title, note = f"{scene.task}, {name}", f"{scene.camera} camera"
    if speed != 1:
        note += f", {speed:g} x real time"
    shown: list[Frame] = []

    def pictures() -> Iterator[Picture]:
        for frame in render_episode(policy, scene, at, progress):
            # Only the last is kept: a long video would fill the memory.
            shown[:] = [frame]
            still = ending == ".png"
            yield strip_picture(frame) if still else video_picture(frame, title, note)

    if ending == ".mp4":
        content = mp4(pictures(), (scene.width, scene.height), interval)
    elif ending == ".gif":
        content = gif(list(pictures()), interval)
    else:
        content = png_strip(list(pictures()))
    write_atomic(path, content)
    return Rendered(path, len(at), shown[0].time, shown[0].episode_return)


def _check_gif(interval: float) -> None:
    if interval < _SHORTEST_GIF_INTERVAL:
        raise RequestError(
            f"No .gif of {1 / interval:g} frames a second; it has at most "
            f"{1 / _SHORTEST_GIF_INTERVAL:g}."
        )


def png_strip(pictures: Sequence[Picture]) -> bytes:
    """Returns a PNG with pictures (height, width, 3) side by side."""
    buffer = io.BytesIO()
    Image.fromarray(np.hstack(pictures)).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def gif(pictures: Sequence[Picture], interval: float) -> bytes:
    """Returns an endless animation.

    Args:
        pictures: (height, width, 3) each, all of one size.
        interval: seconds between them; an animation counts in hundredths.
    """
    chosen = np.linspace(0, len(pictures) - 1, min(_PALETTE_PICTURES, len(pictures))).astype(int)
    sample = Image.fromarray(np.vstack([pictures[index] for index in chosen]))
    palette = sample.quantize(256, method=Image.Quantize.MEDIANCUT)
    # No dithering: it would flicker, and make the file thrice as large.
    images = [
        Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)
        for picture in pictures
    ]
    buffer = io.BytesIO()
    images[0].save(
        buffer,
        "GIF",
        save_all=True,
        append_images=images[1:],
        duration=10 * round(100 * interval),
        loop=0,
        optimize=True,
    )
    return buffer.getvalue()


def mp4(pictures: Iterator[Picture], size: tuple[int, int], interval: float) -> bytes:
    """Returns an H.264 video that any browser plays.

    Args:
        pictures: (height, width, 3) each; an odd side is made even by repeating its last line.
        size: width and height (pixels).
        interval: seconds between the pictures.

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
            macro_block_size=2,  # colours are kept for 2 x 2 pixels
            ffmpeg_log_level="error",
            # The index first: it plays while it is loaded.
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
            raise WorkError("ffmpeg wrote nothing; what it said is above.")
        return path.read_bytes()
