"""Sweeps: many runs, scheduled on one machine or a cluster."""
