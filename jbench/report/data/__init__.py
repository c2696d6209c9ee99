"""Cells of runs and their learning curves."""
