"""Reports on a file of curves of any environment, and the export of such a file."""

import gzip
import itertools
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from axe_playwright_python.sync_playwright import Axe

from jbench.cli import main
from jbench.commands import output
from jbench.errors import RequestError
from jbench.importing.curves import to_json
from jbench.importing.dialects import read_curves
from jbench.report.choices import use_choices
from jbench.report.frames import Frames
from jbench.report.request import Request, bounds_typed
from jbench.report.tables import tables
from tests.report.browser import HOSTILE, SIDEWAYS

ORACLE = Path(__file__).parents[1] / "statistics" / "rliable_oracle" / "made.json"
HEAD = "method,task,seed,steps,return\n"


def write_csv(path, curves):
    """Writes a file of curves, each the returns at 0, 1000, 2000, … steps by method, task, seed."""
    rows = [
        (*names, 1000 * number, value)
        for names, values in curves.items()
        for number, value in enumerate(values)
    ]
    pd.DataFrame(rows, columns=HEAD.strip().split(",")).to_csv(path, index=False)
    return path


def found(path, **request):
    return Frames(None, Request(curves=path, **request))


@pytest.fixture(scope="module")
def two_methods(tmp_path_factory):
    """A file of two methods on three tasks, with five seeds and returns of -2000 to 8000."""
    random = np.random.default_rng(0)
    ends = {"hopper": (3000, 6500), "walker": (-500, 200), "ant": (7000, 5000)}
    rise = 1 - np.exp(-np.arange(12) / 3)
    curves = {
        (method, task, seed): -2000 + (end + 2000 + random.normal(0, 300)) * rise
        for task, both in ends.items()
        for method, end in zip(("PPO", "TD3"), both, strict=True)
        for seed in range(5)
    }
    return write_csv(tmp_path_factory.mktemp("two") / "two.csv", curves)


def test_page_of_the_working_directory_has_its_name(tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    write_csv(tmp_path / "mine" / "c.csv", {("PPO", "hopper", 0): [1, 2]})
    monkeypatch.chdir(tmp_path / "mine")
    assert main(["report", "--curves", ".", "--format", "svg", "--out", "out"]) == 0
    assert "<title>mine: 1 run" in Path("out/index.html").read_text()


def test_numbers_over_tasks_equal_rliable(tmp_path):
    case = json.loads(ORACLE.read_text())
    thresholds, case = case["thresholds"], case["cases"][2]  # of five tasks
    # Scores from 0 to 1000 become returns in another range on each task.
    curves = {
        (method, f"task{task}", seed): -2000 + 500 * task + (task + 1) * np.array([0, 1000, score])
        for method, name in (("ours", "x"), ("theirs", "y"))
        for seed, scores in enumerate(case[name])
        for task, score in enumerate(scores)
    }
    report = found(write_csv(tmp_path / "scores.csv", curves))
    together = "all tasks, normalized"
    iqm = report.configurations.set_index("configuration").loc[f"{together} ours"]
    wanted = case["made"]["interquartile_mean"]
    assert iqm["iqm"] == pytest.approx(wanted["value"] / 1000)
    low, high = np.array(wanted["interval"]) / 1000
    near = 0.08 * (high - low)
    assert iqm[["iqm_low", "iqm_high"]].tolist() == pytest.approx([low, high], abs=near)
    (row,) = report.comparisons[report.comparisons["task"] == together].to_dict("records")
    wanted = case["made"]["probability_of_improvement"]
    assert (row["a"], row["b"], row["seeds_a"]) == ("ours", "theirs", 50)
    assert row["p"] == pytest.approx(wanted["value"])
    low, high = wanted["interval"]
    near = 0.08 * (high - low) + 0.01
    assert [row["p_low"], row["p_high"]] == pytest.approx([low, high], abs=near)
    profile = report.profiles.set_index("configuration").query("task == @together")
    profile = profile.loc[[name for name in profile.index if name.endswith("ours")]]
    places = np.searchsorted(profile["final_return"], np.array(thresholds) / 1000 - 1e-9)
    assert profile["share"].iloc[places].tolist() == pytest.approx(case["profile"])


def test_bounds_of_normalized_returns_are_those_of_the_reader(tmp_path):
    finals = {"walk": [100, 200, 300, 400], "hop,legs=1": [1, 2, 3, 4]}
    curves = {
        ("PPO", task, seed): [0, value]
        for task, values in finals.items()
        for seed, value in enumerate(values)
    }
    file = write_csv(tmp_path / "two.csv", curves)
    typed = bounds_typed(["walk=0,400", "hop,legs=1=0,2"])
    report = found(file, normalize=typed)
    together = report.configurations.set_index("task").loc["all tasks, normalized"]
    # Of 1/4, 1/2, 3/4 and 1, and of 1/2, 1, 3/2 and 2, two of eight are left out at each end.
    assert together["iqm"] == (1 / 2 + 3 / 4 + 1 + 1) / 4
    profile = report.profiles.query("task == 'all tasks, normalized'")
    assert (profile["final_return"].min(), profile["final_return"].max()) == (0, 2)
    assert "Normalized returns: of hop,legs=1, 0 is 0 and 2 is 1." in report.source.notes

    with pytest.raises(RequestError, match="no such task; it has hop,legs=1 and walk"):
        found(file, normalize=bounds_typed(["run=0,1"]))
    with pytest.raises(RequestError, match="a single task are not normalized"):
        found(file, task="walk", normalize=typed[:1])
    with pytest.raises(RequestError, match="no such task; it has no runs"):
        use_choices(replace(report.source, configurations=[]), Request(normalize=typed))


@pytest.mark.parametrize(
    "wrong", ["walk", "walk=3", "walk=3,1", "walk=a,b", "walk=nan,1", "walk=0,inf", "=0,1"]
)
def test_bounds_that_are_none_are_refused(wrong):
    with pytest.raises(RequestError, match="type a task and two returns, the lower one first"):
        bounds_typed([wrong])
    with pytest.raises(RequestError, match="walk is typed twice"):
        bounds_typed(["walk=0,1", "walk=0,2"])


def test_numbers_of_a_task_are_those_worked_out_by_hand(tmp_path):
    finals = {"PPO": [1, 2, 3, 4, 5, 6, 7, 100], "SAC": [-40, -30, -20, -10, -5, 0, 4, 8]}
    curves = {
        (method, "walk", seed): [-50, value]
        for method, values in finals.items()
        for seed, value in enumerate(values)
    }
    report = found(write_csv(tmp_path / "walk.csv", curves))
    rows = report.configurations.set_index("label")
    # Two of eight are left out at each end.
    assert rows["iqm"].to_dict() == {"PPO": 4.5, "SAC": (-20 - 10 - 5 + 0) / 4}
    (row,) = report.comparisons.to_dict("records")
    # 4 beats three runs and ties with one, 8 beats seven; PPO wins the other pairs.
    assert row["p"] == (64 - 3.5 - 7) / 64
    assert row["difference"] == 4.5 + 8.75
    assert row["text"].startswith("PPO higher by ")
    assert report.headline == "The final return with PPO, compared with SAC, is higher."
    share = report.profiles.query("label == 'SAC'").set_index("final_return")["share"]
    assert (share.iloc[0], share.iloc[-1], share.index.max()) == (1.0, 0.0, 100)
    assert share[share.index > 0].iloc[0] == 2 / 8


def test_runs_without_any_return_are_named(tmp_path):
    curves = {("PPO", "walk", seed): [1, 2 + seed] for seed in range(3)}
    curves["PPO", "walk", 7] = [None, None]
    curves["PPO", "walk", 8] = [3, None]  # which ends early
    report = found(write_csv(tmp_path / "walk.csv", curves))
    assert report.seeds["seed"].tolist() == [0, 1, 2, 8]
    (note,) = [note for note in report.notes if "left out" in note]
    assert note.startswith("1 run of walk.csv, task walk, method PPO, seed 7, has no return and ")


def test_rows_of_all_tasks_have_their_number_on_a_narrow_terminal(two_methods, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "66")
    returns, *_ = tables(found(two_methods))
    output.frame(returns.title, returns.texts(), returns.spare)
    printed, _, left_out = capsys.readouterr().out.partition("Too narrow for ")
    together = [line for line in printed.splitlines() if line.startswith(" all tasks,")]
    assert len(together) == 2
    # Normalized: from 0 to 1.
    assert all(re.search(r" [01]\.\d+ \[[01]\.\d+, [01]\.\d+\]", line) for line in together)
    assert "median" in left_out


def test_only_one_kind_of_return_and_nothing_of_the_jitterbug_is_reported(tmp_path):
    curves = {("td3", "face_direction", s): [100, 950 + s, 950 + s] for s in range(6)}
    report = found(write_csv(tmp_path / "same-name.csv", curves))
    assert report.configurations["label"].tolist() == ["td3"]
    assert report.configurations[["reached", "solved", "published"]].isna().all(axis=None)
    for name in ("baselines", "published", "verdicts", "leaderboard", "claims"):
        assert getattr(report, name).empty, name


def test_spaces_beside_commas_are_no_part_of_a_name(tmp_path):
    file = tmp_path / "c.csv"
    file.write_text(f"{HEAD}\n TD3 , hopper, 0, 1000, 5\nTD3,hopper,1,1000,7\n")
    points = read_curves(file).points
    assert points[["method", "task"]].drop_duplicates().to_numpy().tolist() == [["TD3", "hopper"]]


def test_compressed_file_is_refused_with_the_command_that_unpacks_it(tmp_path, capsys):
    file = tmp_path / "c.csv.gz"
    file.write_bytes(gzip.compress(f"{HEAD}\nTD3,hopper,0,1000,5\n".encode()))
    assert main(["report", "--curves", str(file)]) == 2
    assert f"{file} is compressed; type: gunzip {file}" in capsys.readouterr().err


def test_training_returns_are_averaged(tmp_path):
    curves = {("PPO", "walk", 0): [0, 0, 0, 0, 0, 0, 10, 30]}
    path = write_csv(tmp_path / "walk.csv", curves)
    assert found(path).seeds["final"].tolist() == [30]
    assert found(path, returns="training").seeds["final"].tolist() == [20]  # of the last quarter


def test_methods_whose_names_differ_by_case_or_a_word_are_two(tmp_path):
    curves = {(name, "walk", 0): [1, 2] for name in ("TD3", "td3", "PPO", "PPO full")}
    report = found(write_csv(tmp_path / "walk.csv", curves))
    assert set(report.configurations["label"]) == {"TD3", "td3", "PPO", "PPO full"}


@pytest.mark.slow
def test_report_has_the_files_of_results(two_methods, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "out"
    assert main(["report", "--curves", str(two_methods), "--out", str(out), "--format", "svg"]) == 0
    assert "\n| task | method | seeds |" in (out / "tables" / "final_returns.md").read_text()
    drawn = {path.stem for path in (out / "figures").iterdir()}
    assert drawn == {"algorithms", "comparisons", "returns"}  # profiles need six seeds
    assert "5 seeds of a method can't decide a comparison." in capsys.readouterr().out
    page = (out / "index.html").read_text()
    assert "file: " not in page  # what own results call a source
    for word in ("Jitterbug", "reach 900", "solved", "hand-written", "random actions", "the paper"):
        assert word not in page, word
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_page_is_accessible_and_fits_a_phone(two_methods, tmp_path, opened, scheme):
    out = tmp_path / "out"
    assert main(["report", "--curves", str(two_methods), "--out", str(out), "--format", "svg"]) == 0
    shown = opened(out / "index.html", color_scheme=scheme).page
    for fold in shown.locator("details.fold > summary").all():
        fold.click()
    assert Axe().run(shown).response["violations"] == []
    shown.set_viewport_size({"width": 390, "height": 844})
    assert shown.evaluate(SIDEWAYS) <= 0


def test_hostile_names_run_nothing(tmp_path, opened):
    names = [HOSTILE, "=cmd|' /C calc'!A0", r"\input{x} & $y$ _"]
    curves = {(name, HOSTILE, s): [s, s + 5] for name in names for s in range(6)}
    path = write_csv(tmp_path / "hostile.csv", curves)
    out = ("--out", str(tmp_path / "out"), "--format", "svg")
    assert main(["report", "--curves", str(path), *out]) == 0
    assert "=cmd" in opened(tmp_path / "out" / "index.html").page.content()
    lines = (tmp_path / "out" / "tables" / "comparisons.csv").read_text()
    assert ",=cmd" not in lines
    assert "\\input{" not in (tmp_path / "out" / "tables" / "comparisons.tex").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("curve", [[5.0], [5.0, 5.0], [0.25, 0.5], [-1e9, 1e9]])
def test_smallest_files_are_reported(curve, tmp_path, opened):
    path = write_csv(tmp_path / "small.csv", {("PPO", "walk", 3): curve})
    out = ("--out", str(tmp_path / "out"), "--format", "svg")
    assert main(["report", "--curves", str(path), *out]) == 0
    text = opened(tmp_path / "out" / "index.html").page.inner_text("h1 + button + p")
    assert text.startswith("PPO reaches a median return of ")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("method,task,seed,steps\nPPO,walk,0,1\n", "has no column 'return'"),
        (HEAD + "PPO,walk,0,1,nan\n", "line 2: return is 'nan', which is not a finite number"),
        (HEAD + "PPO,walk,0,0.5,1\n", "'PPO' on 'walk', seed 0: 0.5 is no number of steps"),
        (HEAD + "PPO,walk,-1,1,1\n", "line 2: seed is '-1'"),
        (HEAD + "PPO,walk,0,1,1\nPPO,walk,0,1,2\n", "seed 0: two returns at 1 steps"),
        (HEAD + ",walk,0,1,1\n", "'' is no name of a method"),
        (HEAD + '"a\nb",walk,0,1,1\n', "is no name of a method"),
        ("", "is empty"),
        (b"\xff" + HEAD.encode(), "it is not text (UTF-8)"),
        ('{"walk": {"PPO": {"seed_0": {"million_steps": [1], "return": []}}}}', "finite numbers"),
        ('{"walk": {"PPO": {"seed_0": {"million_steps": [1], "return": [NaN]}}}}', "'seed_0'"),
        ('{"walk": {"PPO": {"first": {"million_steps": [1], "return": [1]}}}}', "a whole number"),
        ('{"walk": [1]}', "is no JSON file of curves"),
        ('{"walk": ', "is no JSON file of curves"),
    ],
)
def test_bad_file_is_refused_in_a_sentence(text, says, tmp_path, capsys):
    path = tmp_path / "bad.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert main(["report", "--curves", str(path), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert says in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("typed", "says"),
    [
        (["--curves", "empty"], "empty is a directory without a .csv, .json, .npz or event file"),
        (["--curves", "missing.csv"], "missing.csv can't be read"),
        (["--curves", "two.csv", "--compare", "a=1", "b=2"], "exclude each other"),
        (["--curves", "two.csv", "--claims"], "exclude each other"),
        (["--curves", "two.csv", "--watch"], "exclude each other"),
        (["--curves", "two.csv", "--results", "reference"], "exclude each other"),
        (["--curves", "two.csv", "--algo", "SAC"], "hopper with PPO, TD3"),
    ],
)
def test_bad_request_is_refused(typed, says, two_methods, monkeypatch, capsys):
    monkeypatch.chdir(two_methods.parent)
    Path("empty").mkdir(exist_ok=True)
    assert main(["report", *typed]) == 2
    assert says in capsys.readouterr().err


def test_file_of_humanoidbench_is_read(tmp_path):
    path = tmp_path / "logs.json"
    # A cut of logs/hand_ablation.json of carlosferrazza/humanoid-bench.
    curve = {"million_steps": [0.0, 0.01, 0.35000000000000003], "return": [-860.0, -838.1, -429.2]}
    path.write_text(json.dumps({"push": {"Blocked DreamerV3": {"seed_0": curve}}}))
    points = read_curves(path).points
    assert points["steps"].tolist() == [0, 10_000, 350_000]
    assert points["return"].tolist() == curve["return"]
    curve["million_steps"] = [0.0, 0.01, 0.35]
    assert json.loads(to_json(points)) == {"push": {"Blocked DreamerV3": {"seed_0": curve}}}


def test_exported_curves_are_those_of_the_runs(fabric, tmp_path, capsys):
    for seed, algo in itertools.product(range(2), ("td3", "sac")):
        evaluated = {10_000: 100.0, 25_500: 300.0 + seed}
        fabric.run(np.full(30, 50.0 + seed), seed, algo=algo, evaluated=evaluated)
    file, results = tmp_path / "new" / "curves.json", str(fabric.results.path)
    assert main(["export", "--curves", str(file), "--results", results]) == 0
    task = json.loads(file.read_text())["face_direction"]
    assert [*task] == ["SAC full", "TD3 full"]
    assert task["TD3 full"] == {
        f"seed_{seed}": {"million_steps": [0.01, 0.0255], "return": [100.0, 300.0 + seed]}
        for seed in range(2)
    }
    assert found(file).seeds["final"].tolist() == [300, 301, 300, 301]
    training = ["--returns", "training", "--results", results]
    assert main(["export", "--curves", str(file), *training]) == 0
    curve = json.loads(file.read_text())["face_direction"]["SAC full"]["seed_1"]
    assert curve["return"] == [51.0] * 30
    assert curve["million_steps"][:2] == [0.001, 0.002]


def test_episodes_that_end_at_one_step_are_exported_as_their_mean(fabric, tmp_path):
    fabric.run([50.0, 70.0, 90.0, 100.0], ends=[1000, 1000, 2000, 2000])  # of two environments
    file = tmp_path / "curves.json"
    typed = ["--curves", str(file), "--returns", "training"]
    assert main(["export", *typed, "--results", str(fabric.results.path)]) == 0
    points = read_curves(file, "training").points
    assert points["steps"].tolist() == [1000, 2000]
    assert points["return"].tolist() == [60.0, 95.0]


@pytest.mark.parametrize(
    ("typed", "says"),
    [
        (["--curves", "c.json"], "No run has evaluation returns; type --returns training."),
        (["--curves", "c.json", "--format", "onnx"], "--format is not for --curves"),
        (["--returns", "training"], "--returns is not for minari"),
        (["--curves", "."], "--curves . is a directory; name a file."),
    ],
)
def test_bad_export_is_refused(typed, says, fabric, tmp_path, monkeypatch, capsys):
    fabric.run(np.full(30, 50.0))
    monkeypatch.chdir(tmp_path)
    assert main(["export", *typed, "--results", str(fabric.results.path)]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "c.json").exists()
