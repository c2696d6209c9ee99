"""The statistics of jbench's comparisons: intervals, verdicts, sequential tests."""

ROUNDING = 1e-9
"""Differences of means that count as equal in permutation tests, relative to the largest score."""
