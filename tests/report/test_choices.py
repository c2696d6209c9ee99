"""Tests of what a reader chooses for a paper, and of reports on tasks of their own."""

import json
import re

import numpy as np
import pandas as pd
import pytest

from jbench.cli import main
from jbench.report import page
from jbench.report.figures import charts
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.store import record_files, schema

FINALS = {"full": 160.0, "dae4": 60.0}


def add_runs(fabric, seeds=6, **settings):
    """Adds short runs, of three evaluations each."""
    for name, final in FINALS.items():
        for seed in range(seeds):
            returns = np.linspace(10, final + seed, 30)
            evaluated = {
                step: float(returns[step // 1000 - 1]) for step in (10_000, 20_000, 30_000)
            }
            fabric.run(returns, seed, representation=name, evaluated=evaluated, **settings)


def add_random(fabric, task, returns, **specs):
    """Adds an evaluation of random actions on a task, with what it records of the task."""
    record = fabric.results.create(
        "evaluation",
        "random/e1",
        {"task": task, "policy": "random", "episodes": len(returns), **specs},
    )
    columns = {"evaluation": "random/e1", "episode": range(len(returns)), "length": 1000}
    rows = pd.DataFrame({**columns, "episode_return": returns})
    record.append(
        {"policy_episodes": record_files.to_table(rows, schema.TABLES["policy_episodes"])}
    )
    record.finish({"median": float(np.median(returns))})


def report(fabric, out, *typed):
    where = ["--results", str(fabric.results.path), "--out", str(out)]
    return main(["report", *where, "--format", "svg", *typed])


@pytest.mark.slow
def test_latex_table_fits_a_column_and_explains_its_words(fabric, out):
    add_runs(fabric)
    assert report(fabric, out) == 0
    text = (out / "tables" / "final_returns.tex").read_text()
    header = "algorithm & representation & seeds & \\multicolumn{2}{c}{median}"
    assert (
        f"\n{header} \\\\\n\\midrule\n\\multicolumn{{5}}{{@{{}}l}}{{\\emph{{face\\_direction}}}}"
        in text
    )
    (caption,) = re.findall(r"\\caption\{(.*)\}", text)
    assert caption.startswith("Final evaluation returns. Mean return of a run's last evaluation")
    assert "95\\% interval" in caption
    assert "IQM" not in caption
    assert report(fabric, out, "--table-columns", "algorithm, IQM,detectable,over the run") == 0
    text = (out / "tables" / "final_returns.tex").read_text()
    heads = [f"\\multicolumn{{2}}{{c}}{{{name}}}" for name in ("IQM", "over the run")]
    assert f"\nalgorithm & {heads[0]} & detectable & {heads[1]} \\\\\n" in text
    for words in ("IQM: mean without", "Detectable: smallest", "Over the run: IQM of"):
        assert words in text
    assert report(fabric, out, "--table-columns", "all") == 0
    assert "steps to 900" in (out / "tables" / "final_returns.tex").read_text()


def test_asked_columns_that_a_file_lacks_are_noted(tmp_path, out, undrawn, capsys):
    rows = [f"a,t,{seed},{step},{step}" for seed in range(3) for step in (1000, 2000)]
    file = tmp_path / "curves.csv"
    file.write_text("\n".join(["method,task,seed,steps,return", *rows]))
    asked = ("--table-columns", "method,median,s,published median")
    where = ("--curves", str(file), "--out", str(out), "--format", "svg")
    assert main(["report", *where, *asked]) == 0
    note = (
        "tables/final_returns.tex is without the columns s and published median, of which no row "
        "has a value."
    )
    assert note in capsys.readouterr().out
    assert note in (out / "index.html").read_text()


def test_unknown_column_or_name_is_refused_before_anything_is_written(fabric, out, capsys):
    add_runs(fabric, seeds=1)
    assert report(fabric, out, "--table-columns", "mean") == 2
    assert "there is no such column; type all, or some of task, " in capsys.readouterr().err
    assert report(fabric, out, "--table-columns", "") == 2
    assert "--table-columns : there is no such column; type all," in capsys.readouterr().err
    assert report(fabric, out, "--names", "six=ours") == 2
    assert "the report has no six; it has dae4, full." in capsys.readouterr().err.replace(
        "full, dae4", "dae4, full"
    )
    assert report(fabric, out, "--names", "dae4=ours,full=all of it") == 2
    assert "type --names for each name, as in --names dae4=ours --names full=all of it." in (
        capsys.readouterr().err
    )
    assert report(fabric, out, "--names", "full=a", "--names", "full=b") == 2
    assert "--names full=b: full is called a already" in capsys.readouterr().err
    assert report(fabric, out, "--names", "dae=full") == 2
    assert re.search(
        "(full and dae4|dae4 and full) would both be called full;", capsys.readouterr().err
    )
    assert report(fabric, out, "--names", "six") == 2
    assert "such as --names six-rows=ours" in capsys.readouterr().err
    assert not (out / "index.html").exists()


def test_two_representations_may_exchange_their_names(fabric):
    add_runs(fabric, seeds=1)
    found = Frames(fabric.results, Request(names=(("full", "dae4"), ("dae4", "full"))))
    finals = found.lead(found.configurations).set_index("representation")["median"]
    assert finals.to_dict() == {"full": FINALS["dae4"], "dae4": FINALS["full"]}


@pytest.mark.parametrize("old", ["dae4", pytest.param("dae", marks=pytest.mark.slow)])
def test_representation_is_shown_by_its_chosen_name_everywhere(old, fabric):
    add_runs(fabric)
    found = Frames(fabric.results, Request(names=((old, "ours"),)))
    assert set(found.configurations["representation"]) == {"full", "ours"}
    assert set(found.curves["label"]) == {"TD3 full", "TD3 ours"}
    text = page.render(found, charts(found))
    assert "with ours" in found.headline
    body = text.partition("<dialog")[0]
    # The matrix and the commands are to be typed, by the names that jbench knows.
    shown = re.sub(r"<pre.*?</pre>", "", body, flags=re.DOTALL)
    assert "dae4" not in shown


def test_sizes_of_a_renamed_kind_stay_apart(fabric):
    for name in ("dae4", "dae8"):
        fabric.flat([100.0] * 3, representation=name)
    found = Frames(fabric.results, Request(names=(("dae", "ours"),)))
    assert set(found.curves["representation"]) == {"ours4", "ours8"}


def test_method_of_a_file_is_renamed(tmp_path):
    file = tmp_path / "c.csv"
    file.write_text("method,task,seed,steps,return\nA,t,0,5,1\nB,t,0,5,2\n")
    found = Frames(None, Request(curves=file, names=(("A", "ours"),)))
    assert set(found.configurations["algo"]) == {"ours", "B"}


def test_published_curves_can_be_left_out(fabric):
    add_runs(fabric, seeds=1)
    both = {choice: Frames(fabric.results, Request(published=choice)) for choice in ("yes", "no")}
    assert len(both["yes"].published)
    assert both["no"].published.empty
    (chart, *_) = charts(both["no"])
    assert "published, training" not in chart.legend
    assert both["no"].configurations["published"].isna().all()


def test_figure_and_table_lead_with_the_same_kind_of_return(fabric):
    add_runs(fabric, seeds=2)
    for kind in ("evaluation", "training"):
        found = Frames(fabric.results, Request(returns=kind))
        chart = charts(found)[0]
        assert next(iter(chart.panels[0].versions)).startswith(kind)
        assert found.returns == kind


@pytest.mark.parametrize(
    ("codes", "shown"), [(["aa"], True), (["bb"], False), (["aa", "bb"], False), ([None], True)]
)
def test_random_actions_are_shown_beside_runs_of_the_same_code(fabric, codes, shown):
    specs = {
        "parts": ["place"],
        "sizes": [1],
        "action_minimum": [-1.0],
        "action_maximum": [1.0],
    }
    for code in codes:
        fabric.run([10.0] * 4, task="mine:cart", engine="batched", specs={**specs, "sources": code})
    add_random(fabric, "mine:cart", [1.0, 2.0], specs={**specs, "sources": "aa"})
    found = Frames(fabric.results)
    assert found.baselines["policy"].tolist() == ["random"] * shown
    left_out = any(note.startswith("Random actions on mine:cart are") for note in found.notes)
    assert left_out != shown


def test_random_actions_on_an_own_task_are_a_line_and_axes_fit(fabric):
    add_runs(fabric, seeds=2, task="dmc:cheetah-run")
    returns = np.append(np.arange(20.0, 39.0), 96.0)
    add_random(fabric, "dmc:cheetah-run", returns)
    found = Frames(fabric.results)
    (row,) = found.baselines.to_dict("records")
    assert (row["policy"], row["episodes"]) == ("random", 20)
    # By hand: 19 numbers around 29, and 96.
    assert (row["mean"], row["median"]) == (32.35, 29.5)
    assert row["mean_low"] < row["mean"] < row["mean_high"]
    assert row["low"] <= row["median"] <= row["high"]
    text = page.render(found, charts(found))
    assert ">random</text>" in text
    assert ">1000</text>" not in text
    labels = [int(label) for label in re.findall(r">(\d+)</text>", text)]
    assert max(labels) <= 200
    # Tasks that have a solved return keep its range.
    fabric.flat([90.0] * 3)
    found = Frames(fabric.results)
    assert ">1000</text>" in page.render(found, charts(found))


def test_page_says_where_a_run_came_from_and_what_is_missing(fabric):
    add_runs(fabric, seeds=3)
    text = page.render(Frames(fabric.results), [])
    assert "? too few seeds " in text
    (data,) = re.findall(r'id="runs-data">(.*)</script>', text)
    data = json.loads(data)
    origins = [data["origins"][number] for number in data["runs"][0]["origin"]]
    assert {origin.partition(":")[0] for origin in origins} <= {"commit", "processor", "command"}
    assert any(origin.startswith("processor: ") for origin in origins)
    for word in ("IQM", "s", "detectable", "over the run"):
        assert re.search(rf'<button title="[^"]+">{word}</button>', text), word


def test_headline_names_task_and_algorithms(fabric):
    add_runs(fabric)
    assert Frames(fabric.results).headline == (
        "Compared with the full observation, TD3 agents on face_direction reach lower final "
        "returns with dae4."
    )
    for seed in range(6):  # with SAC, nothing is decided
        for name in FINALS:
            fabric.run(np.full(30, 50.0 * (seed % 3)), seed, representation=name, algo="sac")
    found = Frames(fabric.results, Request(returns="training"))
    assert found.headline == (
        "Compared with the full observation, TD3 agents on face_direction reach lower final "
        "returns with dae4."
    )
