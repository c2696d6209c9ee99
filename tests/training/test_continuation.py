"""Tests of longer runs that continue finished ones, and end like runs trained at once."""

import errno
import functools
import os

import pytest

from jbench.errors import RequestError
from jbench.policies.network import WEIGHTS
from jbench.store import Results, merge
from jbench.store.verify import verify
from jbench.training.batched_run import run_batch
from jbench.training.continuation import check_state_can_be_kept, new_beginnings
from jbench.training.kept_evaluations import with_kept_evaluations
from jbench.training.status import run_status
from tests.short_episodes import EPISODE
from tests.training.small_runs import paths, rows, train_batch
from tests.training.test_checkpoints import find_file
from tests.training.test_resume import settings

pytestmark = pytest.mark.usefixtures("short_episodes")

SHORT, LONG = 300, 500

train = functools.partial(train_batch, keep_state="whole")


def outcome(path, run):
    """Returns the rows of a finished run without ids and times, its paths, and its weights."""
    record = Results(path).find("run", run.id)
    assert record.status == "finished"
    assert {row["run"] for row in rows(record)} == {run.id}
    numbers = [{**row, "run": None} for row in rows(record)]
    return numbers, paths(record), record.read_file(WEIGHTS)


def lengths(algo, *steps, seed=1, **changes):
    return [settings(algo, seed, steps=count, **changes) for count in steps]


def test_run_recorded_with_older_default_evaluations_is_found_by_the_same_command(tmp_path):
    asked = lengths("td3", SHORT, evaluate_every=100, evaluate_episodes=1)
    typed = {"evaluate_every": None, "evaluate_episodes": None}
    assert with_kept_evaluations(asked, Results(tmp_path), typed) == asked
    older = lengths("td3", SHORT, evaluate_every=EPISODE, evaluate_episodes=10)
    Results(tmp_path).create("run", older[0].id, older[0].values)
    assert with_kept_evaluations(asked, Results(tmp_path), typed) == older
    # Whose user types the episodes, or how often, means other evaluations.
    for more in ({"evaluate_episodes": 1}, {"evaluate_every": 100}):
        assert with_kept_evaluations(asked, Results(tmp_path), typed | more) == asked


@pytest.mark.parametrize(
    ("algo", "short", "changes"),
    [
        # The evaluation at the end of the shorter run is one of the longer run's, too.
        pytest.param("td3", 300, {}, marks=pytest.mark.slow),
        # It is not, and step 280, the end of a rollout, is in the middle of an episode.
        ("ddpg", 275, {"normalize": "running"}),
        pytest.param("sac", 250, {}, marks=pytest.mark.slow),
        # The shorter run ends with a rollout of 2 x 24 steps, at step 336.
        pytest.param("ppo", 300, {}, marks=pytest.mark.slow),
        # `test_compact_states.py` has a faster test of several environments.
        pytest.param("td3", 200, {"parallel": 2, "evaluate_episodes": 0}, marks=pytest.mark.slow),
    ],
)
def test_continued_run_equals_run_trained_at_once(algo, short, changes, tmp_path):
    first, whole = lengths(algo, short, LONG, **changes)
    # Each last evaluation is longer than the others, so that the shorter run's may be shortened.
    last = {"final_episodes": 2}
    train(tmp_path / "once", [whole], keep_state="no", **last)
    train(tmp_path / "twice", [first], **last)
    before = outcome(tmp_path / "twice", first)
    ((_, steps, sentence, continues),) = train(tmp_path / "twice", [whole], **last)
    assert short <= steps < LONG
    assert (sentence, continues) == ("", first.id)
    assert outcome(tmp_path / "twice", whole) == outcome(tmp_path / "once", whole)
    # The shorter run is unchanged, and equals one without a kept state.
    train(tmp_path / "once", [first], keep_state="no", **last)
    assert outcome(tmp_path / "twice", first) == before == outcome(tmp_path / "once", first)
    assert verify(Results(tmp_path / "twice"), 1).findings == []


@pytest.mark.slow
def test_seeds_continue_from_where_each_of_them_ended(tmp_path):
    """Seed 1 continues from step 280, seed 2 from step 350; seed 3 begins."""
    runs = [settings("ddpg", seed, steps=LONG) for seed in (1, 2, 3)]
    for run, steps in zip(runs, (280, 350), strict=False):
        train(tmp_path / "twice", [run.model_copy(update={"steps": steps})])
    train(tmp_path / "once", runs, keep_state="no")
    notices = train(tmp_path / "twice", runs, keep_state="no")
    assert [notice[:2] for notice in notices] == [(1, 280), (2, 350)]
    for run in runs:
        assert outcome(tmp_path / "twice", run) == outcome(tmp_path / "once", run)
        assert Results(tmp_path / "twice").find("run", run.id).roles() == []


@pytest.mark.slow
def test_run_continues_longest_intact_state_with_same_settings(tmp_path):
    shortest, short, middle, whole = lengths("ddpg", 100, 200, 350, LONG)
    (other,) = lengths("ddpg", 400, evaluate_every=100)
    train(tmp_path, [shortest])
    train(tmp_path, [short])
    train(tmp_path, [middle], keep_state="no")
    train(tmp_path, [other])
    results = Results(tmp_path)
    assert run_status(whole, results).steps_left == LONG - 200
    find_file(results.find("run", short.id), "replay-", -1).write_bytes(b"other")
    ((_, steps, sentence, continues),) = train(tmp_path, [whole], until=150)
    assert (steps, continues) == (100, shortest.id)
    assert f"The checkpoint of {short.id} at 200 control steps is not used" in sentence
    record = results.find("run", whole.id)
    (continued,) = record.manifest.provenance["continued"]
    assert (continued["control_steps"], continued["run"]) == (100, shortest.id)
    # From now on the run resumes from its own checkpoint.
    assert train(tmp_path, [whole], until=200) == [(1, 150, "")]


def test_run_begins_if_only_state_is_damaged(tmp_path):
    short, whole = lengths("ppo", 100, 200, evaluate_episodes=0)
    train(tmp_path / "twice", [short])
    record = Results(tmp_path / "twice").find("run", short.id)
    find_file(record, "checkpoint-", -1).write_bytes(b"other")
    ((_, steps, sentence, continues),) = train(tmp_path / "twice", [whole])
    assert (steps, continues) == (0, short.id)
    assert f"The checkpoint of {short.id} at 144 control steps is not used" in sentence
    train(tmp_path / "once", [whole])
    assert outcome(tmp_path / "twice", whole) == outcome(tmp_path / "once", whole)


@pytest.mark.parametrize("left", [pytest.param(0, marks=pytest.mark.slow), 2])
def test_run_that_finds_no_room_for_its_copy_does_not_begin(left, tmp_path, monkeypatch):
    short, whole = lengths("ddpg", 100, 150, evaluate_episodes=0)
    train(tmp_path, [short])
    real, made = os.replace, []

    def full(source, target):
        made.append(target)
        if len(made) == left + 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(source, target)

    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", full)
        failures = run_batch([whole], Results(tmp_path))
    assert "No room left to write" in str(failures[whole.id])
    assert train(tmp_path, [whole]) == [(1, 100, "", short.id)]


@pytest.mark.slow
def test_last_evaluation_of_shorter_run_is_shortened(tmp_path):
    short, whole = lengths("td3", 300, 450, evaluate_episodes=2)
    train(tmp_path / "twice", [short], final_episodes=5)
    # At step 150, and at the end.
    assert Results(tmp_path / "twice").find("run", short.id).rows("evaluations") == 2 + 5
    train(tmp_path / "twice", [whole])
    train(tmp_path / "once", [whole])
    assert outcome(tmp_path / "twice", whole) == outcome(tmp_path / "once", whole)


def test_evaluation_after_last_updates_is_the_longer_final_one(tmp_path):
    (run,) = lengths("ppo", 100, evaluate_episodes=2)
    train(tmp_path, [run], final_episodes=5)
    evaluations = Results(tmp_path).find("run", run.id).read("evaluations")
    # The third rollout of 48 steps ends at step 144, before the first evaluation would be due.
    assert evaluations["control_steps"].to_pylist() == [144] * 5


def test_state_is_no_difference_between_merged_results(tmp_path):
    (run,) = lengths("td3", 50)
    train(tmp_path / "with", [run])
    train(tmp_path / "without", [run], keep_state="no")
    for name, source in (("with", "without"), ("without", "with")):
        (merged,) = merge.merge(Results(tmp_path / name), [Results(tmp_path / source)])
        assert merged.outcome == "same"


def test_new_beginning_is_explained_in_one_sentence(tmp_path):
    results = Results(tmp_path)
    short = [settings("ddpg", seed, steps=100) for seed in (1, 2)]
    whole = [run.model_copy(update={"steps": 200}) for run in short]
    assert list(new_beginnings(whole, results)) == []
    train(tmp_path, short, keep_state="no")
    assert list(new_beginnings(whole, results)) == [
        "2 runs train from the beginning, not from the end of finished runs of 100 control steps: "
        "the state was not kept, as --keep-state does."
    ]
    # A finished run is never shortened.
    shorter = [run.model_copy(update={"steps": 50}) for run in short]
    assert list(new_beginnings(shorter, results)) == []


def test_kept_state_with_other_evaluations_is_named_with_the_option_to_type(tmp_path):
    (run,) = lengths("ddpg", 100)
    train(tmp_path, [run])
    every = run.evaluate_every
    more = {"steps": 200, "evaluate_every": every + 50}
    assert list(new_beginnings([run.model_copy(update=more)], Results(tmp_path))) == [
        "1 run trains from the beginning, not from the end of a finished run of 100 control steps: "
        f"evaluations have another distance; type --evaluate-every {every} (in a matrix file, "
        f"every = {every} of [evaluation])."
    ]


@pytest.mark.slow
def test_longer_run_takes_the_distance_of_evaluations_that_its_user_did_not_type(tmp_path):
    (short,) = lengths("td3", SHORT, evaluate_every=100)
    longer = lengths("td3", LONG, evaluate_every=200)
    train(tmp_path, [short])
    typed = {"evaluate_every": None, "evaluate_episodes": 1}
    (run,) = with_kept_evaluations(longer, Results(tmp_path), typed)
    assert (run.evaluate_every, run.id) == (100, lengths("td3", LONG, evaluate_every=100)[0].id)
    train(tmp_path, longer)  # it exists now, so that the same command means it
    assert with_kept_evaluations(longer, Results(tmp_path), typed) == longer


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"robots": 2, "steps": 200}, "the steps of each robot in a sequence depend on the total"),
        ({"engine": "sb3"}, "stable-baselines3 has no checkpoints here"),
    ],
)
def test_state_that_no_run_can_continue_is_refused(changes, reason):
    (run,) = lengths("ddpg", 100)
    check_state_can_be_kept([run])
    with pytest.raises(RequestError, match=f"A finished run of ddpg can't be continued: {reason}"):
        check_state_can_be_kept([run, run.model_copy(update=changes)])
