"""Reinforcement learning algorithms, their settings and trained policies."""
