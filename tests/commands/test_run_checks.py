"""Tests of what train and sweep warn of before they train: runs and settings without effect."""

import pytest

from jbench.commands.run_checks import check_runs
from jbench.settings.run import RunSettings
from jbench.store import Results
from tests.training.small_runs import requested, small_run

SCHEDULE = {"train_freq": 500, "learning_starts": 600}
"""Updates follow control steps 1,000, 1,500 and so on."""


LONG = {"steps": 80_000, "evaluate_every": 8_000, "evaluate_episodes": 1}
"""Lengths of a run of which nothing is to be warned."""


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
    assert (run.steps, run.first_update) == (1000, 1000)
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


@pytest.mark.parametrize(
    ("algo", "chosen", "needed"),
    [
        ("td3", {"normalize_clip": 3.0}, "normalize=running"),
        ("ppo", {"normalize_epsilon": 0.1}, "normalize=running"),
        ("ppo", {"value_loss": "max", "clip_range_vf": None}, "a number as clip_range_vf"),
        ("td3", {"noise_theta": 0.3}, "action_noise=ornstein-uhlenbeck"),
        ("ddpg", {"noise_sigma": 0.1, "action_noise": "none"}, "action_noise=normal"),
        ("sac", {"target_entropy": -2.0, "ent_coef": 0.1}, "ent_coef=auto"),
    ],
)
def test_hyperparameter_that_changes_nothing_is_warned_of(algo, chosen, needed, capsys):
    check_runs([small_run(algo, chosen, **LONG)], "no", None)
    name = next(iter(chosen))
    said = " ".join(capsys.readouterr().err.split())
    assert f"{name} of {algo} has no effect without {needed}." in said
    assert said.count("has no effect") == 1


@pytest.mark.parametrize(("episodes", "typed", "warned"), [(0, 5, 1), (0, None, 0), (1, 5, 0)])
def test_last_evaluation_that_is_not_made_is_warned_of(episodes, typed, warned, capsys):
    run = small_run("td3", {}, **{**LONG, "evaluate_episodes": episodes})
    check_runs([run], "no", None, typed)
    assert capsys.readouterr().err.count("--final-episodes has no effect") == warned


@pytest.mark.parametrize(
    ("algo", "chosen"),
    [
        ("td3", {"normalize_clip": 3.0, "normalize": "running"}),
        ("ddpg", {"noise_theta": 0.3}),
        ("sac", {"target_entropy": -2.0, "noise_sigma": 0.1}),
        ("ppo", {"clip_range_vf": None}),
    ],
)
def test_hyperparameter_with_an_effect_is_not_warned_of(algo, chosen, capsys):
    check_runs([small_run(algo, chosen, **LONG)], "no", None)
    assert "has no effect" not in capsys.readouterr().err
