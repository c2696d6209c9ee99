"""Fixtures of import tests: files written by stable-baselines3, TensorBoard or as W&B does."""

import gymnasium
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from jbench.cli import main
from jbench.registration import environment_id, register_environments

EPISODES = {1: [100.0, 250.5, 900.0], 2: [50.0, 60.0, 70.0]}
"""Returns by seed of the synthetic files."""


@pytest.fixture(scope="session")
def sb3_files(tmp_path_factory):
    """Files of a small PPO training of seed 3 in two environments with short episodes."""
    register_environments()
    place = tmp_path_factory.mktemp("sb3") / "seed3"

    def monitored(name):
        env = gymnasium.make(environment_id("face_direction"), max_episode_steps=20)
        return Monitor(env, name and str(place / name))

    environments = DummyVecEnv([lambda: monitored("0"), lambda: monitored("1")])
    evaluated = DummyVecEnv([lambda: monitored(None)])
    typed = {"n_eval_episodes": 2, "eval_freq": 20, "log_path": str(place), "verbose": 0}
    callback = EvalCallback(evaluated, **typed)
    short = {"n_steps": 10, "n_epochs": 1, "batch_size": 20, "policy_kwargs": {"net_arch": [4]}}
    model = PPO("MlpPolicy", environments, seed=3, **short)
    model.learn(80, callback=callback)
    return place


@pytest.fixture
def event_file(tmp_path):
    """Returns a function that writes an event file as CleanRL does."""
    from tensorboard.compat.proto.event_pb2 import Event
    from torch.utils.tensorboard import SummaryWriter

    def write(seed, returns, tag="charts/episodic_return", first=0):
        writer = SummaryWriter(str(tmp_path / f"td3__{seed}__{first}"))
        for index, value in enumerate(returns):
            writer.add_scalar("losses/qf1_loss", 0.5, (first + index) * 1000 + 500)
            writer.add_scalar(tag, value, (first + index + 1) * 1000)
        writer.file_writer.add_event(Event(graph_def=b"of the network"))
        writer.close()
        (path,) = (tmp_path / f"td3__{seed}__{first}").iterdir()
        return path

    return write


@pytest.fixture
def monitor_file(tmp_path):
    """Returns a function that writes a Monitor file with stable-baselines3's writer."""
    from stable_baselines3.common.monitor import ResultsWriter

    def write(seed, returns, **header):
        path = tmp_path / f"seed{seed}.monitor.csv"
        writer = ResultsWriter(str(path), {"t_start": 1000.0, "env_id": "None", **header})
        for index, value in enumerate(returns):
            writer.write_row({"r": round(float(value), 6), "l": 1000, "t": (index + 1) * 2.0})
        writer.close()
        return path

    return write


@pytest.fixture
def wandb_file(tmp_path):
    """Returns a function that writes the CSV of a chart as W&B does, with no final line break."""

    def write(axis="global_step", metric="charts/episodic_return"):
        names = [f"face__td3__{seed}__169 - {metric}" for seed in EPISODES]
        header = [axis, *(f"{name}{end}" for name in names for end in ("", "__MIN", "__MAX"))]
        lines = [header]
        for index in range(3):
            for position, returns in enumerate(EPISODES.values()):
                fields = [""] * 6
                fields[3 * position : 3 * position + 3] = [str(returns[index])] * 3
                # Each run logs at different steps.
                lines.append([str((index + 1) * 1000 + position), *fields])
        path = tmp_path / "wandb_export_2026-11-22T10_00_00.000+00_00.csv"
        path.write_text("\n".join(",".join(f'"{f}"' for f in line) for line in lines))
        return path

    return write


@pytest.fixture
def imports(tmp_path, capsys):
    """Returns a function that runs `jbench import`: exit code, standard output, standard error."""

    def run(form, *files, algo="td3", seed_from=r"(\d+)\D*$", more=()):
        where = ("--results", str(tmp_path / "results"))
        seed = () if seed_from is None else ("--seed-from", seed_from)
        typed = ("--from", form, "--task", "face_direction", "--algo", algo, *seed, *more)
        capsys.readouterr()
        code = main(["import", *typed, *where, *map(str, files)])
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run


@pytest.fixture
def import_error(imports, tmp_path):
    def run(form, *files, **options):
        code, out, err = imports(form, *files, **options)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert not (tmp_path / "results").exists()
        return err

    return run


@pytest.fixture
def rows(tmp_path):
    from jbench.store import Results, query

    def read(name="import_points"):
        joined = "SELECT seed, p.* FROM import_points p JOIN imports USING (import)"
        sql = "FROM imports" if name == "imports" else f"{joined} ORDER BY point, episode"
        rows, problems, _ = query.query_results(Results(tmp_path / "results"), sql)
        assert problems == []
        return {int(seed): frame for seed, frame in rows.groupby("seed")}

    return read
