"""Saved, hand-written and imported policies, and their evaluation."""
