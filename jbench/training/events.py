"""What happens while runs are trained: the one message of workers, sweeps and their displays."""

import json
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

from jbench.settings.run import RunSettings


class Event(NamedTuple):
    """Something that happens; fields that a kind does not mention are empty.

    Attributes:
        kind: a worker reports on one run:

            - resumed: `run` does not simply begin. It resumes from its checkpoint at `steps`
              control steps, or from that of the finished run `continues`; at 0 without one. `text`
              has what else there is to say.
            - episode: a training episode with `episode_return` ended after `steps` control steps.
            - finished: the last event of a run.
            - failed: so is this one; `text` is the reason, and `traceback` is empty if it says all.
            - held: and this one; another process is training the run, as `text` says.

            A sweep adds:

            - note, warning: `text` is a sentence for the user.
            - progress: `steps` of `total` are done of the work that `text` names, in `unit`.
            - training: the training of `runs` begins.
            - started, ended: so does a process that trains `runs`, or it has ended.
        run: id of the run.
    """

    kind: Literal[
        "resumed",
        "episode",
        "finished",
        "failed",
        "held",
        "note",
        "warning",
        "progress",
        "training",
        "started",
        "ended",
    ]
    run: str = ""
    text: str = ""
    steps: int = 0
    episode_return: float = 0.0
    continues: str = ""
    traceback: str = ""
    total: int = 0
    unit: str = ""
    runs: Sequence[RunSettings] = ()

    @property
    def is_last(self) -> bool:
        """Whether a worker reports nothing more on the run."""
        return self.kind in ("finished", "failed", "held")

    @property
    def resume_sentence(self) -> str:
        """The sentence that says at which control step a resumed run continues."""
        at, other = self.steps, self.continues
        if not other:
            how = "was interrupted or failed; it " + ("resumes at" if at else "starts again from")
        else:
            how = f"continues {other} from" if at else f"can't continue {other}; it trains from"
        where = f"control step {at:,}" if at else "the beginning"
        return f"The run {self.run} {how} {where}. {self.text}".rstrip()

    def to_json(self) -> str:
        """Returns the event of a worker as one line of JSON."""
        return json.dumps({name: value for name, value in self._asdict().items() if value})


Report = Callable[[Event], object]
"""Takes the events of what it is passed to."""


def ignore(event: Event) -> None:
    """Reports nothing."""
