"""Tests of the paper's published curves against final medians and quantiles read from it."""

import pytest

from jbench.names import TASKS
from jbench.report.data.curves import SEQUENCE, beside_which, best_median, trained_as
from jbench.report.figures import charts
from jbench.report.frames import Frames
from jbench.report.request import Request
from jbench.settings.algorithms import algorithm_settings
from jbench.studies.matrix import read_matrix

FIGURE_9 = ("ddpg", "ppo", "sac", "td3")
# Medians and [q10, q90] of these algorithms at about 5e6 steps.
END = {
    "move_from_origin": [(933, 633, 967), (713, 147, 943), (973, 959, 979), (971, 950, 978)],
    "face_direction": [(808, 693, 881), (239, 24, 863), (959, 932, 969), (963, 908, 985)],
    "move_in_direction": [(632, 369, 711), (174, 41, 390), (799, 733, 834), (824, 749, 853)],
    "move_to_position": [(579, 312, 733), (4, 0, 212), (794, 601, 889), (555, 167, 788)],
    "move_to_pose": [(232, 23, 522), (0, 0, 20), (64, 12, 179), (1, 0, 28)],
}


def curve(published, figure, task, algo):
    return published[(published[["figure", "task", "algo"]] == [figure, task, algo]).all(axis=1)]


@pytest.mark.parametrize("task", END)
@pytest.mark.parametrize("algo", FIGURE_9)
def test_final_quantiles_of_figure_9(published, task, algo):
    last = curve(published, "Figure 9", task, algo).iloc[-1]
    assert (last["representation"], last["seeds"], last["source"]) == ("full", 10, "published")
    ends = END[task][FIGURE_9.index(algo)]
    assert last[["median", "q10", "q90"]].tolist() == pytest.approx(ends, abs=0.7)


def test_best_median_of_several_figures_is_used(published):
    # DDPG with the full observation ended at 632 in Figure 9, and at 295 in Figure 8.
    value, figure = best_median(published, ("move_in_direction", "ddpg", "full"), 4.95e6)
    assert (round(value), figure) == (632, "Figure 9")
    value, figure = best_median(published, ("move_in_direction", "ddpg", "dae12"), 4.95e6)
    assert (round(value), figure) == (392, "Figure 8")


def test_median_is_interpolated_between_points(published):
    first = curve(published, "Figure 9", TASKS[1], "td3").iloc[:2]
    x, y = first["steps"].tolist(), first["median"].tolist()
    found, _ = best_median(published, (TASKS[1], "td3", "full"), x[0] + 0.25 * (x[1] - x[0]))
    assert found == pytest.approx(0.75 * y[0] + 0.25 * y[1])
    # There is none beyond the ends of the curve.
    args = published, ("face_direction", "td3", "full")
    assert best_median(*args, 40_000) is None
    assert best_median(*args, 6e6) is None
    # The last window of 5000 episodes is centered at step 4,950,500; the paper writes 4,950,000.
    assert round(best_median(*args, 4_950_500)[0]) == 963
    assert best_median(published, ("move_to_pose", "sac", "dae12"), 1e6) is None


def test_curve_on_augmented_robots_is_apart_and_estimated_bands_are_excluded(published):
    sac = published[published["figure"] == SEQUENCE]
    task = sac["task"].iloc[0]
    assert best_median(published, (task, "sac", "full"), sac["steps"].iloc[0], sequence=True)
    quantiles = ["q10", "q25", "median", "q75", "q90"]
    known = published.groupby("figure")[quantiles].agg(lambda one: one.notna().any())
    shown = {figure: [q for q in quantiles if row[q]] for figure, row in known.iterrows()}
    assert shown["Figure 7"] == ["median"]
    assert shown["Figure 8"] == ["q25", "median", "q75"]
    assert shown["Figure 9"] == ["q10", "median", "q90"]


@pytest.mark.parametrize(("figure", "name"), [("Figure 7", "fig7"), ("Figure 8", "fig8")])
def test_agents_of_a_figure_are_those_of_its_matrix(published, figure, name):
    (part,) = read_matrix(name).values()
    named = published.loc[published["figure"] == figure, "representation"].unique()
    agents = {representation: trained_as(figure, representation) for representation in named}
    assert agents == dict(zip(("full", "dae12"), part.representations, strict=True))
    # They have the medians of this figure, at the control steps of its points.
    for representation, agent in agents.items():
        (task,) = part.tasks
        points = curve(published, figure, task, "ddpg").set_index("representation")
        point = points.loc[representation].iloc[20]
        found = best_median(published, (task, "ddpg", agent), point["steps"])
        assert found == (pytest.approx(point["median"]), figure)


def test_published_curves_are_drawn_beside_the_agents_of_their_matrix(fabric):
    settings = algorithm_settings("ddpg", "figure8").model_dump(mode="json")
    figure8 = {"algo": "ddpg", "hyperparameters": settings, "time_limit": "terminal"}
    encoders = {name: f"face_direction/{name}/s00-00000001" for name in ("raw16", "dae12-script")}
    for name, encoder in encoders.items():
        fabric.flat([300.0], 300, representation=name, encoder=encoder, **figure8)

    found = Frames(fabric.results, Request(claims=True, returns="training"))

    chart = charts(found)[0]
    assert chart.name == "representations"
    assert list(chart.legend) == ["dae12-script", "raw", "published, training"]
    drawn = set(beside_which(found.published, {"raw", "dae12-script", "full"}))
    assert drawn == {"raw", "dae12-script", "full"}  # full: of Figure 9
    assert set(beside_which(found.published, {"full", "dae12"})) == {"full", "dae12"}
    rows = found.configurations.query("returns == 'training'").set_index("representation")
    assert {*rows["published_figure"]} == {"Figure 7"}
    compared = {*found.claims.query("source == 'own' and claim in ['a', 'b', 'c']")["compared"]}
    assert compared == {"face_direction DDPG dae12-script against raw"}
