"""Fixtures of dataset tests: six episodes of random actions in three files."""

import pytest

from jbench.datasets import Dataset, collect, fixed
from jbench.settings.records import DatasetSettings
from jbench.store import Results


@pytest.fixture(scope="session")
def collect_in_files_of():
    """Returns a function that collects a dataset with a number of episodes per file."""

    def collect_in_files(episodes, path, steps, **options):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(fixed, "PART_EPISODES", episodes)
            wanted = DatasetSettings(seed=3, steps=steps)
            return collect(wanted, Results(path), **{"threads": 2, **options})

    return collect_in_files


@pytest.fixture(scope="session")
def six_episodes(tmp_path_factory, collect_in_files_of):
    return collect_in_files_of(2, tmp_path_factory.mktemp("six") / "results", 6000)


@pytest.fixture
def dataset(six_episodes):
    return Dataset(six_episodes)
