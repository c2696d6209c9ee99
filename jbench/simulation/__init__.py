"""Tasks behind one interface, and the multithreaded simulation of the Jitterbug."""

from jbench.simulation.find import find_task
from jbench.simulation.jitterbug import Robots
from jbench.simulation.task import Act, ControlStep, Task, Worlds, rollout

__all__ = ["Act", "ControlStep", "Robots", "Task", "Worlds", "find_task", "rollout"]
