"""Random-policy data: collect it, read it."""

from jbench.datasets.collect import collect
from jbench.datasets.reader import Dataset, find_dataset

__all__ = ["Dataset", "collect", "find_dataset"]
