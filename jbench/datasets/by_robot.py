"""The layout of the datasets of a robot by its name."""

from jbench.datasets.jitterbug import JitterbugLayout
from jbench.datasets.layout import DatasetLayout
from jbench.datasets.other_robots import OtherLayout
from jbench.settings.records import JITTERBUG
from jbench.store import Record


def find_layout(robot: str) -> DatasetLayout:
    """Returns the layout of a robot, see `Task.robot`."""
    return JitterbugLayout() if robot == JITTERBUG else OtherLayout(robot)


def recorded_layout(record: Record) -> DatasetLayout:
    """Returns the layout of a recorded dataset."""
    return find_layout(recorded_robot(record))


def recorded_robot(record: Record) -> str:
    """Returns the robot of a recorded dataset; older ones do not name the Jitterbug."""
    robot: str = record.settings.get("robot", JITTERBUG)
    return robot
