"""Collecting and reading random-policy datasets."""

from jbench.datasets.collect import collect, plan_dataset
from jbench.datasets.reader import Dataset, find_dataset

__all__ = ["Dataset", "collect", "find_dataset", "plan_dataset"]
