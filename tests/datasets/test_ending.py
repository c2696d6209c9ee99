"""Tests of datasets whose episodes end early."""

import numpy as np
import pyarrow as pa
import pytest
import torch

from jbench.datasets import Dataset, collect
from jbench.datasets import collect_ending as collecting
from jbench.datasets.export import export_minari
from jbench.datasets.observations import observations_schema
from jbench.datasets.rows import block as rows_block
from jbench.datasets.rows import flaw, table
from jbench.encoders.loop import EncoderLearner
from jbench.encoders.pairs import state_pairs
from jbench.encoders.registry import make_kind
from jbench.encoders.settings import encoder_settings
from jbench.encoders.states import States
from jbench.encoders.training import train_encoder
from jbench.errors import RequestError
from jbench.settings.records import DatasetSettings, dataset_robot
from jbench.store import Results
from jbench.store.rows import make_row
from jbench.tasks.find import find_task
from jbench.tasks.task import episode_generator
from tests.gym_tasks import EPISODE

LEAVES = "tests.gym_tasks:leaves"
FAR = "tests.mistaken_gym_tasks:far_limit"
STEPS = 20 * EPISODE + 7  # no multiple of the time limit


def collected(path, steps=STEPS, name=LEAVES):
    task = find_task(name)
    settings = DatasetSettings(**dataset_robot(task.name, task.specs), steps=steps)
    return Dataset(collect(settings, Results(path), threads=1))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return collected(tmp_path_factory.mktemp("ending"))


def test_episodes_are_those_of_the_environment(dataset):
    (block,) = dataset.blocks(LEAVES)
    assert dataset.control_steps == block.lengths.sum() == STEPS
    assert not dataset.has_one_length
    assert make_row(dataset.record)["steps_done"] == STEPS
    (entry,) = dataset.record.parts("seeds")
    seeds = dataset.record.read_part(entry)["seed"].to_pylist()
    env = find_task(LEAVES).environment(0).env
    for i, seed in enumerate(seeds):
        seen, _ = env.reset(seed=seed)
        np.testing.assert_allclose(block.observations[i, 0, :2], seen["cart"], rtol=1e-6)
        for step in range(block.lengths[i]):
            command = 3 * (block.actions[i, step] + 1) - 2  # of [-2, 4]
            seen, reward, terminated, truncated, _ = env.step(command[None].astype(np.float32))
            np.testing.assert_allclose(
                block.observations[i, step + 1, :2], seen["cart"], rtol=1e-4, atol=1e-6
            )
            assert block.rewards[i, step] == pytest.approx(reward, rel=1e-4, abs=1e-5)
            has_ended = step == block.lengths[i] - 1
            is_cut = i == len(seeds) - 1  # the last episode ends where the steps are complete
            assert has_ended == (terminated or truncated) or (has_ended and is_cut)
        assert block.terminated[i] == terminated


def test_a_dataset_does_not_depend_on_interruptions(dataset, tmp_path, monkeypatch):
    monkeypatch.setattr(collecting, "_PART_STEPS", 50)

    class StoppedError(Exception):
        pass

    def stop(steps):
        if steps > 130:
            raise StoppedError

    settings = dataset.settings
    results = Results(tmp_path)
    with pytest.raises(StoppedError):
        collect(settings, results, 1, stop)
    again = Dataset(collect(settings, results, threads=1))
    assert len(again.parts) > 2
    (whole,) = dataset.blocks(LEAVES)
    parts = [block.in_a_row() for block in again.blocks(LEAVES)]
    for column, one in enumerate(whole.in_a_row()):
        np.testing.assert_array_equal(one, np.concatenate([part[column] for part in parts]))


def test_episodes_of_different_lengths_are_followed_by_zeros(dataset):
    (block,) = dataset.blocks(LEAVES)
    assert len(set(block.lengths)) > 1
    for i, length in enumerate(block.lengths):
        assert not block.observations[i, length + 1 :].any()
        assert not block.actions[i, length:].any()
        assert not block.rewards[i, length:].any()
    with pytest.raises(RequestError, match="ended early and have different lengths"):
        dataset.observations(LEAVES)


def test_rows_that_are_no_whole_episodes_are_found(dataset):
    steps, seeds = (
        dataset.record.read_part(dataset.record.parts(name)[0])
        for name in ("observations", "seeds")
    )
    episodes = range(dataset.episodes)
    assert flaw(steps, seeds, episodes, EPISODE) is None
    without_first = flaw(steps.slice(1), seeds, episodes, EPISODE)
    assert without_first == "other rows than those of whole episodes in their order"
    assert flaw(steps[:0], seeds[:0], range(0), EPISODE) == "no rows"
    position = steps.column_names.index("terminated")
    ends = steps["terminated"].to_pylist()
    never = [None if end is None else False for end in ends]
    lost = steps.set_column(position, steps.schema.field(position), [never])
    without_end = flaw(lost, seeds, episodes, EPISODE)
    assert without_end == "an episode without its end, or an end within one"
    assert flaw(steps, seeds, episodes, EPISODE - 15) is not None


def test_part_whose_name_begins_with_action_is_no_action():
    names = ("action_before", "action_0", "reward")
    counts = (("episode", pa.int32()), ("step", pa.int16()))
    columns = pa.schema([*counts, *((name, pa.float32()) for name in names)])
    states = np.arange(8, dtype=np.float32).reshape(2, 4, 1)
    made = np.full((2, 3, 2), [0.5, 1.0], np.float32)
    steps = table(0, states, made, columns)
    assert flaw(steps, pa.table({"episode": [0, 1], "seed": [7, 8]}), range(2), 3) is None
    read = rows_block(steps, 1)
    np.testing.assert_array_equal(read.observations, states)
    np.testing.assert_array_equal(read.action_vectors, made[..., :1])


def test_episodes_far_below_their_time_limit_are_collected(tmp_path):
    """All actions until the limit would be 80 GB."""
    dataset = collected(tmp_path, 40, FAR)
    (block,) = dataset.blocks(FAR)
    assert block.lengths.sum() == 40
    assert len(block.lengths) > 1
    for episode, length in enumerate(block.lengths):
        random = episode_generator(dataset.settings.seed, episode)
        random.integers(2**32)  # the seed of the environment
        actions = random.uniform(-1, 1, (length, 1)).astype(np.float32)
        np.testing.assert_array_equal(block.actions[episode, :length], actions)


def test_long_episodes_have_wide_numbers_of_steps():
    def columns(steps):
        return observations_schema(find_task(f"gym:Pendulum-v1,max_episode_steps={steps}"))

    assert columns(32_767).field("step").type == pa.int16()
    assert columns(32_768).field("step").type == pa.int32()


def test_pairs_of_states_are_within_an_episode(dataset):
    states = States(dataset, LEAVES, seed=0)
    states.read(torch.device("cpu"))
    (block,) = dataset.blocks(LEAVES)
    gain, offset = states.scaling.gain_and_offset()
    for ahead in (0, 1, 3):
        pairs = list(state_pairs([*states.learn(), *states.test()], ahead, with_actions=True))
        assert sum(len(part.now) for part in pairs) == sum(
            max(0, length + 1 - ahead) for length in block.lengths
        )
        known = {
            tuple(np.concatenate([seen[t], seen[t + ahead]]).tolist())
            for seen, length in zip(block.observations * gain + offset, block.lengths, strict=True)
            for t in range(length + 1 - ahead)
        }
        found = torch.cat([torch.cat([part.now, part.later], 1) for part in pairs])
        assert {tuple(row) for row in found.tolist()} == known
    action = pairs[0].actions
    assert action.shape[1] == 3


def test_kind_that_looks_beyond_every_episode_is_refused(tmp_path):
    results, task = Results(tmp_path), find_task("tests.gym_tasks:falls")
    settings = DatasetSettings(**dataset_robot(task.name, task.specs), steps=STEPS)
    dataset = Dataset(collect(settings, results, threads=1))
    options = {"horizon": 10, "epochs": 1}  # an episode has 7 control steps, of 20 at most
    encoder = encoder_settings(
        "ddae", options, task=task.name, latents=2, dataset=dataset.record.id
    )
    with pytest.raises(
        RequestError, match="horizon=10 is beyond the end of every training episode"
    ):
        train_encoder(encoder, States(dataset, task.name, 0), results)


def test_files_without_a_pair_of_states_are_passed_over(tmp_path, monkeypatch):
    monkeypatch.setattr(collecting, "_PART_STEPS", 10)
    dataset = collected(tmp_path)
    states = States(dataset, LEAVES, 0, memory=1)
    states.read(torch.device("cpu"))
    kind = make_kind("ddae", {"horizon": EPISODE - 1, "batch": 4})
    pairs = [shard.pairs(kind.steps_ahead) for shard in states.learn()]
    assert 0 in pairs
    assert max(pairs) > 0
    assert np.isfinite(EncoderLearner(kind, states, 2).epoch())


def test_minari_has_terminations_and_truncations(dataset, tmp_path, monkeypatch):
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    id, _ = export_minari(dataset, LEAVES, tmp_path)
    loaded = minari.load_dataset(id)
    (block,) = dataset.blocks(LEAVES)
    assert len(loaded) == dataset.episodes
    for episode, length, terminated in zip(
        loaded.iterate_episodes(), block.lengths, block.terminated, strict=True
    ):
        assert len(episode.rewards) == length
        assert len(episode.observations) == length + 1
        assert episode.terminations[-1] == terminated
        assert episode.truncations[-1] == (not terminated)
        assert not episode.terminations[:-1].any()
        assert not episode.truncations[:-1].any()
