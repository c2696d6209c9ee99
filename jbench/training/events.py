"""What happens while runs are trained: the one message of workers, sweeps and their displays."""

import json
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

from jbench.settings.run import RunSettings


class Event(NamedTuple):
    """Something that happens; fields that a kind does not mention are empty."""

    kind: Literal[
        # Of a worker, on the run with an id, which does not simply begin: it resumes from its
        # checkpoint at `steps` control steps (0 without one), or from that of the finished run
        # `continues`; `text` has what else there is to say.
        "resumed",
        "episode",  # a training episode with `episode_return` ended after `steps` control steps
        "finished",  # it and the next two are the last event of a run
        "failed",  # `text` is the reason, and `traceback` is empty if it says all
        "held",  # another process is training it; of a sweep, `runs` whose process is another one
        "note",  # `text` is a sentence for the user, of a worker if there is a run
        "warning",  # of a sweep, as all that follow: `text` is a sentence for the user
        "progress",  # `steps` of `total` are done of the work that `text` names, in `unit`
        "training",  # of `runs` begins
        "started",  # a process that trains `runs`
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


def ignore(event: Event) -> None:
    """Reports nothing."""
