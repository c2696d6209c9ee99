"""Tests of what train and sweep warn of before they train: runs that learn nothing."""

import pytest

from jbench.commands.run_checks import check_runs
from jbench.settings.run import RunSettings
from jbench.store import Results
from tests.training.small_runs import requested

SCHEDULE = {"train_freq": 500, "learning_starts": 600}
"""Updates follow control steps 1,000, 1,500 and so on."""


def is_warned(run, capsys):
    """Returns whether the check of a run warns that it learns nothing, after 1,000 steps."""
    check_runs([run], "no", None)
    printed = capsys.readouterr().err
    return "after 1,000 control steps, so a run of 1,000 learns nothing" in " ".join(
        printed.split()
    )


@pytest.mark.parametrize("algo", ["td3", "jbench.rules:TD3"])
def test_run_whose_last_evaluation_is_before_its_first_update_learns_nothing(
    algo, tmp_path, capsys
):
    run = requested(Results(tmp_path), SCHEDULE, algo=algo)
    assert (run.steps, run.algorithm.first_update) == (1000, 1000)
    assert is_warned(run, capsys)
    assert is_warned(run.model_copy(update={"evaluate_every": 500}), capsys)

    # Without an evaluation that is due at its end, the one of the final policy is after the update.
    assert not is_warned(run.model_copy(update={"evaluate_every": 700}), capsys)
    assert not is_warned(run.model_copy(update={"steps": 2000}), capsys)


def test_run_of_several_environments_passes_its_last_evaluation(tmp_path, capsys):
    run = requested(Results(tmp_path), SCHEDULE)
    several = RunSettings(**{**run.values, "parallel": 4, "evaluate_every": 499})
    assert (several.rollout, several.last_step) == (500, 1000)
    assert is_warned(several, capsys)  # 998 is between the control steps 996 and 1,000
