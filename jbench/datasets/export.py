"""Export of datasets to the Minari format."""

import copy
import importlib.util
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from jbench.datasets.block import Block
from jbench.datasets.reader import Dataset
from jbench.errors import RequestError, WorkError
from jbench.registration import environment_id, register_task
from jbench.store import locks
from jbench.store.files import make_directory
from jbench.tasks.find import find_task

_OVERHEAD = 1.5  # upper bound of file size over the size of the arrays; 1.2 is measured


class Exported(NamedTuple):
    """A dataset of Minari: its id, which is its path in the directory of all, and its bytes."""

    id: str
    bytes: int


def export_minari(
    dataset: Dataset, task: str, root: Path, progress: Callable[[int], None] = lambda episodes: None
) -> Exported:
    """Writes a dataset for Minari with the observations and rewards of a task.

    The export is atomic: it is written to a hidden directory beside the target. An interrupted
    export is written again by the next one.

    Args:
        dataset: to export.
        task: whose observations and rewards are written.
        root: directory of Minari datasets (MINARI_DATASETS_PATH).
        progress: is called with the number of completed episodes.

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
    id = dataset.layout.minari_id(dataset.id, task)
    path = root / id
    temporary = path.with_name(f".writing-{path.name}")
    if path.exists():
        _remove(temporary)  # of an export whose last step failed
        raise RequestError(
            f"{path} exists already and is not overwritten; name another directory with --out."
        )

    make_directory(temporary, "--out")
    about = find_task(task)
    # Of a control step: observation, action and reward in float32, and two flags.
    step_size = 4 * (about.observation_size + about.action_size + 1) + 2
    size = round((dataset.control_steps + dataset.episodes) * step_size * _OVERHEAD)
    with locks.hold(temporary, str(path)):
        content = temporary / "content"  # without the lock
        try:
            if content.exists():
                shutil.rmtree(content)
            if hasattr(os, "posix_fallocate"):  # since HDF5 crashes on a full disk
                with tempfile.TemporaryFile(dir=temporary) as file:
                    os.posix_fallocate(file.fileno(), 0, size)
            content.mkdir()
            _write(dataset, task, id, content / "data", progress)
            written = sum(part.stat().st_size for part in content.rglob("*") if part.is_file())
            content.rename(path)
        except OSError as error:
            raise WorkError(
                f"{path} can't be written ({error.strerror}); "
                f"it needs {size / 1e6:.1f} MB of space."
            ) from None
        finally:
            _remove(temporary)

    return Exported(id, written)


def _remove(directory: Path) -> None:
    """Removes a directory if possible; `ignore_errors` of rmtree does not ignore all errors."""
    with suppress(OSError):
        shutil.rmtree(directory)


def _write(dataset: Dataset, task: str, id: str, to: Path, progress: Callable[[int], None]) -> None:
    """Writes the episodes of a dataset to Minari's files."""
    # An optional dependency, slow to import.
    import minari
    from minari.data_collector.episode_buffer import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

    augment = dataset.settings.augment
    register_task(task)
    # A copy, since Gymnasium returns its registry's object.
    spec = copy.deepcopy(gymnasium.spec(environment_id(task, augment is not None)))
    spec.max_episode_steps = dataset.settings.episode_steps
    if augment is not None:
        spec.kwargs["augment"] = augment

    # Minari 0.5.4 fails on relative paths.
    storage = MinariStorage.new(to.resolve(), env_spec=spec, data_format="hdf5")
    storage.update_metadata(
        {
            "dataset_id": id,
            "minari_version": minari.__version__,
            "algorithm_name": dataset.settings.policy,
            "description": f"The jbench dataset {dataset.id} for {task}.",
            "requirements": ["jbench"],
        }
    )
    for episodes, block in zip(dataset.parts, dataset.blocks(task), strict=True):
        storage.update_episodes(
            EpisodeBuffer(id=number, **_arrays(block, row)) for row, number in enumerate(episodes)
        )
        progress(episodes.stop)


def _arrays(block: Block, row: int) -> dict[str, NDArray[Any]]:
    """Returns the arrays of an episode up to its end, by the names of Minari's fields.

    Args:
        block: some episodes.
        row: the place of the episode in the block.
    """
    length = block.lengths[row]
    terminations = np.zeros(length, bool)
    truncations = np.zeros(length, bool)
    if block.terminated[row]:
        terminations[-1] = True
    else:
        truncations[-1] = True

    return {
        "observations": block.observations[row, : length + 1],
        "actions": block.action_vectors[row, :length],
        "rewards": block.rewards[row, :length],
        "terminations": terminations,
        "truncations": truncations,
    }
