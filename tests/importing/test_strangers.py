"""Tests of files as other programs and people write them (tests/importing/strangers)."""

import gzip
import itertools
import json
import os
import pickle
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jbench.cli import main
from jbench.errors import RequestError
from jbench.importing.dialects import read_curves
from jbench.importing.imported_file import open_file
from jbench.importing.request import parse_seed
from jbench.importing.written_numbers import correction_of
from jbench.report.figures.marks import shortened
from jbench.report.frames import Frames
from jbench.report.request import Request

STRANGERS = Path(__file__).parent / "strangers"
LINE = pd.DataFrame(
    {
        "steps": [0, 1, 2] * 3,
        "return": [0.0, 1.0, 2.0] * 3,
        "seed": np.repeat([0, 1, 2], 3),
    }
)
"""Three seeds with the returns 0, 1, 2 after as many steps."""


def written(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", ["empty-columns", "excel-sep", "float-seed"])
def test_files_of_spreadsheets_and_data_frames_are_read(name):
    points = read_curves(STRANGERS / f"{name}.csv").points
    pd.testing.assert_frame_equal(points[[*LINE]], LINE, check_dtype=False)
    assert {*points["method"]} == {"A"}


@pytest.mark.parametrize(
    "text",
    [
        "method, task, seed, steps, return\nA, t, 0, 5, 1\n",
        "method;task;seed;steps;return\nA;t;0;5;1\n",
        "sep=;\nmethod;task;seed;steps;return\nA;t;0;5;1\n",
        "SEP=\t\nmethod\ttask\tseed\tsteps\treturn\nA\tt\t0\t5\t1\n",
        "method,task,seed,steps,return,a;b;c;d;e;f\nA,t,0,5,1,x\n",
        '"method","task","seed","steps","return","a;b;c;d;e;f"\nA,t,0,5,1,x\n',
        "method,task,seed,steps,return\nA,t,0,5,1,,\n,,,,\n",
        ",method,task,seed,steps,return\n0,A,t,0,5,1\n",
        "Method,Task,Seed,Steps,Return\r\nA,t,0.00,5.0,1e0",
        "method|task|seed|steps|return\nA|t|0|5|1\n",
        "# of my thesis, 2026\n#\n\nmethod,task,seed,steps,return\nA,t,0,5,1\n",
        "% of MATLAB\nmethod,task,seed,steps,return\nA,t,0,5,1\n",
        "# method,task,seed,steps,return\nA,t,0,5,1\n",  # numpy.savetxt
        "#,method,task,seed,steps,return\n7,A,t,0,5,1\n",
        "Method,EnvId,RandomSeed,TotalSteps,EpisodeReturn\nA,t,0,5,1\n",
        "config/algo,config/env,config/seed,global_step,eval/episodic_return\nA,t,0,5,1\n",
    ],
)
def test_separators_blanks_and_cases_of_columns_are_understood(text, tmp_path):
    (row,) = read_curves(written(tmp_path / "c.csv", text)).points.to_dict("records")
    found = (row["method"].strip(), row["task"].strip(), row["seed"], row["steps"], row["return"])
    assert found == ("A", "t", 0, 5, 1)


def test_text_of_excel_in_utf16_is_read(tmp_path):
    path = tmp_path / "c.txt"
    path.write_bytes("method\ttask\tseed\tsteps\treturn\nA\tt\t0\t5\t1\n".encode("utf-16"))
    assert read_curves(path).points["return"].tolist() == [1]


@pytest.mark.parametrize(
    ("texts", "numbers"),
    [
        (("100,5", "7"), [100.5, 7]),
        (("1,000", "0,25"), [1, 0.25]),  # only decimal commas can be meant
        (("0,123", "-0,5"), [0.123, -0.5]),
        (("1,000", "2,000"), None),
        (("1,000.5", "2,25"), None),
    ],
)
def test_commas_are_decimal_ones_where_they_can_be_no_others(texts, numbers, tmp_path):
    rows = [f"A;t;0;{step};{text}" for step, text in enumerate(texts)]
    file = written(tmp_path / "c.csv", "\n".join(["method;task;seed;steps;return", *rows]) + "\n")
    if numbers is None:
        with pytest.raises(RequestError, match="is not a finite number; write"):
            read_curves(file)
    else:
        assert read_curves(file).points["return"].tolist() == numbers


@pytest.mark.parametrize(
    ("steps", "returned", "says"),
    [
        ("1.000", "1,5", "steps is '1.000', which may be in thousands, since return has decimal "),
        ("1000", "1,5", ""),
        ("1.000", "15", ""),  # also without thousands, as "%.3f" writes it
        ("0,5", "12.345", "write 12345, or 12,345 if that is a decimal point"),
        ("1,5", "0.25", ""),  # no number has such points between thousands
    ],
)
def test_points_beside_decimal_commas_may_stand_between_thousands(
    steps, returned, says, tmp_path, import_error
):
    rows = f"seed;million_steps;return\n0;{steps};{returned}\n"
    if steps.startswith("1"):
        rows = rows.replace("million_steps", "steps").replace("1,5;0.25", "1;0.25")

    file = written(tmp_path / "c.csv", rows)
    if not says:
        assert len(read_curves(file).points) == 1
    else:
        assert says in import_error("csv", file, seed_from=None)


@pytest.mark.parametrize(
    ("text", "instead"),
    [
        ("1k", "write 1000"),
        ("1.234.567", "write 1234567"),
        ("\uff11\uff12", "write 12"),  # fullwidth digits
        ("\N{MINUS SIGN}0.5", "write -0.5"),
        ("1e400", "correct it, or remove that line"),
        ("0.5M", "write 500000"),
        ("1 000", "write 1000"),
        ("1'234.5", "write 1234.5"),
        ("1_000", "write 1000"),
        ("1.234,5", "write 1234.5"),
        ("1,234,567", "write 1234567"),
        ("1,000", "write 1000, or 1.000 if that is a decimal comma"),
        ("100,5", "write 100.5"),
        ("NaN", "remove that line"),
        ("", "remove that line"),
        ("10 ± 2", "correct it, or remove that line"),
    ],
)
def test_number_that_is_none_is_refused_with_what_to_write(text, instead, tmp_path, import_error):
    assert correction_of(text) == instead
    csv = f'control_steps,episode_return,seed\n"{text}",5,0\nx,6,0\n'
    error = import_error("csv", written(tmp_path / "c.csv", csv), seed_from=None)
    assert f"which is not a finite number; {instead}." in error


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("My results\n\nmethod,task,seed,steps,return\nA,t,0,5,1\n", "remove the lines above the"),
        (
            "My results,,,,\nmethod,task,seed,steps,return\nA,t,0,5,1\n",
            "remove the lines above the",
        ),
        ("method,task,seed,steps,return\nA,t,0,1,000,5\n", "put a field that contains ',' in quo"),
        ("method,task,seed,steps,return\nA,t,0,1,5\nA,t,0", "copy it again, or remove that line"),
        ("method,task,seed,steps,return\nA,t,seed_3,1,5\n", "; write 3."),
        ("method,task,seed,steps,return\nA,t,0,0.5,5\n", "call the column million_steps"),
        ("method,task,steps,return\nA,t,1,5\n", "or put it into a name of the path, such as seed0"),
        ("method,task,seed,steps,return\nÄ,t,0,1,5\n".encode("latin-1"), "iconv -f ENCODING"),
        ("method,task,seed,steps,return\nA,t,0,1,5\n".encode("utf-16-le"), "iconv -f ENCODING"),
        ('"Step","a - r","a - r__MIN","a - r__MAX"\n"1","1","1","1"\n', "choose the axis global_s"),
        ('"global_step","a - r","a - s"\n"1","1","1"\n', "the metrics r, s; export a chart of one"),
        (
            '"global_step","a_s1 - r","a-seed-1 - r"\n"1","1","1"\n',
            "the runs a_s1 and a-seed-1 are both seed 1 of a; write their seeds into their names",
        ),
        ('[{"method": "A"}]', 'which is [{"task": ...'),
        (b"\xff\xfe", "is empty"),  # UTF-16
        ("# only a comment\n", "has a header, but no rows"),
    ],
)
def test_refusal_says_what_to_type(text, says, tmp_path):
    path = tmp_path / "c.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(RequestError) as refused:
        read_curves(path)
    assert says in str(refused.value)


class Harm:
    """Its pickle makes a directory when it is loaded."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_files_of_other_forms_are_named_and_never_run(tmp_path):
    harm = Harm(tmp_path / "harm")
    archive = tmp_path / "made.zip"
    with zipfile.ZipFile(archive, "w") as made:
        made.writestr("c.csv", "method")
    workbook = tmp_path / "made.xlsx"
    with zipfile.ZipFile(workbook, "w") as made:
        made.writestr("xl/workbook.xml", "<workbook/>")
    contents = {
        "is a pickle": pickle.dumps(harm),
        "type: gunzip": gzip.compress(b"method"),
        "type: unxz": b"\xfd7zXZ\x00rest",
        "type: unzip": archive.read_bytes(),
        "workbook of Excel": workbook.read_bytes(),
        "Parquet": b"PAR1 and more",
        "HDF5": b"\x89HDF\r\n\x1a\n",
        "MATLAB": b"MATLAB 5.0 MAT-file",
        "git lfs pull": b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n",
        "a web page": b"\n<!DOCTYPE html><html></html>",
    }
    path = tmp_path / "curves.csv"
    for says, content in contents.items():
        path.write_bytes(content)
        with pytest.raises(RequestError, match=says):
            open_file(path)
    np.savez(tmp_path / "evaluations", timesteps=np.array([harm], object))
    with pytest.raises(RequestError, match="Object arrays cannot be loaded"):
        read_curves(tmp_path / "evaluations.npz")
    assert not harm.path.exists()


def test_cell_of_any_length_is_read(tmp_path):
    text = f"method,task,seed,steps,return,config\nA,t,0,5,1,{'x' * 200_000}\n"
    assert len(read_curves(written(tmp_path / "c.csv", text)).points) == 1


@pytest.mark.parametrize(("text", "seed"), [("0.0", 0), ("3.", 3), (" 12 ", 12), ("007.00", 7)])
def test_seed_may_be_written_as_a_float(text, seed):
    assert parse_seed(text, "") == seed


@pytest.mark.parametrize("text", ["0.5", "-1", "1e3", ".0", "nan", ""])
def test_other_numbers_are_no_seeds(text):
    with pytest.raises(RequestError, match="whole number"):
        parse_seed(text, "the seed is")


@pytest.mark.parametrize("limit", ["1e308", "-1e308", "1e300", "1.1e15"])
def test_returns_beyond_exact_numbers_are_refused(limit, tmp_path):
    text = f"method,task,seed,steps,return\nA,t,0,0,{limit}\nA,t,0,1,0\n"
    with pytest.raises(RequestError, match=r"'A' on 't', seed 0: the return .* is not between"):
        read_curves(written(tmp_path / "c.csv", text))
    with pytest.raises(RequestError, match="is not between"):
        read_curves(STRANGERS / "overflow.csv")


def test_curve_without_steps_is_refused(imports, import_error, tmp_path):
    file = STRANGERS / "no-steps.csv"
    assert "all control steps of seed 0 are 0" in import_error("csv", file, seed_from=None)
    text = "method,task,seed,steps,return\nA,t,0,0,1\nA,t,0,0,2\n"
    with pytest.raises(RequestError, match="all of its points are at 0 steps"):
        read_curves(written(tmp_path / "c.csv", text))


def test_two_returns_of_a_seed_at_a_step_are_refused(imports, import_error, rows, tmp_path):
    file = STRANGERS / "two-returns-at-a-step.csv"
    error = import_error("csv", file, seed_from=None)
    assert f"{file}: seed 0 has the returns 900 and 100 at 2,000 control steps" in error
    evaluated = import_error("csv", file, seed_from=None, more=("--returns", "evaluation"))
    assert "environments" not in evaluated
    # Episodes of a vector environment may end at one step.
    assert imports("csv", file, seed_from=None, more=("--returns", "training"))[0] == 0
    assert rows()[0]["episode_return"].tolist() == [10, 500, 900, 100]


def test_wandb_chart_whose_runs_have_semicolons_is_read(imports, rows):
    file = STRANGERS / "wandb-run-with-semicolons.csv"
    assert imports("wandb-csv", file, seed_from=r"seed(\d+)")[0] == 0
    assert rows()[1]["episode_return"].tolist() == [10, 20]


def test_evaluations_of_arrays_of_one_number_are_read(imports, rows):
    file = STRANGERS / "evaluations-seed1.npz"
    with np.load(file) as arrays:
        assert arrays["results"].ndim == 3
        returns, steps = arrays["results"].ravel(), arrays["timesteps"]
    assert imports("sb3-evaluations", file, seed_from=r"seed(\d+)")[0] == 0
    assert rows()[1]["episode_return"].tolist() == returns.tolist()
    points = read_curves(file).points
    assert points["steps"].tolist() == steps.tolist()
    assert points["return"].tolist() == pytest.approx(
        returns.reshape(len(steps), -1).mean(axis=1).tolist()
    )
    assert set(points["seed"]) == {1}


def resumed(path, first, last, **purge):
    """Writes an event file as torch does; returns it."""
    from torch.utils.tensorboard import SummaryWriter

    writer = SummaryWriter(str(path), **purge)
    for step in range(first, last + 1, 1000):
        writer.add_scalar("charts/episodic_return", step / 100 + (0.5 if purge else 0), step)
    writer.close()
    (file,) = path.iterdir()
    return file


def test_resumed_training_is_joined_as_by_tensorboard(imports, rows, tmp_path):
    """It crashed at 10,000 steps, and again at 12,000, after a checkpoint of 6,000."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    files = [
        resumed(tmp_path / "seed0_a", 1000, 10_000),
        resumed(tmp_path / "seed0_b", 7000, 12_000, purge_step=7000),
        resumed(tmp_path / "seed0_c", 9000, 20_000, purge_step=9000),
    ]
    assert imports("tensorboard", *reversed(files), seed_from=r"seed(\d+)")[0] == 0
    whole = tmp_path / "whole"
    whole.mkdir()
    joined = whole / files[0].name
    joined.write_bytes(b"".join(file.read_bytes() for file in files))
    theirs = EventAccumulator(str(joined), size_guidance={"scalars": 0}).Reload()
    steps = [event.step for event in theirs.Scalars("charts/episodic_return")]
    assert rows()[0]["control_steps"].tolist() == steps == list(range(1000, 20_001, 1000))
    assert rows()[0]["episode_return"].tolist()[5:7] == [60, 70.5]


def test_curves_of_a_resumed_training_are_joined_like_an_import(tmp_path):
    run = tmp_path / "td3" / "Hopper" / "seed3"
    resumed(run / "a", 1000, 10_000).rename(run / "events.out.tfevents.1")
    resumed(run / "b", 7000, 12_000, purge_step=7000).rename(run / "events.out.tfevents.2")
    read = read_curves(tmp_path, "training")
    assert {(*row,) for row in read.points[["task", "method", "seed"]].to_numpy()} == {
        ("Hopper", "td3", 3)
    }
    assert read.points["steps"].tolist() == list(range(1000, 12_001, 1000))
    assert read.points["return"].tolist()[5:7] == [60, 70.5]
    assert "The 2 event files of td3 on Hopper, seed 3, are read as one training" in str(read.notes)

    resumed(run / "c", 12_000, 13_000).rename(run / "events.out.tfevents.3")
    with pytest.raises(RequestError, match="both have values at 12,000 control steps: they are"):
        read_curves(tmp_path, "training")


def test_seed_of_a_path_is_read_only_for_a_file_without_one(tmp_path):
    folder = tmp_path / f"seed{1 << 70}"
    folder.mkdir()
    points = written(folder / "a.csv", "method,task,seed,steps,return\nA,t,5,1,1\n")
    assert read_curves(points).points["seed"].tolist() == [5]
    without = written(folder / "b.csv", "method,task,steps,return\nA,t,1,1\n")
    with pytest.raises(RequestError, match=f"{1 << 70}'; a seed is a whole number from 0 up to"):
        read_curves(without)


def test_single_file_with_a_restart_is_read_as_by_tensorboard(imports, rows, tmp_path):
    parts = [
        resumed(tmp_path / "a", 1000, 5000),
        resumed(tmp_path / "b", 3000, 6000, purge_step=3000),
    ]
    file = tmp_path / f"seed4.{parts[0].name}"
    file.write_bytes(b"".join(part.read_bytes() for part in parts))
    assert imports("tensorboard", file, seed_from=r"seed(\d+)")[0] == 0
    assert rows()[4]["episode_return"].tolist() == [10, 20, 30.5, 40.5, 50.5, 60.5]


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_scalar_that_is_not_finite_is_named(value, event_file, import_error):
    file = event_file(1, [value, 5.0])
    error = import_error("tensorboard", file, seed_from=r"td3__(\d+)__")
    assert f"the return is {value:g}, which is not a finite number." in error


def test_long_names_that_are_cut_stay_different():
    report = Frames(None, Request(curves=STRANGERS / "long-names.csv"))
    names = [*report.configurations["label"].unique()]
    assert len({*shortened(names)}) == len(names) == 2
    assert "sac" in "".join(shortened(names))
    assert shortened(["short", "other"]) == ["short", "other"]
    random = np.random.default_rng(0)
    for _ in range(100):
        letters = [random.choice([*"ab"], 60) for _ in range(6)]
        many = [f"{'x' * 30}{''.join(word)}{'y' * 30}" for word in letters]
        cut = shortened(many)
        assert len({*cut}) == len({*many})
        assert max(map(len, cut)) <= 40


SIMBA = """,exp_name,env_name,seed,metric,env_step,value
0,bro,dog-run,1,avg_return,25000,0.5
1,bro,dog-run,1,avg_return,50000,10.5
2,bro,dog-run,1,success,25000,0
3,bro,dog-run,1,success,50000,1
"""


@pytest.mark.parametrize(
    ("name", "text", "labels", "points"),
    [
        ("simba.csv", SIMBA, ("bro", "dog-run", 1), [(25_000, 0.5), (50_000, 10.5)]),
        (
            "dreamerv3/dog-run.csv",  # as in results/ of TD-MPC2
            "step,reward,seed\n0,0.3,3\n100000,85.3,3\n",
            ("dreamerv3", "dog-run", 3),
            [(0, 0.3), (100_000, 85.3)],
        ),
        (
            "h1.csv",
            "algorithm,env,seed,million_steps,return\nSAC,h1-walk,0,0.35,7\n",
            ("SAC", "h1-walk", 0),
            [(350_000, 7)],
        ),
        (
            "mine.csv",
            "algo,env,seed,global_step,episodic_return\nmine,hopper,2,1000,5\nmine,hopper,2,2000,\n",
            ("mine", "hopper", 2),
            [(1000, 5)],
        ),
        (
            "td3/td3_s4/progress.txt",  # of Spinning Up
            "Epoch\tAverageEpRet\tAverageTestEpRet\tTotalEnvInteracts\n1\t10\t11\t4000\n",
            ("td3", "td3", 4),
            [(4000, 11)],
        ),
        (
            "sac/hopper/seed2/progress.csv",  # of stable-baselines3's CSV logger
            "time/total_timesteps,rollout/ep_rew_mean,eval/mean_reward\n100,1,\n200,2,3\n",
            ("sac", "hopper", 2),
            [(200, 3)],
        ),
        (
            "rllib/PPO/progress.csv",
            "env_runners/episode_return_mean,num_env_steps_sampled_lifetime,config/seed\n5,40,1\n",
            ("rllib", "PPO", 1),
            [(40, 5)],
        ),
        (
            "dreamerv3.json",
            '[{"task": "pong", "method": "dreamer", "seed": "5", "xs": [0, 9], "ys": [1, 2]}]',
            ("dreamer", "pong", 5),
            [(0, 1), (9, 2)],
        ),
        (
            "hopper.csv",  # a chart of W&B
            '"global_step","sac-seed-3 - eval/return","sac-seed-3 - eval/return__MIN"\n'
            '"100","1","0"\n"150","",""\n"200","2","1"\n',
            ("sac", "hopper", 3),
            [(100, 1), (200, 2)],
        ),
        (
            "chart.csv",
            '"global_step","Ant-v4__td3__2__1700000000 - charts/episodic_return"\n"100","1"\n',
            ("td3", "Ant-v4", 2),
            [(100, 1)],
        ),
        (
            "ppo.csv",  # one method
            "env_id,seed,step,env_step,score\nant,0,3,3000,4\n",
            ("ppo", "ant", 0),
            [(3000, 4)],
        ),
    ],
)
def test_dialects_of_the_field_are_read(name, text, labels, points, tmp_path):
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    read = read_curves(written(path, text)).points
    assert read[["method", "task", "seed"]].drop_duplicates().values.tolist() == [[*labels]]
    assert read[["steps", "return"]].values.tolist() == [list(point) for point in points]


def test_several_metrics_that_may_be_returns_are_refused(tmp_path):
    text = SIMBA.replace("success", "episode_reward")
    with pytest.raises(RequestError, match="avg_return and episode_reward are returns: keep"):
        read_curves(written(tmp_path / "c.csv", text))
    text = SIMBA.replace("avg_return", "train/critic_loss")
    with pytest.raises(RequestError, match="none is a return: keep the rows of one, or call it"):
        read_curves(written(tmp_path / "c.csv", text))


@pytest.mark.parametrize(("metric", "noted"), [("critic_loss", True), ("avg_return", False)])
def test_only_metric_is_shown_and_noted_unless_it_is_a_return(metric, noted, tmp_path):
    text = SIMBA.replace("avg_return", metric)
    rows = [line for line in text.splitlines() if "success" not in line]
    read = read_curves(written(tmp_path / "c.csv", "\n".join(rows)))
    assert read.points["return"].tolist() == [0.5, 10.5]
    note = "c.csv has one metric, critic_loss, taken for the return."
    assert (note in read.notes) == noted


@pytest.mark.parametrize("metric", ["eval/avg_return", "eval_return", "test/eval_episode_reward"])
def test_metric_in_a_group_of_a_tracker_is_a_return(metric, tmp_path):
    text = SIMBA.replace("avg_return", metric)
    read = read_curves(written(tmp_path / "c.csv", text))
    assert read.points["return"].tolist() == [0.5, 10.5]


def test_folder_with_a_file_for_each_task_is_one_set(tmp_path):
    for task, value in itertools.product(("walk", "run"), (3,)):
        written(tmp_path / f"{task}.csv", f"method,step,reward,seed\nA,0,{value},0\n")
    file = read_curves(tmp_path)
    assert file.points["task"].tolist() == ["run", "walk"]
    assert "walk.csv has no column with the task; it is called walk, as the file." in file.notes


def test_folder_may_have_files_of_monitors_beside_others(tmp_path):
    written(tmp_path / "a.csv", "method,task,seed,steps,return\nA,t,0,1000,5\nA,t,0,2000,6\n")
    head = '#{"t_start": 1.0, "env_id": "hopper"}'
    written(tmp_path / "b.csv", f"{head}\nr,l,t\n1.0,10,0.1\n2.0,10,0.2\n")
    points = read_curves(tmp_path, "training").points
    assert points["task"].tolist() == ["hopper", "hopper", "t", "t"]
    assert points["steps"].tolist() == [10, 20, 1000, 2000]


def test_return_that_is_not_shown_is_named(tmp_path):
    text = "method,task,seed,steps,episodic_return,score\nA,t,0,1,5,6\n"
    file = read_curves(written(tmp_path / "c.csv", text))
    assert file.notes == ["The return in c.csv is episodic_return, not score."]


def test_folder_has_files_in_any_case_and_no_hidden_ones(tmp_path):
    curves = "method,task,seed,steps,return\nA,t,0,1,5\n"
    written(tmp_path / "A.CSV", curves)
    (tmp_path / ".ipynb_checkpoints").mkdir()
    written(tmp_path / ".ipynb_checkpoints" / "A-checkpoint.csv", curves)
    (tmp_path / "._A.csv").write_bytes(b"\0\5\x16\7\0")  # of macOS
    for name in ("of-plots.csv", "manifest.json"):
        (tmp_path / name).mkdir()
        written(tmp_path / name / "plot.txt", "")

    file = read_curves(tmp_path)
    assert file.points["return"].tolist() == [5]
    assert file.notes == []


@pytest.mark.parametrize("mark", ["utf-16", "utf-8-sig", "twice"])
def test_mark_of_an_encoding_is_no_part_of_the_text(mark, tmp_path):
    texts = {
        "c.json": '{"t": {"A": {"seed_0": {"million_steps": [1], "return": [5]}}}}',
        "c.csv": "task,method,seed,steps,return\nt,A,0,1000000,5\n",
        "m.csv": '#{"t_start": 1.0, "env_id": "t"}\nr,l,t\n5,1000000,1\n',
    }
    for name, text in texts.items():
        content = text.encode(mark.replace("twice", "utf-8-sig"))
        if mark == "twice":
            content = "\ufeff".encode() + content

        (tmp_path / name).write_bytes(content)
        points = read_curves(tmp_path / name, "training").points
        assert points[["task", "steps", "return"]].to_numpy().tolist() == [["t", 1_000_000, 5]]


def test_seeds_in_folders_are_of_one_task(tmp_path):
    for seed in range(2):
        run = tmp_path / "td3" / "hopper" / f"seed{seed}"
        run.mkdir(parents=True)
        returns = np.full((2, 3), 5.0)
        np.savez(run / "evaluations", timesteps=[10, 20], results=returns, ep_lengths=returns)
    points = read_curves(tmp_path).points
    assert points[["method", "task"]].drop_duplicates().values.tolist() == [["td3", "hopper"]]
    assert points["seed"].tolist() == [0, 0, 1, 1]


@pytest.mark.parametrize(
    ("returns", "says"), [([], "no evaluation"), ([[1, np.nan]], "ation 1: n")]
)
def test_evaluations_without_a_number_are_refused(returns, says, tmp_path):
    arrays = np.reshape(np.array(returns, float), (len(returns), 2))
    file = tmp_path / "evaluations.npz"
    np.savez(file, timesteps=np.arange(len(arrays)), results=arrays, ep_lengths=arrays)
    with pytest.raises(RequestError, match=says):
        read_curves(file)


def events(folder, values):
    """Writes an event file as torch does: by tag, the value at each step."""
    from torch.utils.tensorboard import SummaryWriter

    writer = SummaryWriter(str(folder))
    for tag, points in values.items():
        for step, value in points:
            writer.add_scalar(tag, value, step)
    writer.close()


def test_tensorboard_files_of_cleanrl_and_stable_baselines3_are_read(tmp_path):
    for seed in (1, 2):
        run = tmp_path / "runs" / f"Hopper-v4__td3_continuous__{seed}__1700000000"
        # Two environments ended at one step.
        events(run, {"charts/episodic_return": [(100, 10), (100, 20), (200, 30 + seed)]})
    file = read_curves(tmp_path / "runs")
    assert file.points.values.tolist() == [
        ["Hopper-v4", "td3_continuous", seed, step, value]
        for seed in (1, 2)
        for step, value in ((100, 15), (200, 30 + seed))
    ]
    assert "Values of charts/episodic_return at the same step of a run are averaged." in file.notes
    values = {"eval/mean_reward": [(10, 1)], "rollout/ep_rew_mean": [(9, 3)], "loss": [(1, 0)]}
    events(tmp_path / "sac" / "hopper_2", values)
    (one,) = read_curves(tmp_path / "sac").points.values.tolist()
    assert one == ["hopper", "sac", 2, 10, 1]
    (one,) = read_curves(tmp_path / "sac", "training").points.values.tolist()
    assert one[3:] == [9, 3]
    events(tmp_path / "other", {"loss": [(1, 0)]})
    with pytest.raises(RequestError, match="write a CSV file of one of its tags: loss"):
        read_curves(tmp_path / "other")


def test_folders_of_stable_baselines3_are_named_after_its_classes(tmp_path):
    for folder in ("Hopper-v4/PPO_1", "Hopper-v4/TD3_2", "Walker2d-v4/td3/TD3_1"):
        events(tmp_path / "tb" / folder, {"rollout/ep_rew_mean": [(9, 3)]})
    points = read_curves(tmp_path / "tb").points
    assert points[["task", "method", "seed"]].values.tolist() == [
        ["Hopper-v4", "PPO", 1],
        ["Hopper-v4", "TD3", 2],
        ["Walker2d-v4", "TD3", 1],
    ]


def test_event_file_of_a_program_that_ended_at_once_is_left_out(tmp_path):
    for seed in (1, 2):
        run = tmp_path / "runs" / f"Hopper-v4__td3__{seed}__1700000000"
        events(run, {"charts/episodic_return": [(100, 10)], "rollout/ep_rew_mean": [(100, 9)]})
    events(tmp_path / "runs" / "Hopper-v4__td3__3__1700000000", {})
    file = read_curves(tmp_path / "runs")
    assert file.points["seed"].tolist() == [1, 2]
    paths, tags, empty, smoothed = file.notes
    assert paths.startswith("2 files such as Hopper-v4__td3__1__1700000000/events.out.tfevents.")
    assert paths.endswith(": method td3, task Hopper-v4 and seeds 1, 2 are those of their paths.")
    assert tags.startswith("Of the tags in 2 event files such as events.out.tfevents.")
    assert tags.endswith(", charts/episodic_return is shown, not rollout/ep_rew_mean.")
    assert empty.startswith("Hopper-v4__td3__3__1700000000/events.out.tfevents.")
    assert empty.endswith(" has no scalar and is left out.")
    assert smoothed.startswith("Each return of charts/episodic_return is that of a training episo")
    assert smoothed not in read_curves(tmp_path / "runs", "training").notes
    for folder in tmp_path.glob("runs/*__[12]__*"):
        shutil.rmtree(folder)
    with pytest.raises(RequestError, match="write a CSV file of one of its tags: none"):
        read_curves(tmp_path / "runs")


def test_other_kinds_of_files_in_a_folder_are_counted_and_reports_are_no_curves(tmp_path, undrawn):
    curves = "method,task,seed,steps,return\nA,t,0,0,1\nA,t,0,9,2\n"
    (tmp_path / "mine").mkdir()
    written(tmp_path / "mine" / "a.csv", curves)
    out = ("--out", str(tmp_path / "mine" / "a-report"), "--format", "svg")
    assert main(["report", "--curves", str(tmp_path / "mine"), *out]) == 0
    assert (tmp_path / "mine" / "a-report" / "tables" / "final_returns.csv").exists()
    record = tmp_path / "mine" / "results" / "runs" / "walk"
    record.mkdir(parents=True)
    written(record / "manifest.json", '{"schema_version": 5}')
    assert read_curves(tmp_path / "mine").points["return"].tolist() == [1, 2]
    with pytest.raises(RequestError, match=r"of jbench; type --results .*results instead of --cur"):
        read_curves(tmp_path / "mine" / "results")
    run = tmp_path / "mine" / "sac" / "Hopper-v4_1"
    monitor(run / "0.monitor.csv", [(5, 100, 1.0)])
    file = read_curves(tmp_path / "mine")
    assert file.points["return"].tolist() == [5]
    assert file.notes == [
        "The folder has files such as 0.monitor.csv, so 1 file such as mine/a.csv is left out; "
        "name a file, or a folder that has files of one kind.",
        "Hopper-v4_1/0.monitor.csv: method sac and seed 1 are those of its path.",
        "Each return of a Monitor is that of a training episode; --returns training smooths them, "
        "and takes the mean of the last ones as final return.",
    ]


def test_file_of_a_second_monitor_is_refused_with_its_line(tmp_path):
    file = monitor(tmp_path / "0.monitor.csv", [(5, 100, 1.0)])
    file.write_text(file.read_text() * 2)
    with pytest.raises(RequestError, match="line 4: the file of a second Monitor was appended"):
        read_curves(file)


def monitor(path, episodes, start=1000.0, env_id="Hopper-v4"):
    lines = [f"#{json.dumps({'t_start': start, 'env_id': env_id})}", "r,l,t"]
    path.parent.mkdir(parents=True, exist_ok=True)
    return written(path, "\n".join([*lines, *(f"{r},{n},{t}" for r, n, t in episodes)]) + "\n")


def test_folder_of_rl_zoo_is_read(tmp_path):
    for seed in (1, 2):
        run = tmp_path / "logs" / "sac" / f"Hopper-v4_{seed}"
        monitor(run / "0.monitor.csv", [(5, 100, 1.0), (7, 100, 3.0)])
        monitor(run / "1.monitor.csv", [(6, 50, 2.0)])
        returns = np.array([[1.0, 3], [5, 7]])[..., None]
        np.savez(run / "evaluations", timesteps=[10, 20], results=returns, ep_lengths=returns)
    file = read_curves(tmp_path / "logs")
    assert file.points["return"].tolist() == [2, 6] * 2
    assert file.points[["method", "task"]].drop_duplicates().values.tolist() == [
        ["sac", "Hopper-v4"]
    ]
    assert file.points["seed"].tolist() == [1, 1, 2, 2]
    training = read_curves(tmp_path / "logs", "training").points
    assert training["steps"].tolist() == [100, 150, 250] * 2
    assert training["return"].tolist() == [5, 6, 7] * 2


def test_monitor_with_a_restart_is_read_as_one_training_with_a_note(tmp_path, undrawn):
    episodes = [(5, 100, 1.0), (7, 100, 3.0), (8, 100, 0.5), (9, 100, 2.0)]
    file = read_curves(monitor(tmp_path / "sac" / "Hopper-v4_3" / "0.monitor.csv", episodes))
    assert file.points["steps"].tolist() == [100, 200, 300, 400]
    assert file.points["return"].tolist() == [5, 7, 8, 9]
    assert any("The time goes back 1 time in 0.monitor.csv" in note for note in file.notes)
    out = ("--out", str(tmp_path / "out"), "--format", "svg")
    assert main(["report", "--curves", str(tmp_path), *out]) == 0


def test_headline_says_after_how_many_steps(tmp_path):
    rows = [
        f"{name},t,{seed},{step},{value}"
        for name, end, value in (("long", 14_000_000, 862), ("short", 1_000_000, 500))
        for seed in range(6)
        for step in (0, end)
    ]
    file = written(tmp_path / "c.csv", "\n".join(["method,task,seed,steps,return", *rows]) + "\n")
    headline = Frames(None, Request(curves=file)).headline
    assert "after 1M control steps" in headline


def test_headline_of_one_method_has_the_range_of_its_seeds(tmp_path):
    rows = ["A,t,0,0,1", "A,t,0,500,3", "A,t,1,0,1", "A,t,1,2000,5", "A,t,1,3000,7"]
    file = written(tmp_path / "c.csv", "\n".join(["method,task,seed,steps,return", *rows]) + "\n")
    frames = Frames(None, Request(curves=file))
    assert frames.headline == "A reaches a median return of 5 on t after 500 to 3k control steps."
    assert "t A: seeds of unequal length, 2 to 3 points." in frames.notes
