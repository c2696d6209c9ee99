"""Many robots stepped at once, on threads."""

from jbench.simulation.episodes import Trajectories, simulate

__all__ = ["Trajectories", "simulate"]
