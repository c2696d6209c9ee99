"""Tests of the events that a worker reports as lines of JSON."""

import json
from typing import get_args

import pytest

from jbench.training.events import (
    EpisodeEnded,
    Failed,
    Finished,
    Held,
    Note,
    Resumed,
    Warned,
    WorkerEvent,
    from_json,
    to_json,
)

EVENTS = [
    Resumed("task/td3/full/s00-1", 5000, "task/td3/full/s00-2", "A checkpoint is damaged."),
    EpisodeEnded("a", 1000, 0.1 + 0.2),
    Finished("a"),
    Failed("a", "no luck", 'Traceback:\n  "line" 1'),
    Held("a"),
    Note("The replay buffer is kept."),
    Warned("a:make: its close fails."),
]


@pytest.mark.parametrize("event", EVENTS, ids=lambda event: type(event).__name__)
def test_event_of_worker_survives_as_one_line(event):
    line = json.dumps(to_json(event), allow_nan=False)
    assert "\n" not in line
    assert from_json(json.loads(line)) == event


def test_every_kind_of_event_of_a_worker_is_among_those_above():
    assert {type(event) for event in EVENTS} == set(get_args(WorkerEvent))


@pytest.mark.parametrize(
    ("event", "sentence"),
    [
        (Resumed("r", 1000), "was interrupted or failed; it resumes at control step 1,000."),
        (Resumed("r"), "was interrupted or failed; it starts again from the beginning."),
        (Resumed("r", 20, "q"), "continues q from control step 20."),
        (Resumed("r", 0, "q", "Why."), "can't continue q; it trains from the beginning. Why."),
    ],
)
def test_sentence_says_where_a_run_continues(event, sentence):
    assert event.sentence == f"The run r {sentence}"
