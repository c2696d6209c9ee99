"""Tests of tables of runs, and of the final return that they show."""

import numpy as np
import pyarrow as pa
import pytest

from jbench.cli import main
from jbench.commands.training import note_encoder, show_runs
from jbench.report.data.curves import final_returns
from jbench.returns import final_return
from jbench.store import Results, schema
from jbench.store.listing import list_runs
from tests.store import store_rows
from tests.training.small_runs import small_run

RUN = small_run("td3", {}, steps=1_000_000, evaluate_every=50_000, evaluate_episodes=0)


# A quarter is 6 and 7, and 100 at most, 900 to 999.
@pytest.mark.parametrize(
    ("episodes", "mean", "shown"), [(3, 2.0, "2"), (8, 6.5, "6.5"), (1000, 949.5, "950")]
)
def test_final_return_is_equal_in_tables_listings_and_reports(
    episodes, mean, shown, tmp_path, capsys
):
    returns = np.arange(float(episodes))
    record = Results(tmp_path).create("run", RUN.id, RUN.model_dump(mode="json"))
    record.append({"episodes": store_rows.episodes(RUN.id, returns)})
    assert final_return(returns) == mean
    (line,), _ = list_runs(Results(tmp_path), {}, returns=True)
    assert line.last_return == mean
    steps = 1000.0 * (returns + 1)
    reported, *_ = final_returns(returns[None], steps[None], np.array([episodes]), "training")
    assert reported.tolist() == [mean]
    show_runs([RUN], Results(tmp_path))
    (row,) = (line for line in capsys.readouterr().out.splitlines() if RUN.id in line)
    assert row.split()[-2:] == [str(episodes), shown]


def add_run(path, *evaluations):
    """Adds a run with the returns of each evaluation, and a training return of 7."""
    record = Results(path).create("run", RUN.id, RUN.model_dump(mode="json"))
    rows = [
        {"run": RUN.id, "evaluation": number, "episode": episode, "episode_return": value}
        | {"control_steps": 1000 * (number + 1)}
        for number, values in enumerate(evaluations)
        for episode, value in enumerate(values)
    ]
    table = pa.Table.from_pylist(rows, schema.EVALUATIONS)
    record.append({"evaluations": table, "episodes": store_rows.episodes(RUN.id, [7.0])})


def test_evaluation_return_is_the_mean_of_the_last_evaluation(tmp_path, capsys):
    add_run(tmp_path, (900.0, 900.0), (10.0, 20.0, 60.0))
    (line,), _ = list_runs(Results(tmp_path), {}, returns=True)
    assert (line.last_return, line.evaluation_return) == (7, 30)
    assert main(["runs", "--returns", "--results", str(tmp_path)]) == 0
    listed = capsys.readouterr().out
    show_runs([RUN], Results(tmp_path))
    printed = capsys.readouterr().out
    for text in (listed, printed):
        assert text.rindex("training return") < text.rindex("evaluation return")
        (row,) = (line for line in text.splitlines() if RUN.id in line)
        assert row.split()[-2:] == ["7", "30"]
    few = "The evaluation return is the mean of 3 episodes, too few to quote"
    assert few in " ".join(printed.split())


def test_small_returns_have_two_digits(tmp_path, capsys):
    add_run(tmp_path, [0.5, 0.54])
    assert main(["runs", "--returns", "--results", str(tmp_path)]) == 0
    show_runs([RUN], Results(tmp_path))
    rows = [line for line in capsys.readouterr().out.splitlines() if RUN.id in line]
    assert [row.split()[-2:] for row in rows] == [["7", "0.52"]] * 2


def test_last_evaluation_of_many_episodes_is_quoted_also_if_the_others_have_few(tmp_path, capsys):
    add_run(tmp_path, [5.0] * 2, [5.0] * 25)
    show_runs([RUN], Results(tmp_path))
    assert "Quote the evaluation return" in capsys.readouterr().out


def test_encoder_is_named_unless_its_own_name_was_typed():
    id = "face_direction/dae12-epochs-20/s00-1f9a2c4e"
    run = RUN.model_copy(update={"encoder": id})
    for typed in ("12", "dae12"):
        assert note_encoder(typed, run) == [f"--encoder {typed} is {id}."]
    for typed in ("dae12-epochs-20", "face_direction/dae12", id):
        assert note_encoder(typed, run) == []
    assert note_encoder("none", RUN) == []


def test_nonfinite_returns_are_left_out():
    assert final_return(np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, np.nan])) == 7.0
    assert final_return(np.array([1.0, np.inf])) is None
    assert final_return(np.array([])) is None
