"""What happens while runs are trained: the messages of workers and sweeps to their displays.

A worker sends its own as lines of JSON; a sweep passes them on, and adds others.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, get_args

from jbench.settings.run import RunSettings


@dataclass(frozen=True)
class Resumed:
    """A run does not simply begin.

    Attributes:
        run: its id, as in all events of a run.
        control_steps: of the checkpoint from which it resumes; 0 without one.
        continues: id of the finished run whose checkpoint it is; empty if it is the run's own.
        text: what else there is to say.
    """

    run: str
    control_steps: int = 0
    continues: str = ""
    text: str = ""

    @property
    def sentence(self) -> str:
        """The sentence that says at which control step the run continues."""
        step = f"control step {self.control_steps:,}"
        if self.continues and self.control_steps:
            clause = f"continues {self.continues} from {step}"
        elif self.continues:
            clause = f"can't continue {self.continues}; it trains from the beginning"
        elif self.control_steps:
            clause = f"was interrupted or failed; it resumes at {step}"
        else:
            clause = "was interrupted or failed; it starts again from the beginning"

        return f"The run {self.run} {clause}. {self.text}".rstrip()


@dataclass(frozen=True)
class EpisodeEnded:
    """A training episode ended, after these control steps of its run."""

    run: str
    control_steps: int
    episode_return: float


@dataclass(frozen=True)
class Finished:
    """A run is finished, which is the last event of a worker on it."""

    run: str


@dataclass(frozen=True)
class Failed:
    """A run failed, which is the last event of a worker on it.

    Attributes:
        reason: a sentence without a period.
        traceback: empty if the reason says all.
    """

    run: str
    reason: str
    traceback: str = ""


@dataclass(frozen=True)
class Held:
    """Another process is training a run, which is the last event of a worker on it."""

    run: str


@dataclass(frozen=True)
class Note:
    """A sentence for the user."""

    text: str


@dataclass(frozen=True)
class Warned:
    """A sentence for the user, on something that is wrong."""

    text: str


LastEvent = Finished | Failed | Held
RunEvent = Resumed | EpisodeEnded | LastEvent
WorkerEvent = RunEvent | Note | Warned


@dataclass(frozen=True)
class Progress:
    """A part of some work is done before the training, `done` of `total` in a unit."""

    work: str
    done: int
    total: int
    unit: str


@dataclass(frozen=True)
class TrainingBegan:
    """The training of runs begins."""

    runs: Sequence[RunSettings]


@dataclass(frozen=True)
class ProcessStarted:
    """A process that trains runs has started."""

    runs: Sequence[RunSettings]


@dataclass(frozen=True)
class ProcessEnded:
    """A process that trained runs has ended."""

    runs: Sequence[RunSettings]


ProgressEvent = RunEvent | Progress | TrainingBegan | ProcessStarted | ProcessEnded
"""What a display draws; the other events are sentences."""

Event = ProgressEvent | Note | Warned

Report = Callable[[Event], object]


def ignore(event: Event) -> None:
    """Reports nothing."""


_BY_NAME = {kind.__name__: kind for kind in get_args(WorkerEvent)}


def to_json(event: WorkerEvent) -> dict[str, Any]:
    """Returns the event of a worker as JSON values."""
    return {"event": type(event).__name__, **asdict(event)}


def from_json(values: Mapping[str, Any]) -> WorkerEvent:
    """Returns the event from the values of `to_json`."""
    fields = dict(values)
    event: WorkerEvent = _BY_NAME[fields.pop("event")](**fields)
    return event
