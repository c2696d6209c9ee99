"""Multithreaded simulation of many robots."""

from jbench.simulation.episodes import Trajectories, simulate
from jbench.simulation.robots import Robots
from jbench.simulation.rollout import Act, Transition, rollout

__all__ = ["Act", "Robots", "Trajectories", "Transition", "rollout", "simulate"]
