"""Tests of the paper's published curves against final medians and quantiles read from it."""

import pytest

from jbench.names import ALGORITHMS, TASKS
from jbench.report.data.published import best_median

# Medians and [q10, q90] at about 5e6 steps, DDPG, PPO, SAC and TD3.
END = {
    "move_from_origin": [(933, 633, 967), (713, 147, 943), (973, 959, 979), (971, 950, 978)],
    "face_direction": [(808, 693, 881), (239, 24, 863), (959, 932, 969), (963, 908, 985)],
    "move_in_direction": [(632, 369, 711), (174, 41, 390), (799, 733, 834), (824, 749, 853)],
    "move_to_position": [(579, 312, 733), (4, 0, 212), (794, 601, 889), (555, 167, 788)],
    "move_to_pose": [(232, 23, 522), (0, 0, 20), (64, 12, 179), (1, 0, 28)],
}


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("algo", ALGORITHMS)
def test_final_quantiles_of_figure_9(published, task, algo):
    (curve,) = [c for c in published if (c.figure, c.task, c.algo) == ("fig9", task, algo)]
    median, q10, q90 = END[task][ALGORITHMS.index(algo)]
    assert curve.representation == "full"
    assert curve.quantiles[50][-1] == pytest.approx(median, abs=0.6)
    assert curve.quantiles[10][-1] == pytest.approx(q10, abs=0.6)
    assert curve.quantiles[90][-1] == pytest.approx(q90, abs=0.7)
    assert curve.median_at(curve.control_steps[-1]) == curve.quantiles[50][-1]


def test_early_medians_of_face_direction(published):
    for algo, median in (("td3", 945), ("sac", 943), ("ddpg", 814)):
        found, figure = best_median(published, "face_direction", algo, "full", 0.5e6)
        assert (round(found), figure) == (median, "fig9")


def test_best_median_of_several_figures_is_used(published):
    # DDPG with the full observation ended at 632 in Figure 9, and at 295 in Figure 8.
    value, figure = best_median(published, "move_in_direction", "ddpg", "full", 4.95e6)
    assert (round(value), figure) == (632, "fig9")
    value, figure = best_median(published, "move_in_direction", "ddpg", "dae12", 4.95e6)
    assert (round(value), figure) == (392, "fig8")


def test_median_is_interpolated_between_points(published):
    (curve,) = [c for c in published if (c.figure, c.task, c.algo) == ("fig9", TASKS[1], "td3")]
    x, y = curve.control_steps[:2], curve.quantiles[50][:2]
    assert curve.median_at(x[0] + 0.25 * (x[1] - x[0])) == pytest.approx(0.75 * y[0] + 0.25 * y[1])


def test_no_median_beyond_ends_of_curve(published):
    args = (published, "face_direction", "td3", "full")
    assert best_median(*args, 40_000) is None
    assert best_median(*args, 6e6) is None
    # The last window of 5000 episodes is centered at step 4,950,500; the paper writes 4,950,000.
    assert round(best_median(*args, 4_950_500)[0]) == 963
    assert best_median(published, "move_to_pose", "sac", "dae12", 1e6) is None


def test_augmented_robots_and_estimated_bands_are_excluded(published):
    assert {curve.figure for curve in published} == {"fig7", "fig8", "fig9"}
    quantiles = {curve.figure: set(curve.quantiles) for curve in published}
    assert quantiles == {"fig7": {50}, "fig8": {25, 50, 75}, "fig9": {10, 50, 90}}
