"""Tasks behind one interface, and the multithreaded simulation of the Jitterbug."""

from jbench.simulation.episodes import Trajectories, simulate
from jbench.simulation.find import find_task
from jbench.simulation.robots import Robots
from jbench.simulation.rollout import Act, Transition, rollout
from jbench.simulation.task import Task, Worlds

__all__ = [
    "Act",
    "Robots",
    "Task",
    "Trajectories",
    "Transition",
    "Worlds",
    "find_task",
    "rollout",
    "simulate",
]
