"""Tests of studies: their arms, the comparisons that a file plans, and parts chosen by name."""

from dataclasses import replace

import pytest

from jbench.errors import RequestError
from jbench.names import SWEEPS, TASKS
from jbench.settings.algorithms import algorithm_settings
from jbench.settings.run import RunSettings
from jbench.studies.arms import arms, run_key
from jbench.studies.entries import read_entries
from jbench.studies.matrix import only, read_matrix
from jbench.studies.shipped import shipped_studies
from jbench.studies.study import default_comparisons, listed_comparisons

STUDY = """
tasks = ["face_direction"]
algos = ["td3"]
steps = 2000

[[part]]
name = "shared"
representations = ["full", "planar", "pca3"]

[[part]]
name = "draws"
representations = ["pca3"]
encoder.seed = "each"

[[part]]
name = "slow"
representations = ["full"]
hyperparameters.td3.tau = 0.001

[[comparison]]
task = "face_direction"
algo = "td3"
"""


@pytest.fixture
def file(tmp_path):
    """Returns a function: the name of a file with this last entry."""

    def write(entry=""):
        (tmp_path / "study.toml").write_text(STUDY + entry)
        return str(tmp_path / "study.toml")

    return write


def plan(name):
    return listed_comparisons(read_matrix(name), read_entries(name))


EACH = '{ representation = "pca3", encoder.seed = "each" }'
ONE = '{ representation = "pca3", encoder.seed = 0 }'
SLOW = '{ representation = "full", hyperparameters.tau = 0.001 }'
USUAL = '{ representation = "full", hyperparameters.tau = 0.005 }'


@pytest.mark.parametrize(
    ("first", "second", "name", "parts"),
    [
        ('"planar12"', '"full"', "planar against full", ["shared", "shared"]),
        (EACH, '"full"', "pca3 (an encoder per agent) against full", ["draws", "shared"]),
        (ONE, '"full"', "pca3 (one encoder) against full", ["shared", "shared"]),
        (EACH, ONE, "pca3 (an encoder per agent) against pca3 (one encoder)", ["draws", "shared"]),
        (SLOW, USUAL, "full (tau=0.001) against full (tau=0.005)", ["slow", "shared"]),
    ],
)
def test_sides_name_what_tells_arms_apart(first, second, name, parts, file):
    (comparison,) = plan(file(f"first = {first}\nsecond = {second}\n"))
    assert comparison.name == f"face_direction td3 {name}"
    assert [arm.part.name for arm in (comparison.first, comparison.second)] == parts


@pytest.mark.parametrize(("line", "margin"), [("", 50.0), ("margin = 20\n", 20.0)])
def test_margin_of_an_entry_replaces_that_of_the_task(line, margin, file):
    (comparison,) = plan(file(f'first = "planar12"\nsecond = "full"\n{line}'))
    assert comparison.margin == margin


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ('first = "pca3"\nsecond = "full"', "with 2 settings; write which to compare"),
        (f'first = {SLOW}\nsecond = "planar"\nhyperparameters.tau = 0.3', "has no full and"),
        (f"first = {SLOW}\nsecond = {SLOW}", "first and second are both full"),
        ('first = { representation = "full", tau = 1 }\nsecond = "planar"', "has no key tau"),
        ('first = "full"\nsecond = "planar"\nhyperparameters.tua = 1', "did you mean tau?"),
        (
            f"first = {EACH.replace('each', 'all')}\nsecond = 'full'",
            'a whole number, 0 or more, or "',
        ),
    ],
)
def test_entry_without_exactly_one_pair_of_arms_is_refused(entry, says, file):
    with pytest.raises(RequestError) as refused:
        plan(file(entry))
    assert "study.toml, comparison 1: " in str(refused.value)
    assert says in str(refused.value)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"max_seeds": 0}, "planar against full is 0: type a multiple of 5."),
        ({"max_seeds": 7}, "planar against full is 7: type a multiple of 5."),
        ({"max_seeds": -5}, "planar against full is -5: type a multiple of 5."),
        ({"share": 0.0}, "planar against full is 0.0: type a number above 0, up to 0.05."),
        ({"share": 0.06}, "planar against full is 0.06: type a number above 0, up to 0.05."),
    ],
)
def test_comparison_that_nothing_could_decide_is_refused(changes, says, file):
    (planned,) = plan(file('first = "planar"\nsecond = "full"'))
    with pytest.raises(RequestError) as refused:
        replace(planned, **changes)
    assert says in str(refused.value)


def recorded(**changes):
    """Returns the settings of a run as a manifest of another dataset's encoder has them."""
    values = {
        "task": "face_direction",
        "algo": "td3",
        "representation": "pca3",
        "encoder": "face_direction/pca3/s07-12345678",
        "seed": 3,
        "steps": 2000,
        "evaluate_every": 1000,
        "evaluate_episodes": 10,
        "hyperparameters": algorithm_settings("td3").model_dump(mode="json"),
    }
    return RunSettings(**{**values, **changes})


def test_runs_are_those_of_an_arm_if_all_but_seed_and_encoder_is_equal(file):
    parts = read_matrix(file('first = "full"\nsecond = "planar"'))
    keys = {(arm.part.name, arm.short_name): arm.key for arm in arms(parts)}
    shared, drawn = keys["shared", "pca3"], keys["draws", "pca3"]
    run = recorded()
    assert run_key(run, 2000) == run_key(recorded(seed=4, evaluate_every=500), 2000) == shared
    assert run_key(recorded(encoder_draws="0123abcd"), 2000) == drawn
    planar = recorded(representation="planar12", encoder="face_direction/planar12/s00-12345678")
    assert run_key(planar, 2000) == keys["shared", "planar"]
    for other in (recorded(time_limit="terminal"), recorded(engine="sb3"), recorded(augment=3)):
        assert run_key(other, 2000) not in keys.values()
    assert run_key(run, 3000) not in keys.values()


def test_chosen_names_of_one_kind_are_alternatives_and_kinds_hold_together(file):
    parts = read_matrix(file('first = "full"\nsecond = "planar"'))

    def left(*names):
        return [(part.name, *part.representations) for part in only(parts, names).values()]

    assert left("draws") == [("draws", "pca3")]
    assert left("pca3") == [("shared", "pca3"), ("draws", "pca3")]
    assert left("full", "planar", "shared") == [("shared", "full", "planar")]
    assert left("td3") == [
        ("shared", "full", "planar", "pca3"),
        ("draws", "pca3"),
        ("slow", "full"),
    ]
    with pytest.raises(RequestError, match="No part of the matrix has draws and planar"):
        left("draws", "planar")
    with pytest.raises(RequestError, match=r"'pca4'; did you mean pca3\?"):
        left("pca4")


def test_shipped_studies_spend_no_more_than_their_error_rate():
    studies = shipped_studies()
    assert {*studies} <= {*SWEEPS}
    for comparisons in studies.values():
        assert 0 < sum(comparison.share for comparison in comparisons) < 0.05 + 1e-9


def test_studies_of_other_robots_are_left_out_where_none_of_their_tasks_was_trained():
    on_robots = {*shipped_studies()} - {*shipped_studies(TASKS)}
    assert on_robots == {"robots"}
    assert {*shipped_studies({"gym:Hopper-v5"})} == {"robots"}
    assert shipped_studies({"move_to_pose"}) == {}


def test_without_a_list_representations_are_compared_with_baselines_of_their_features(tmp_path):
    file = tmp_path / "study.toml"
    names = ["full", "pca3", "pca3-without-velocity", "scaled-without-velocity", "raw"]
    file.write_text(
        f'tasks = ["face_direction"]\nalgos = ["td3"]\nrepresentations = {names}\nsteps = 2000\n'
    )
    pairs = {
        (comparison.first.representation, comparison.second.representation)
        for comparison in default_comparisons(read_matrix(str(file)))
    }
    assert pairs == {
        ("pca3", "full"),
        ("pca3-without-velocity", "scaled-without-velocity"),
        ("raw", "full"),
    }


@pytest.mark.parametrize("figure", ["fig7", "fig8"])
def test_raw_is_the_baseline_where_nothing_observes_full(figure):
    (comparison,) = default_comparisons(read_matrix(figure))
    assert comparison.first.representation.startswith("dae12-")
    assert comparison.second.representation.startswith("raw")


def test_parts_that_repeat_an_arm_plan_its_comparison_once(tmp_path):
    """Options of other kinds, and encoders beside learned features, are of no arm's runs."""
    file = tmp_path / "study.toml"
    file.write_text("""
        tasks = ["face_direction"]
        algos = ["td3"]
        representations = ["full", "pca3", "ofe12"]
        steps = 2000
        [[part]]
        encoder.options.dae.noise = 0.2
        [[part]]
        dataset.steps = 10_000
        encoder.options.random.scale = "sd"
        representations = ["full", "ofe12"]
        [[part]]
    """)
    planned_once = [one.first.representation for one in default_comparisons(read_matrix(str(file)))]
    assert planned_once == ["pca3", "ofe12"]


def test_parts_that_differ_in_evaluations_alone_do_not_decide(tmp_path):
    file = tmp_path / "study.toml"
    parts = "".join(f"[[part]]\nevaluation.every = {every}\n" for every in (1000, 2000))
    file.write_text(
        "tasks = ['face_direction']\nalgos = ['td3']\nrepresentations = ['full', 'planar']\n"
        f"steps = 2000\n{parts}"
    )
    says = r"part 2: full of td3 on face_direction is also in .*part 1, with other evaluations;"
    with pytest.raises(RequestError, match=says):
        default_comparisons(read_matrix(str(file)))
