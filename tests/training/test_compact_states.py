"""Tests of runs that continue compact states, whose replay buffers are computed again."""

import functools

import pytest
import torch

from jbench.encoders.settings import encoder_settings
from jbench.encoders.states import States
from jbench.encoders.training import train_encoder
from jbench.errors import RequestError
from jbench.store import Results
from jbench.store.merge import merge
from jbench.store.verify import verify
from jbench.task_specs import EPISODE_STEPS
from jbench.training import checkpoints
from jbench.training.batched_run import run_batch
from jbench.training.checkpoints import load
from jbench.training.compact import OtherRowsError, reason_for_whole_state
from jbench.training.continuation import check_state_can_be_kept
from jbench.training.events import Failed, Note
from jbench.training.status import run_status
from jbench.training.worker import _ended
from tests.encoders.encoder_data import make_dataset
from tests.short_encoders import short_encoder_evaluation
from tests.short_episodes import EPISODE, short_episodes
from tests.training.small_runs import train_batch
from tests.training.test_continuation import outcome
from tests.training.test_ending_runs import DRIFTS, falling
from tests.training.test_resume import settings
from tests.training.test_suite_runs import settings as suite_settings

pytestmark = pytest.mark.usefixtures("short_episodes")

SHORT, LONG = 150, 210

train = functools.partial(train_batch, keep_state="compact", final_episodes=1)


@pytest.fixture(scope="module")
def mirroring(tmp_path_factory):
    """A results directory with a planar-mirror encoder of random states, and the encoder's id."""
    results = Results(tmp_path_factory.mktemp("mirroring") / "results")
    with short_episodes(EPISODE_STEPS), short_encoder_evaluation():
        dataset = make_dataset(results)
        kind = encoder_settings("planar-mirror", {}, dataset=dataset.id, latents=12)
        train_encoder(kind, States(dataset, "face_direction", 0), results)
    return results, kind.id


def jitterbug(steps, algo="td3", seed=1, **changes):
    return settings(algo, seed, steps=steps, **changes)


def with_small_buffer(run, size):
    return run.model_copy(update={"hyperparameters": {**run.hyperparameters, "buffer_size": size}})


def kept_checkpoint(path, run):
    """Returns the kept state of a finished run."""
    checkpoint, refused = load(Results(path).find("run", run.id))
    assert refused == []
    return checkpoint


def check_continued(path, make_run, short=SHORT, long=LONG, results=None):
    """Checks that a run continued from its compact state equals the one that was not stopped."""
    first, whole = make_run(short), make_run(long)
    options = {"encoders": results}
    train(path / "twice", [first], **options)
    ((_, steps, sentence, continues),) = train(path / "twice", [whole], **options)
    assert (steps, sentence, continues) == (first.last_step, "", first.id)
    train_batch(path / "once", [whole], final_episodes=1, **options)
    assert outcome(path / "twice", whole) == outcome(path / "once", whole)
    if results is None:  # otherwise the encoder lies elsewhere
        assert verify(Results(path / "twice"), 1).findings == []


@pytest.mark.parametrize(
    ("short", "changes"),
    [
        # Within an episode, of two environments with running statistics.
        (125, {"algo": "ddpg", "normalize": "running", "parallel": 2}),
        pytest.param(SHORT, {"algo": "sac"}, marks=pytest.mark.slow),
        pytest.param(144, {"algo": "ppo"}, marks=pytest.mark.slow),
    ],
)
def test_continued_run_equals_run_trained_at_once(short, changes, tmp_path):
    check_continued(tmp_path, functools.partial(jitterbug, **changes), short)


@pytest.mark.slow
def test_inputs_of_mirrored_robots_are_computed_again(mirroring, tmp_path):
    results, encoder = mirroring
    about = {"encoder": encoder, "representation": "planar-mirror12"}
    check_continued(tmp_path, functools.partial(jitterbug, **about), results=results)


def test_only_episodes_in_full_buffer_are_computed_again(tmp_path):
    """The last 50 of 180 transitions, whole rollouts of 30, begin in the third episode of 50."""

    def make_run(steps):
        return with_small_buffer(jitterbug(steps), 50)

    check_continued(tmp_path, make_run, 180)
    compact = kept_checkpoint(tmp_path / "twice", make_run(180)).compact
    # Episode 3 is the first one whose beginning, row 3 x 51, has not expired.
    assert (compact.header.episodes, compact.header.row) == (3, 153)
    assert len(compact.actions) == 180 - 3 * 50
    # The buffer has 52 rows, and the number of the current one is 180 + 3.
    assert compact.before.shape[1] == 153 - (183 - 52 + 1)


@pytest.mark.slow
def test_buffer_of_less_than_an_episode_keeps_its_rows(tmp_path):
    check_continued(tmp_path, lambda steps: with_small_buffer(jitterbug(steps), 30), 125)


def test_episodes_that_end_early_are_repeated(tmp_path):
    check_continued(tmp_path, lambda steps: falling("td3", steps=steps), 60, 90)


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["td3", "sac"])
def test_full_buffer_of_episodes_that_end_early_is_computed_again(algo, tmp_path):
    runs = [
        lambda steps, seed=seed: with_small_buffer(falling(algo, seed, steps=steps), 40)
        for seed in (0, 1)
    ]
    for make_run in runs:
        check_continued(tmp_path, make_run, 90, 130)
    # Seeds whose first whole episodes differ are continued in one batch, too.
    again = tmp_path / "again"
    train(again, [make_run(90) for make_run in runs])
    train(again, [make_run(130) for make_run in runs])
    for make_run in runs:
        assert outcome(again, make_run(130)) == outcome(tmp_path / "once", make_run(130))


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["td3", "sac"])
def test_episodes_of_robot_of_the_suite_are_repeated(algo, tmp_path):
    """They follow from their seeds and the commands of six motors."""

    def make_run(steps):
        return suite_settings(algo, "tests.short_tasks:cheetah_run", steps=steps)

    check_continued(tmp_path, make_run, 3 * EPISODE, 6 * EPISODE)  # whole rollouts, too


@pytest.mark.slow
def test_seeds_of_a_batch_are_computed_together(tmp_path):
    first, whole = ([jitterbug(steps, seed=seed) for seed in (1, 2)] for steps in (120, 240))
    train(tmp_path / "twice", first)
    events = []
    train(tmp_path / "twice", whole, report=events.append)
    (sentence,) = [event.text for event in events if isinstance(event, Note)]
    assert sentence == "The replay buffers of 2 runs are computed again from 120 actions each."
    train_batch(tmp_path / "once", whole, final_episodes=1)
    for run in whole:
        assert outcome(tmp_path / "twice", run) == outcome(tmp_path / "once", run)


def test_state_that_was_merged_into_fresh_results_is_continued_there(tmp_path):
    short, whole = (jitterbug(steps, "ddpg", evaluate_episodes=0) for steps in (60, 90))
    train(tmp_path / "there", [short])
    (merged,) = merge(Results(tmp_path / "here"), [Results(tmp_path / "there")])
    assert merged.outcome == "copied"
    ((_, steps, sentence, continues),) = train(tmp_path / "here", [whole])
    assert (steps, sentence, continues) == (short.last_step, "", short.id)
    train_batch(tmp_path / "once", [whole], final_episodes=1)
    assert outcome(tmp_path / "here", whole) == outcome(tmp_path / "once", whole)


def test_state_has_a_number_for_each_action(tmp_path):
    """The rest is that of a run without a buffer, and 72 bytes would be a row's."""
    sizes = []
    for steps in (120, 420):  # whole rollouts
        run = jitterbug(steps, evaluate_episodes=0)
        train(tmp_path, [run])
        record = Results(tmp_path).find("run", run.id)
        (role,) = record.roles()
        sizes.append(len(record.read_file(role)))
    assert abs(sizes[1] - sizes[0] - 4 * 300) < 100


@pytest.mark.parametrize("what", ["action", pytest.param("checksum", marks=pytest.mark.slow)])
def test_altered_state_is_refused_and_nothing_is_lost(what, tmp_path):
    short, whole = jitterbug(60), jitterbug(90)
    train(tmp_path, [short])
    alter(tmp_path, short, what)
    before = outcome(tmp_path, short)
    failures = run_batch([whole], Results(tmp_path))
    error = failures[whole.id]
    assert isinstance(error, OtherRowsError)
    assert f"The compact state of {short.id} can't be continued" in str(error)
    assert "may have been altered, since machine and versions are the same" in str(error)
    assert "or with another --results, where the run trains from the beginning." in str(error)
    assert outcome(tmp_path, short) == before
    # The longer run has not begun, so that another machine can begin it.
    assert run_status(whole, Results(tmp_path)).state == "missing"


def alter(path, run, what):
    record = Results(path).find("run", run.id)
    checkpoint, _ = load(record)
    compact = checkpoint.compact
    if what == "action":
        actions = compact.actions.clone()
        actions[40] = torch.nextafter(actions[40], torch.zeros(1))
        compact = compact._replace(actions=actions)
    else:
        header = compact.header.model_copy(update={"sha256": "0" * 64})
        compact = compact._replace(header=header)
    files = checkpoints._state_file(checkpoint._replace(compact=compact), record.id)
    record.append({}, files)


def test_refusal_names_the_machine_that_made_a_state(tmp_path):
    short, whole = jitterbug(60), jitterbug(90)
    train(tmp_path, [short])
    alter(tmp_path, short, "action")
    results = Results(tmp_path)
    record = results.find("run", short.id)
    record._update(provenance={**record.manifest.provenance, "processor": "Other CPU"})
    error = run_batch([whole], results)[whole.id]
    assert "is not the one of the run (processor Other CPU is now " in str(error)
    assert "type the command on a machine like the one that made it (Other CPU)" in str(error)
    assert isinstance(_ended(whole, results, error), Failed)
    assert run_status(whole, results).state == "missing"


def test_state_of_a_run_that_was_resumed_elsewhere_is_kept_whole(tmp_path):
    run, events = jitterbug(150), []
    assert run_batch([run], Results(tmp_path), until=100) == {}
    record = Results(tmp_path).find("run", run.id)
    made = {**record.manifest.provenance, "processor": "Other CPU"}
    record._update(provenance=made)
    assert run_batch([run], Results(tmp_path), keep_state="compact", report=events.append) == {}
    (sentence,) = [event.text for event in events if isinstance(event, Note)]
    assert f"The state of {run.id} is kept with its replay buffer: it was resumed where" in sentence
    assert kept_checkpoint(tmp_path, run).compact is None
    ((_, steps, _, continues),) = train(tmp_path, [jitterbug(200)])
    assert (steps, continues) == (run.last_step, run.id)


@pytest.mark.parametrize(
    ("changed", "is_whole"),
    [
        ([{"git_revision": ["a", "b"]}], False),
        ([{"processor": ["a", "b"]}], True),
        ([{"processor": ["a", "b"]}, {}], True),
        # The second note is of a compact state, which was computed again on this processor.
        ([{}, {"processor": ["a", "b"], "recomputed": True}, {"processor": ["a", "b"]}], False),
        ([{"processor": ["a", "b"], "recomputed": True}, {}], True),
        ([{"truncated": True}], True),
    ],
)
def test_rows_follow_from_actions_where_one_machine_made_them(changed, is_whole, tmp_path):
    record = Results(tmp_path).create("run", jitterbug(100).id, jitterbug(100).values)
    facts = ("recomputed", "truncated")
    notes = [
        {"changed": {name: values for name, values in note.items() if name not in facts}}
        | {name: True for name in facts if name in note}
        for note in changed
    ]
    record._update(provenance={**record.manifest.provenance, "continued": notes})
    assert (reason_for_whole_state(record) is not None) is is_whole


def test_runs_without_compact_state_are_refused_before_they_begin():
    check_state_can_be_kept([falling("td3")], "compact")
    with pytest.raises(RequestError, match="makes other episodes of the same seed and actions"):
        check_state_can_be_kept([falling("td3", task=DRIFTS)], "compact")
    several = with_small_buffer(falling("td3", parallel=2), 10)
    with pytest.raises(RequestError, match="end early in several environments; type --keep-state"):
        check_state_can_be_kept([several], "compact")


def test_two_options_for_a_state_are_refused(run_command):
    code, _, err = run_command("train", "--keep-state", "--keep-compact-state", "--dry-run")
    assert code == 2
    assert "type --keep-state or --keep-compact-state, not both" in err
