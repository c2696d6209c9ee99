"""Many robots stepped at once, on threads."""

from jbench.simulation.episodes import Trajectories, simulate
from jbench.simulation.robots import Robots

__all__ = ["Robots", "Trajectories", "simulate"]
