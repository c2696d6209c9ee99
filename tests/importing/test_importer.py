"""Tests of `jbench import`, which reads learning curves of other programs."""

import json
import shutil
import sys
from hashlib import sha256

import numpy as np
import pytest
from stable_baselines3.common.monitor import load_results
from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import SummaryMetadata
from tensorboard.summary.writer.event_file_writer import EventFileWriter
from tensorboard.util.tensor_util import make_tensor_proto

from jbench.cli import main
from jbench.errors import RequestError
from jbench.importing.request import parse_seed
from jbench.names import IMPORT_FORMATS
from jbench.store import Results
from jbench.store.verify import verify
from tests.importing.conftest import EPISODES
from tests.store.store_whole import snapshot


def test_monitor_files_are_read_like_stable_baselines3(sb3_files, imports, rows):
    files = sorted(sb3_files.glob("*.monitor.csv"))
    assert len(files) == 2
    assert imports("sb3-monitor", *files, seed_from=r"seed(\d+)")[0] == 0
    theirs, ours = load_results(str(sb3_files)), rows()[3]
    assert ours["episode_return"].tolist() == theirs["r"].tolist()
    assert theirs["l"].cumsum().tolist() == [20, 40, 60, 80]
    assert ours["control_steps"].tolist() == [20, 40, 60, 80]
    assert ours["length"].tolist() == [20] * 4
    assert np.allclose(ours["wall_time"], theirs["t"] - theirs["t"].iloc[0])


def test_evaluations_are_read_by_episode(sb3_files, imports, rows):
    file = sb3_files / "evaluations.npz"
    assert imports("sb3-evaluations", file, seed_from=r"seed(\d+)")[0] == 0
    ours = rows()[3]
    with np.load(file) as arrays:
        assert arrays["timesteps"].tolist() == [40, 80]
        assert ours["control_steps"].tolist() == [40, 40, 80, 80]
        assert ours["point"].tolist() == [0, 0, 1, 1]
        assert ours["episode"].tolist() == [0, 1, 0, 1]
        assert ours["episode_return"].tolist() == arrays["results"].ravel().tolist()
        assert ours["length"].tolist() == arrays["ep_lengths"].ravel().tolist()


def test_scalars_of_event_file_are_read(event_file, imports, rows):
    files = [event_file(seed, returns) for seed, returns in EPISODES.items()]
    assert imports("tensorboard", *files, seed_from=r"td3__(\d+)__")[0] == 0
    for seed, points in rows().items():
        assert points["episode_return"].tolist() == EPISODES[seed]
        assert points["control_steps"].tolist() == [1000, 2000, 3000]


def test_evaluation_tag_is_imported_as_evaluation_curve(event_file, imports, import_error, rows):
    file = event_file(1, EPISODES[1], "eval/mean_reward")
    error = import_error("tensorboard", file, seed_from=r"td3__(\d+)__")
    assert "type --tag with one of eval/mean_reward, losses/qf1_loss" in error
    more = ("--tag", "eval/mean_reward")
    assert imports("tensorboard", file, seed_from=r"td3__(\d+)__", more=more)[0] == 0
    assert rows("imports")[1]["returns"].tolist() == ["evaluation"]


def test_wandb_chart_is_read_by_run(wandb_file, imports, rows):
    assert imports("wandb-csv", wandb_file(), seed_from=r"td3__(\d+)__")[0] == 0
    curves = rows()
    assert {seed: points["episode_return"].tolist() for seed, points in curves.items()} == EPISODES
    assert curves[2]["control_steps"].tolist() == [1001, 2001, 3001]


def test_wandb_chart_requires_axis_of_control_steps(wandb_file, imports, import_error, rows):
    file = wandb_file(axis="Step")
    error = import_error("wandb-csv", file, seed_from=r"td3__(\d+)__")
    assert "choose the axis global_step in W&B, or type --steps-column 'Step'" in error
    more = ("--steps-column", "Step")
    assert imports("wandb-csv", file, seed_from=r"td3__(\d+)__", more=more)[0] == 0
    assert len(rows()) == 2


def test_options_name_columns_of_csv_file(tmp_path, imports, rows):
    file = tmp_path / "progress.csv"
    # stable-baselines3's logger leaves fields empty.
    file.write_text("run,t,r\n1,1000,100\n2,1000,50\n1,1500,\n1,2000,250.5\n2,2000,60\n")
    more = ("--steps-column", "t", "--return-column", "r", "--seed-column", "run")
    assert imports("csv", file, seed_from=None, more=more)[0] == 0
    assert rows()[1]["episode_return"].tolist() == [100, 250.5]
    assert rows()[2]["control_steps"].tolist() == [1000, 2000]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_columns_and_seeds_with_usual_names_need_no_options(separator, tmp_path, imports, rows):
    path = tmp_path / "progress.csv"
    text = "seed,global_step,return\n4,1000,5\n4,2000,6\n9,1000,7\n"
    path.write_text(text.replace(",", separator))
    assert imports("csv", path, seed_from=None)[0] == 0
    assert rows()[4]["episode_return"].tolist() == [5, 6]
    assert rows()[9]["control_steps"].tolist() == [1000]


def test_cells_of_spaces_are_empty(tmp_path, imports, rows):
    path = tmp_path / "progress.csv"
    path.write_text("seed,global_step,return, ,\n4,1000, , ,\n4,2000, 6 , ,\n")
    assert imports("csv", path, seed_from=None)[0] == 0
    assert rows()[4][["control_steps", "episode_return"]].to_numpy().tolist() == [[2000, 6]]


@pytest.mark.parametrize(
    ("text", "points"),
    [
        (
            "rollout/ep_len_mean,rollout/ep_rew_mean,time/total_timesteps\n20,,10\n20,5.5,2000\n",
            {2000: 5.5},
        ),
        ("million_steps,avg_return\n0.001,7\n0.0025,8\n", {1000: 7, 2500: 8}),
    ],
)
def test_columns_are_known_by_the_names_that_report_curves_knows(
    text, points, tmp_path, imports, rows
):
    path = tmp_path / "seed4" / "progress.csv"
    path.parent.mkdir()
    path.write_text(text)
    assert imports("csv", path)[0] == 0
    imported = rows()[4]
    assert dict(zip(imported["control_steps"], imported["episode_return"], strict=True)) == points
    assert rows("imports")[4]["returns"].tolist() == ["training"]


@pytest.mark.parametrize("returns", ["training", "evaluation"])
def test_rows_of_several_methods_are_no_curve(returns, import_error, tmp_path):
    file = tmp_path / "seed 7.csv"
    file.write_text("algo,steps,return\ntd3,1000,5\ntd3,2000,6\nsac,3000,7\n sac,4000,8\n")
    error = import_error("csv", file, more=("--returns", returns))
    assert f"{file}: seed 7 has rows of td3 and sac in the column 'algo', and an import is" in error
    assert f"by jbench report --curves '{file}'." in error


def test_runs_of_seeds_may_have_names_of_their_own(imports, rows, tmp_path):
    file = tmp_path / "runs.csv"
    file.write_text("exp_name,seed,steps,return\ntd3_s0,0,1000,5\ntd3_s1,1,1000,6\n,1,2000,7\n")
    assert imports("csv", file, seed_from=None)[0] == 0
    assert {seed: frame["episode_return"].tolist() for seed, frame in rows().items()} == {
        0: [5],
        1: [6, 7],
    }


def test_return_that_is_not_imported_is_named(imports, tmp_path):
    file = tmp_path / "seed1.csv"
    file.write_text("steps,return,eval/mean_reward\n1000,5,6\n")
    note = f"Warning: The return in {file.name} is return, not eval/mean_reward.\n"
    assert imports("csv", file)[2] == note
    assert imports("csv", file, more=("--return-column", "return"))[2] == ""


def test_repeated_import_changes_nothing_and_reports_it(monitor_file, imports, tmp_path):
    file = monitor_file(1, EPISODES[1])
    assert imports("sb3-monitor", file)[0] == 0
    before = snapshot(tmp_path / "results")
    moved = tmp_path / "again-1.csv"
    shutil.copy(file, moved)
    code, out, _ = imports("sb3-monitor", moved)
    assert (code, "imported before, nothing is changed" in out) == (0, True)
    assert "Imported 0 of 1 curves" in out
    assert snapshot(tmp_path / "results") == before


def test_order_of_files_of_equal_times_changes_nothing(monitor_file, imports, tmp_path):
    files = [tmp_path / "seed1" / f"{number}.monitor.csv" for number in (0, 1)]
    files[0].parent.mkdir()
    for file, returns in zip(files, EPISODES.values(), strict=True):
        shutil.move(monitor_file(1, returns), file)  # with episodes at 2, 4 and 6 s
    assert imports("sb3-monitor", *files, seed_from=r"seed(\d+)")[0] == 0
    code, out, _ = imports("sb3-monitor", *reversed(files), seed_from=r"seed(\d+)")
    assert (code, "Imported 0 of 1 curves" in out) == (0, True)


def test_training_in_two_event_files_is_one_curve_in_its_order(event_file, imports, rows):
    later, first = event_file(1, [700.0, 800.0], first=3), event_file(1, EPISODES[1])
    assert imports("tensorboard", later, first, seed_from=r"td3__(\d+)__")[0] == 0
    assert [*json.loads(rows("imports")[1]["files"][0]).values()] == [str(first), str(later)]
    assert rows()[1]["episode_return"].tolist() == [*EPISODES[1], 700, 800]


def test_records_keep_names_and_checksums_of_files(monitor_file, imports, rows):
    file = monitor_file(1, EPISODES[1])
    code, out, _ = imports("sb3-monitor", file, more=("--json",))
    assert code == 0
    (row,) = rows("imports")[1].to_dict("records")
    assert json.loads(row["files"]) == {sha256(file.read_bytes()).hexdigest(): str(file)}
    assert (row["points"], row["control_steps"], row["format"]) == (3, 3000, "sb3-monitor")
    assert json.loads(out)["imports"] == [
        {"id": row["import"], "seed": 1, "points": 3, "control_steps": 3000, "is_new": True}
    ]


def test_pattern_that_no_file_matches(tmp_path, import_error):
    pattern = tmp_path / "*" / "monitor.csv"  # as a shell leaves it
    error = import_error("sb3-monitor", pattern)
    assert f"No file matches {pattern}; type where the files are." in error


def test_curve_of_one_point_is_counted_as_one(tmp_path, imports):
    file = tmp_path / "seed1" / "progress.csv"
    file.parent.mkdir()
    file.write_text("global_step,return\n1000,5\n")
    code, out, _ = imports("csv", file)
    assert code == 0
    assert ": 1 point, 1,000 control steps" in out


def test_imports_are_listed_verified_merged_and_repaired(monitor_file, imports, tmp_path, capsys):
    assert imports("sb3-monitor", monitor_file(1, EPISODES[1]))[0] == 0
    results, other = tmp_path / "results", tmp_path / "other"
    assert main(["merge", str(results), "--results", str(other)]) == 0
    capsys.readouterr()
    assert main(["runs", "--imports", "--returns", "--json", "--results", str(other)]) == 0
    (line,) = json.loads(capsys.readouterr().out)["imports"]
    # The last quarter of three episodes is one.
    assert (line["algo"], line["seed"], line["episodes"], line["last_return"]) == ("td3", 1, 3, 900)
    assert main(["runs", "--algo", "td3", "--results", str(other)]) == 0
    out = capsys.readouterr().out
    assert out == f"No such runs in {other}.\nThere are imported curves, which --imports lists.\n"
    assert main(["runs", "--imports", "--results", str(other)]) == 0
    words = [line.split() for line in capsys.readouterr().out.splitlines()]
    (header,) = [line for line in words if line[:1] == ["import"]]
    assert (header[2], header[-1], "episodes" in header) == ("points", "returns", False)
    assert [(line[2], line[-1]) for line in words if "finished" in line] == [("3", "training")]
    assert verify(Results(other), 1).findings == []
    (part,) = other.rglob("*.parquet")
    part.write_bytes(part.read_bytes()[:-1])
    assert main(["verify", "--results", str(other)]) == 1
    assert main(["repair", "--results", str(other)]) == 0
    assert main(["merge", str(results), "--results", str(other)]) == 0
    assert verify(Results(other), 1).findings == []


def test_curves_of_another_robot_are_imported_and_reported(
    monitor_file, imports, undrawn, tmp_path, capsys
):
    env_id = "jbench/dmc-cheetah-run-v0"  # as Monitor writes it
    files = [monitor_file(seed, returns, env_id=env_id) for seed, returns in EPISODES.items()]
    code, out, _ = imports("sb3-monitor", *files, more=("--task", "dmc:cheetah-run"))
    assert (code, out.count("dmc.cheetah-run/td3/full/s0")) == (0, 2)
    where = ("--results", str(tmp_path / "results"))
    assert main(["report", "--json", "--format", "png", *where]) == 0
    (row,) = json.loads(capsys.readouterr().out)["configurations"]
    assert (row["task"], row["seeds"]) == ("dmc:cheetah-run", 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[: text.rindex(",")], "line 5: 2 fields, but the header has 3; the file"),
        (lambda text: text.rstrip("\r\n"), "line 5: the line has no end"),
        (lambda text: "", "is empty"),
        (lambda text: "\r\n".join(text.split("\r\n")[:1]) + "\r\n", "has a header, but no rows"),
        (lambda text: text + text, "line 6: "),
        (lambda text: text.replace("250.5", "many"), "line 4: r is 'many'"),
        (lambda text: text.replace("250.5", "nan"), "line 4: r is 'nan'"),
        (lambda text: text.replace("250.5", "-1500"), "line 4: the return is -1500"),
        (lambda text: text + "900.0,1000,1.0\r\n", "line 6: the time t goes back"),
        (lambda text: text.partition("\n")[2], "line 1: not a file of a Monitor"),
        *(
            (lambda text, t=time: text.replace("1000.0", t), "line 1: not a file of a Monitor")
            for time in ("NaN", "1e999", "9" * 400)
        ),
        (
            lambda text: text.replace('"None"', '"Jitterbug/MoveToPose-v0"'),
            "is of Jitterbug/MoveToPose-v0, which is --task move_to_pose",
        ),
        (
            lambda text: text.replace('"None"', '"jbench/dmc-cheetah-run-v0"'),
            "is of jbench/dmc-cheetah-run-v0, which is --task dmc:cheetah-run, not face_direction",
        ),
    ],
)
def test_truncated_mixed_or_empty_monitor_file_is_refused(
    change, message, monitor_file, import_error
):
    whole, broken = monitor_file(2, EPISODES[2]), monitor_file(1, EPISODES[1])
    with broken.open(newline="") as file:
        text = file.read()
    broken.write_bytes(change(text).encode())
    error = import_error("sb3-monitor", whole, broken)
    assert f"{broken}" in error
    assert message in error


@pytest.mark.parametrize("form", ["sb3-monitor", "sb3-evaluations", "tensorboard", "csv"])
def test_empty_file_and_file_of_other_format_are_refused(form, import_error, tmp_path):
    for content, name in ((b"", "empty"), (b"\x89PNG\x00\xff1234567890", "picture")):
        file = tmp_path / f"{name}1"
        file.write_bytes(content)
        assert str(file) in import_error(form, file)


def test_format_of_a_file_is_named_where_another_one_was_typed(
    monitor_file, sb3_files, event_file, import_error, tmp_path
):
    files = {
        "sb3-monitor": monitor_file(1, EPISODES[1]),
        "sb3-evaluations": sb3_files / "evaluations.npz",
        "tensorboard": event_file(1, EPISODES[1]),
    }
    for form, file in files.items():
        for other in IMPORT_FORMATS:
            if other != form:
                says = f"{file} is not of the format {other}; type --from {form}."
                assert says in import_error(other, file)

    curves = tmp_path / "curves 1.json"
    for content in ('{"walk": {}}', '[{"task": "walk"}]', '{"step": 1}\n{"step": 2}\n'):
        curves.write_text(content)
        for form in IMPORT_FORMATS:
            assert f"type: jbench report --curves '{curves}', or" in import_error(form, curves)


def test_json_in_a_comment_is_none_of_a_monitor(imports, rows, tmp_path):
    file = tmp_path / "c1.csv"
    file.write_text('# {"learning_rate": 0.1}\nsteps,return\n1000,5\n')
    assert imports("csv", file)[0] == 0
    assert rows()[1]["episode_return"].tolist() == [5]


def test_truncated_evaluations_are_refused(sb3_files, import_error, tmp_path):
    file = tmp_path / "evaluations3.npz"
    content = (sb3_files / "evaluations.npz").read_bytes()
    for length in (10, len(content) // 2, len(content) - 1):
        file.write_bytes(content[:length])
        error = import_error("sb3-evaluations", file)
        assert f"{file} is cut off, or not an evaluations.npz" in error
    np.savez_compressed(file, timesteps=np.arange(999))
    damaged = bytearray(file.read_bytes())
    damaged[60:90] = b"\xff" * 30  # of the compressed array
    file.write_bytes(damaged)
    assert f"{file} is cut off, or not an eval" in import_error("sb3-evaluations", file)
    np.savez(file, timesteps=np.arange(2), results=np.ones((2, 1)))
    assert "not of an EvalCallback" in import_error("sb3-evaluations", file)


@pytest.mark.parametrize(
    ("lengths", "message"),
    [
        (np.full(2, 1000), "not of an EvalCallback: its arrays have the shapes (2,), (2, 3)"),
        (np.full((2, 3), -1), "evaluation 1: -1 is no number of control steps"),
        (np.full((2, 3), np.nan), "evaluation 1: nan is no number of control steps"),
        (np.full((2, 3), 1e300), "evaluation 1: 1e+300 is no number of control steps"),
    ],
)
def test_evaluations_with_wrong_lengths_are_refused(import_error, tmp_path, lengths, message):
    file = tmp_path / "evaluations3.npz"
    arrays = {"timesteps": [1000, 2000], "results": np.full((2, 3), 500), "ep_lengths": lengths}
    np.savez(file, **arrays)
    assert message in import_error("sb3-evaluations", file)


def test_truncated_or_damaged_event_file_is_refused(event_file, import_error):
    file = event_file(1, EPISODES[1])
    content = file.read_bytes()
    flipped = bytearray(content)
    flipped[len(content) // 2] ^= 1
    for damaged in (content[:-1], content[: len(content) // 2], bytes(flipped)):
        file.write_bytes(damaged)
        error = import_error("tensorboard", file, seed_from=r"td3__(\d+)__")
        assert f"{file} is cut off or damaged after" in error


@pytest.mark.parametrize("content", [[1.0, 2.0], "many"])
def test_scalar_that_is_not_one_number_is_refused(content, import_error, tmp_path):
    plugin = SummaryMetadata.PluginData(plugin_name="scalars")
    value = {"tensor": make_tensor_proto(content), "metadata": {"plugin_data": plugin}}
    writer = EventFileWriter(str(tmp_path / "seed1"))
    writer.add_event(Event(summary={"value": [{"tag": "eval/mean_reward", **value}]}))
    writer.close()
    error = import_error("tensorboard", *(tmp_path / "seed1").iterdir(), seed_from=r"seed(\d+)")
    assert "a value of 'eval/mean_reward' is not one number." in error


def test_event_files_of_two_trainings_are_refused(event_file, import_error):
    one, other = event_file(1, EPISODES[1]), event_file(1, EPISODES[1], first=1)
    error = import_error("tensorboard", one, other, seed_from=r"td3__(\d+)__")
    assert "are both of seed 1 and both have values at 2,000 control steps" in error
    one.write_bytes(one.read_bytes() + other.read_bytes())
    error = import_error("tensorboard", one, seed_from=r"td3__(\d+)__")
    assert "the control steps go back from 3,000 to 2,000" in error


def test_truncated_wandb_chart_is_refused(wandb_file, import_error):
    file = wandb_file()
    content = file.read_bytes()
    for fewer in (1, 4, 9):
        file.write_bytes(content[:-fewer])
        error = import_error("wandb-csv", file, seed_from=r"td3__(\d+)__")
        assert f"{file}, line 7: " in error
        assert "cut off" in error


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("control_steps,episode_return\n1000,5\n500,6\n", "line 3: the control steps go back"),
        ("control_steps,episode_return\n1000,5\n1500.5,6\n", "line 3: 1500.5 is no number"),
        ("steps,return\n1000,5\n2000,6,7\n", "3 fields, but the header has 2; put a field that "),
        ('x,steps,return\n"a\nb",1000,5\nc,,6\n', "line 4: steps is ''"),
        ("count,return\n1000,5\n", "type --steps-column with one of count, return"),
        ("control_steps,episode_return\n1000,\n", "has no value of episode_return"),
        ("a,a\n1,2\n", "two columns 'a'"),
    ],
)
def test_invalid_csv_file_is_refused(text, message, import_error, tmp_path):
    file = tmp_path / "seed1.csv"
    file.write_text(text)
    assert message in import_error("csv", file)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seed_from": "run([0-9]+)"}, ", or add the seed to the name."),
        ({"seed_from": "seed"}, "a seed is a whole number from 0"),
        ({"seed_from": "("}, "type a regular expression"),
        ({"seed_from": None}, "type --seed-from REGEX"),
        ({"more": ("--tag", "a")}, "--tag is for tensorboard"),
        ({"more": ("--representation", "a b")}, "type letters, digits"),
        ({"algo": "../td3"}, "type letters, digits"),
        ({"more": ("--task", "dmc:cheetah-ran")}, "did you mean dmc:cheetah-run?"),
    ],
)
def test_invalid_request_is_refused(arguments, message, monitor_file, import_error):
    assert message in import_error("sb3-monitor", monitor_file(1, EPISODES[1]), **arguments)


def test_zeros_before_seed_are_not_counted_as_digits():
    assert parse_seed("0" * 5000 + "7", "") == 7
    with pytest.raises(RequestError, match="whole number"):
        parse_seed("0" * 20 + "9" * 20, "")


def test_second_file_of_seed_is_refused(tmp_path, import_error):
    files = [tmp_path / "a1.csv", tmp_path / "b1.csv"]
    for file, value in zip(files, "56", strict=True):
        file.write_text(f"control_steps,episode_return\n1000,{value}\n")
    assert "seed 1 has 2 learning curves" in import_error("csv", *files)
    assert "have the same content" in import_error("csv", files[0], files[0])


def test_missing_tensorboard_error_names_package(event_file, import_error, monkeypatch):
    loader = "tensorboard.backend.event_processing.event_file_loader"
    monkeypatch.setitem(sys.modules, loader, None)
    error = import_error("tensorboard", event_file(1, EPISODES[1]), seed_from=r"td3__(\d+)__")
    assert 'pip install "jbench[tensorboard]"' in error
