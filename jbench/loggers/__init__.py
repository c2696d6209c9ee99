"""Copies of committed rows in experiment trackers; nothing is read back from them."""
