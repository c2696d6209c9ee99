"""Tests of the times of the parts of a training loop."""

from jbench.store import Results
from jbench.timing import measured, part
from jbench.training.batched_run import run_batch
from tests.short_episodes import EPISODE, shorten_episodes
from tests.training.small_runs import small_run

SCHEDULE = {"learning_starts": 20, "batch_size": 4, "train_freq": 10, "gradient_steps": 1}


def test_training_names_its_parts(tmp_path, monkeypatch):
    shorten_episodes(monkeypatch.setattr)
    often = {"steps": 2 * EPISODE, "evaluate_every": EPISODE, "evaluate_episodes": 1}
    run = small_run("td3", SCHEDULE, **often)
    with measured() as seconds:
        run_batch([run], Results(tmp_path))
    learning = {"acting", "robots", "transitions", "updates", "waiting for updates"}
    assert seconds.keys() == learning | {"rows", "evaluation", "checkpoints"}
    assert all(spent > 0 for spent in seconds.values())


def test_time_within_a_part_belongs_to_the_inner_part(monkeypatch):
    now = iter([0.0, 1.0, 3.0, 7.0])
    monkeypatch.setattr("jbench.timing.time.perf_counter", lambda: next(now))
    with measured() as seconds, part("outer"), part("inner"):
        pass
    # Outer from 0 to 7, inner from 1 to 3.
    assert seconds == {"outer": 5.0, "inner": 2.0}


def test_nothing_is_measured_outside_of_the_block():
    with measured() as seconds:
        pass
    with part("robots"):
        pass
    assert seconds == {}
