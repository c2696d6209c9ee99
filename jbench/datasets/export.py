"""A dataset in another format, so that other tools can read it."""

import copy
import fcntl
import importlib.util
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from jbench.datasets.reader import Block, Dataset
from jbench.errors import RequestError, WorkError
from jbench.names import EPISODE_STEPS
from jbench.settings.base import validated
from jbench.settings.dataset import DatasetSettings
from jbench.store.files import make_directory
from jbench.tasks import features
from jbench.tasks.gym import environment_id

# Of the format: the one that Minari writes by itself.
_STORAGE = "hdf5"
# Of its files over the numbers in them: measured, 1.2.
_OVERHEAD = 1.5


class Exported(NamedTuple):
    """What was written.

    Attributes:
        path: directory of the exported dataset.
        id: by which Minari knows it.
        bytes: on the disk.
    """

    path: Path
    id: str
    bytes: int


def minari_id(dataset: Dataset, task: str) -> str:
    """Returns Minari's id of a dataset, such as jitterbug/face_direction/random-s00-1f9a2c4e-v0."""
    return f"jitterbug/{task}/{dataset.id.replace('/', '-')}-v0"


def export_minari(
    dataset: Dataset,
    task: str,
    root: Path,
    progress: Callable[[int], None] = lambda episodes: None,
) -> Exported:
    """Writes a dataset as a task sees it for Minari, file by file.

    It is there whole or not at all: what is being written lies in a hidden directory beside it,
    and what a killed export left there is written again by the next.

    Args:
        dataset: a finished one.
        task: whose observations and rewards it gets.
        root: directory of Minari datasets, what Minari calls MINARI_DATASETS_PATH.
        progress: called with the number of episodes done.

    Raises:
        RequestError: if Minari is not installed, or the target exists already.
        WorkError: if the dataset is damaged, another process exports it, or the disk is full.
    """
    missing = [name for name in ("minari", "h5py") if importlib.util.find_spec(name) is None]
    if missing:
        raise RequestError(
            f"Exporting needs {missing[0]}, which is not installed: type pip install "
            "'jbench[minari]'."
        )
    id = minari_id(dataset, task)
    path = root / id
    if path.exists():
        raise RequestError(
            f"{path} exists already and is not overwritten; name another directory with --out."
        )
    make_directory(path.parent)
    size = features.TASK_SPECS[task].observation_size
    room = dataset.episodes * (EPISODE_STEPS + 1) * (4 * size + 10) * _OVERHEAD
    with _place(path, round(room)) as place:
        _write(dataset, task, id, place / "data", progress)
        written = sum(file.stat().st_size for file in place.rglob("*") if file.is_file())
        place.rename(path)
    return Exported(path, id, written)


@contextmanager
def _place(path: Path, room: int) -> Iterator[Path]:
    """Gives an empty hidden directory beside a path, for this process alone.

    Args:
        path: where its content is to go.
        room: bytes that it will need.

    Raises:
        WorkError: if another process has it, or there is not so much room.
    """
    place = path.with_name(f".writing-{path.name}")
    make_directory(place)
    handle = os.open(place, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise WorkError(f"Another process is writing {path}; wait for it or stop it.") from None
    try:
        for left in place.iterdir():
            shutil.rmtree(left)
        _try_room(place, room)
        yield place
    except BaseException as error:
        shutil.rmtree(place, ignore_errors=True)
        if isinstance(error, OSError):
            raise WorkError(
                f"{path} can't be written ({error.strerror}); it needs {room / 1e6:.1f} MB of room."
            ) from None
        raise
    finally:
        os.close(handle)


def _try_room(place: Path, room: int) -> None:
    """Takes so many bytes of the disk and gives them back: where it is full, HDF5 crashes."""
    if hasattr(os, "posix_fallocate"):
        with tempfile.TemporaryFile(dir=place) as file:
            os.posix_fallocate(file.fileno(), 0, room)


def _write(
    dataset: Dataset, task: str, id: str, place: Path, progress: Callable[[int], None]
) -> None:
    """Writes all of a dataset with Minari's own writer."""
    # An extra, and slow to import.
    import minari
    from minari.data_collector.episode_buffer import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

    settings = validated(DatasetSettings, f"the dataset {dataset.id}", **dataset.record.settings)
    # A copy: Gymnasium gives its own.
    spec = copy.deepcopy(gymnasium.spec(environment_id(task, settings.augment is not None)))
    if settings.augment is not None:
        spec.kwargs["augment"] = settings.augment
    # Minari 0.5.4 loses its way where a path is relative.
    storage = MinariStorage.new(place.resolve(), env_spec=spec, data_format=_STORAGE)
    storage.update_metadata(
        {
            "dataset_id": id,
            "minari_version": minari.__version__,
            "algorithm_name": settings.policy,
            "description": f"The jbench dataset {dataset.id} as {task} sees it.",
            "requirements": ["jbench"],
        }
    )
    for episodes, block in zip(dataset.parts, dataset.blocks(task), strict=True):
        storage.update_episodes(EpisodeBuffer(**fields) for fields in _episodes(episodes, block))
        progress(episodes.stop)


def _episodes(episodes: range, block: Block) -> Iterator[dict[str, Any]]:
    """Gives the episodes of a block as Minari names their parts."""
    # No episode ends by itself: the time limit cuts each off.
    never = np.zeros(EPISODE_STEPS, bool)
    cut_off = np.arange(1, EPISODE_STEPS + 1) == EPISODE_STEPS
    for number, observations, actions, rewards in zip(episodes, *block, strict=True):
        yield {
            "id": number,
            "observations": observations,
            "actions": actions[:, None],
            "rewards": rewards,
            "terminations": never,
            "truncations": cut_off,
        }
