"""Collecting and reading random-policy datasets."""

from jbench.datasets.collect import collect
from jbench.datasets.reader import Dataset, find_dataset

__all__ = ["Dataset", "collect", "find_dataset"]
