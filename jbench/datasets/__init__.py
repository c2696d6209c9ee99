"""Random-policy data: collect it, read it."""

from jbench.datasets.collect import DatasetSettings, collect
from jbench.datasets.reader import Dataset, find_dataset

__all__ = ["Dataset", "DatasetSettings", "collect", "find_dataset"]
