"""Export of datasets to the Minari format."""

import copy
import importlib.util
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from jbench.datasets.reader import Block, Dataset
from jbench.errors import RequestError, WorkError
from jbench.names import EPISODE_STEPS
from jbench.registration import environment_id
from jbench.settings.base import validated
from jbench.settings.records import JITTERBUG, DatasetSettings
from jbench.simulation import find_task
from jbench.store import locks
from jbench.store.files import make_directory

_STORAGE = "hdf5"  # Minari's default
_OVERHEAD = 1.5  # upper bound of file size over the size of the arrays; 1.2 is measured


class ExportedDataset(NamedTuple):
    """An exported dataset.

    Attributes:
        bytes: on disk.
    """

    path: Path
    id: str
    bytes: int


def minari_id(dataset: Dataset, task: str) -> str:
    """Returns Minari's id of a dataset, such as jitterbug/face_direction/random-s00-1f9a2c4e-v0.

    That of another robot is such as jbench/dmc-cheetah-run/random-s00-59ba1e20-v0.
    """
    if dataset.robot == JITTERBUG:
        return f"jitterbug/{task}/{dataset.id.replace('/', '-')}-v0"
    robot, _, name = dataset.id.partition("/")
    return f"jbench/{robot.replace('.', '-')}/{name.replace('/', '-')}-v0"


def export_minari(
    dataset: Dataset,
    task: str,
    root: Path,
    progress: Callable[[int], None] = lambda episodes: None,
) -> ExportedDataset:
    """Writes a dataset for Minari with the observations and rewards of a task.

    The export is atomic: it is written to a hidden directory beside the target. An interrupted
    export is written again by the next one.

    Args:
        dataset: a finished dataset.
        root: directory of Minari datasets (MINARI_DATASETS_PATH).
        progress: called with the number of completed episodes.

    Raises:
        RequestError: if Minari is not installed, the target exists, or the dataset is of another
            robot.
        WorkError: if the dataset is damaged, another process exports it, or the disk is full.
    """
    missing = [name for name in ("minari", "h5py") if importlib.util.find_spec(name) is None]
    if missing:
        raise RequestError(
            f"Exporting needs {missing[0]}, which is not installed: type pip install "
            "'jbench[minari]'."
        )
    dataset.check_task(task)
    id = minari_id(dataset, task)
    path = root / id
    if path.exists():
        _remove(_temporary(path))  # an export whose last step failed
        raise RequestError(
            f"{path} exists already and is not overwritten; name another directory with --out."
        )
    make_directory(path.parent)
    about = find_task(task)
    # Of a control step: observation, action and reward in float32, and two flags.
    size = 4 * (about.observation_size + about.action_size + 1) + 2
    size_bound = dataset.episodes * (EPISODE_STEPS + 1) * size * _OVERHEAD
    with _writing(path, round(size_bound)) as directory:
        _write(dataset, task, id, directory / "data", progress)
        written = sum(file.stat().st_size for file in directory.rglob("*") if file.is_file())
        directory.rename(path)
    return ExportedDataset(path, id, written)


@contextmanager
def _writing(path: Path, size: int) -> Iterator[Path]:
    """Yields an empty directory in a locked, hidden one beside a path.

    Args:
        path: final path of its content.
        size: bytes that it will need.

    Raises:
        WorkError: if another process has locked it, or the disk is too full.
    """
    directory = _temporary(path)
    make_directory(directory)
    with locks.hold(directory, str(path)):
        try:
            for leftover in directory.iterdir():
                if leftover.name != locks.LOCK:
                    shutil.rmtree(leftover)
            _check_space(directory, size)
            # The lock stays outside of what is renamed.
            content = directory / "content"
            content.mkdir()
            yield content
        except OSError as error:
            raise WorkError(
                f"{path} can't be written ({error.strerror}); "
                f"it needs {size / 1e6:.1f} MB of space."
            ) from None
        finally:
            _remove(directory)


def _temporary(path: Path) -> Path:
    return path.with_name(f".writing-{path.name}")


def _remove(directory: Path) -> None:
    """Removes a directory if possible; `ignore_errors` of rmtree does not ignore all errors."""
    with suppress(OSError):
        shutil.rmtree(directory)


def _check_space(directory: Path, size: int) -> None:
    """Allocates and frees this many bytes, since HDF5 crashes on a full disk."""
    if hasattr(os, "posix_fallocate"):
        with tempfile.TemporaryFile(dir=directory) as file:
            os.posix_fallocate(file.fileno(), 0, size)


def _write(
    dataset: Dataset, task: str, id: str, directory: Path, progress: Callable[[int], None]
) -> None:
    """Writes a dataset with Minari's writer."""
    # An optional dependency, slow to import.
    import minari
    from minari.data_collector.episode_buffer import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

    settings = validated(DatasetSettings, f"the dataset {dataset.id}", **dataset.record.settings)
    # A copy, since Gymnasium returns its registry's object.
    spec = copy.deepcopy(gymnasium.spec(environment_id(task, settings.augment is not None)))
    if settings.augment is not None:
        spec.kwargs["augment"] = settings.augment
    # Minari 0.5.4 fails on relative paths.
    storage = MinariStorage.new(directory.resolve(), env_spec=spec, data_format=_STORAGE)
    storage.update_metadata(
        {
            "dataset_id": id,
            "minari_version": minari.__version__,
            "algorithm_name": settings.policy,
            "description": f"The jbench dataset {dataset.id} for {task}.",
            "requirements": ["jbench"],
        }
    )
    for episodes, block in zip(dataset.parts, dataset.blocks(task), strict=True):
        storage.update_episodes(EpisodeBuffer(**fields) for fields in _episodes(episodes, block))
        progress(episodes.stop)


def _episodes(episodes: range, block: Block) -> Iterator[dict[str, Any]]:
    """Yields the episodes of a block with Minari's field names."""
    # Episodes are truncated at the time limit and never terminate.
    never = np.zeros(EPISODE_STEPS, bool)
    truncations = np.arange(1, EPISODE_STEPS + 1) == EPISODE_STEPS
    for number, observations, actions, rewards in zip(episodes, *block, strict=True):
        yield {
            "id": number,
            "observations": observations,
            "actions": actions.reshape(EPISODE_STEPS, -1),
            "rewards": rewards,
            "terminations": never,
            "truncations": truncations,
        }
