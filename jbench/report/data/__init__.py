"""Configurations of runs and their learning curves."""
