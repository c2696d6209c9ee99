"""Runs from their settings to their results, and the published experiments as data."""
