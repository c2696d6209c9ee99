"""The numbers of README and docs/ on the shipped runs, computed from the rows again.

Intervals are bootstrap intervals. Those of the pages are the report's and agree with these up to
their random resamples.
"""

import json
import re
from functools import cache
from itertools import chain, combinations, pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import trim_mean, ttest_ind

import jbench
from jbench.report.data.untrained import (
    HAND_WRITTEN,
    RANDOM,
    random_return,
    shipped_untrained,
)
from jbench.statistics.bootstrap import difference, estimate, interquartile_mean
from jbench.tasks.find import find_task
from jbench.wording import in_prose
from tests.command_line import succeed
from tests.documentation import ROOT
from tests.report.golden.cases import shipped_frames
from tests.scripts import script

answer_tables = script("docs/answer_tables.py")
shipped = shipped_frames

TASKS = ("face_direction", "move_in_direction")
BASELINES = ("full", "scaled")
SEEDS = {"td3": 10, "ddpg": 6}
"""Every configuration of the pages has as many."""
HOPPER = "gym:Hopper-v5"
CHEETAH = "dmc:cheetah-run"
WHITENED = "dae12-observation-whitened"
ALONE = ("dae12-whitened", "dae12-observation", WHITENED, "dae-yaw13")
"""Autoencoders that each agent has for itself."""


class Returns(NamedTuple):
    """Numbers (seeds,) of a configuration by one kind of return."""

    final: np.ndarray
    area: np.ndarray  # mean returns over the run


# Episodes of `jbench evaluate` join the last evaluation.
EVALUATED = """(
    SELECT run, control_steps, episode_return FROM evaluations UNION ALL
    SELECT policy, steps, episode_return FROM policy_episodes
    JOIN policy_evaluations USING (evaluation) JOIN runs ON policy = run
) AS rows"""
LAST = "FILTER (rows.control_steps > steps * 3 / 4)"
QUERY = """SELECT algo, task, seed, {columns}, representation
|| if((settings->>'$.hyperparameters.mirror') = 'true', ', mirror=true', '') AS representation
FROM {table} JOIN runs USING (run) WHERE engine = 'batched' AND algo IN ('td3', 'ddpg')
AND settings->>'precision' IS NULL AND settings->>'$.hyperparameters.normalize' IS NULL
AND (settings->>'$.hyperparameters.batch_size') <> '64'
GROUP BY ALL ORDER BY ALL"""


@pytest.fixture(scope="module")
def evaluations():
    """Returns all evaluations: algo, task, name, seed, step, mean."""
    columns = "rows.control_steps AS step, avg(episode_return) AS mean"
    return queried(columns, EVALUATED)


@pytest.fixture(scope="module")
def returns(evaluations):
    """Returns the `Returns` by ("evaluation" or "training", algo, task, name)."""
    keys, found = ["algo", "task", "name"], {}
    for key, rows in evaluations.groupby(keys):
        means = rows.pivot(index="seed", columns="step", values="mean")
        numbers = means.iloc[:, -1], means.mean(axis=1)
        found["evaluation", *key] = Returns(*map(np.asarray, numbers))
    columns = f"avg(episode_return) {LAST} AS mean, avg(episode_return) AS area"
    training = queried(columns, "episodes AS rows")
    for key, rows in training.groupby(keys):
        found["training", *key] = Returns(*(rows[c].to_numpy() for c in ("mean", "area")))
    return found


@pytest.fixture(scope="module")
def finals(returns):
    """Returns a function: the final evaluation returns with TD3 of representations on a task."""
    return lambda task, *names: [returns["evaluation", "td3", task, n].final for n in names]


def queried(columns, table):
    return named(jbench.open("reference").query(QUERY.format(columns=columns, table=table)))


def named(frame):
    """Adds the names of the pages: kinds whose size follows from the task have no number."""
    unnumbered = r"^(scaled|planar|planar-mirror|heading)\d+"
    return frame.assign(name=frame["representation"].str.replace(unnumbered, r"\1", regex=True))


def chosen_from(frame, **wanted):
    return frame[(frame[[*wanted]] == [*wanted.values()]).all(axis=1)]


def iqm(values, axis=-1):
    return trim_mean(values, 0.25, axis=axis)


def interval(statistic, *samples, confidence=0.95):
    """Returns a statistic of the resampled first sample, minus that of the second if there is."""
    random = np.random.default_rng(0)
    drawn = [statistic(random.choice(s, (10_000, len(s))), axis=-1) for s in samples]
    tail = 50 * (1 - confidence)
    return np.percentile(drawn[0] - sum(drawn[1:]), [tail, 100 - tail])


def assert_agrees(text, statistic, *samples):
    """Compares a text such as `+74 [+33, +122]` with a statistic, or a difference of two."""
    value, *ends = (float(number) for number in re.findall(r"[-+]?\d+", text))
    numbers = [statistic(sample) for sample in samples]
    assert value == round(numbers[0] - sum(numbers[1:])), text
    low, high = interval(statistic, *samples)
    np.testing.assert_allclose(ends, [low, high], rtol=0, atol=2 + 0.05 * (high - low))


def table(page, heading):
    """Returns the rows of the only table of a page whose first line contains a text."""
    (rows,) = tables(page, heading)
    assert rows
    return rows


def tables(page, heading):
    """Returns the rows of each table of a page whose first line contains a text.

    A row whose first cell is empty has that of the row above.
    """
    found = []
    for text in re.findall(r"(?:^\|.*\n)+", (ROOT / page).read_text(), re.MULTILINE):
        first, _, *lines = text.splitlines()
        if heading not in first:
            continue

        rows = [[cell.strip(" `") for cell in line[1:-1].split("|")] for line in lines]
        for above, row in pairwise(rows):
            row[0] = row[0] or above[0]
        found.append(rows)
    return found


def rows_of_td3(task):
    """Returns the rows of a task in the tables of agents of TD3, which have the same headings."""
    found = tables("docs/answer.md", "| at the end | difference | each agent")
    return [row for row in chain(*found) if row[0] == task]


def configuration(text):
    """Returns the algorithm and task of a text such as "`face_direction`, TD3"."""
    task, algo = re.findall(r"\w+", text)
    return algo.lower(), task


@pytest.mark.parametrize(
    ("page", "heading", "count"),
    [("README.md", "final evaluation return", 6), ("docs/answer.md", "the agent observes", 14)],
)
def test_table_of_representations_has_the_returns_of_the_runs(returns, page, heading, count):
    policies = shipped_untrained().set_index(["policy", "task"])["mean"]
    rows = table(page, heading)
    for first, *cells in rows[:count]:
        name = re.search(r"\(([\w, =-]+)\)", first.replace("`", ""))[1]
        for task, (value, at_end, over_run) in zip(TASKS, (cells[:3], cells[3:]), strict=True):
            if ("evaluation", "td3", task, name) not in returns:
                assert (value, at_end, over_run) == ("", "", "")
                continue
            ours, full = (returns["evaluation", "td3", task, n] for n in (name, "full"))
            assert len(ours.final) == 10
            assert value == f"{iqm(ours.final):.0f}"
            if name == "full":
                assert (at_end, over_run) == ("", "")
            else:
                assert_agrees(at_end, iqm, ours.final, full.final)
                assert_agrees(over_run, iqm, ours.area, full.area)
    for row, policy in zip(rows[count:], (RANDOM, HAND_WRITTEN), strict=True):
        assert row[1::3] == [f"{policies[policy, task]:.0f}" for task in TASKS]


def test_episodes_of_final_returns():
    """Agents of which no policy was kept have ten episodes, as the page on the answer says."""
    rows = chosen_from(shipped().seeds, algo="TD3", returns="evaluation")
    rows = rows[rows["words"].isin(["", "mirror=true"]) & rows["task"].isin(TASKS)]
    in_all = {*ALONE, "heading", "planar-no-yaw"}
    for (task, name, _), episodes in rows.groupby(["task", "representation", "words"])["episodes"]:
        if name in in_all or (task, name) == (TASKS[0], "planar-mirror"):
            assert {*episodes} == {100}
        else:
            assert sorted(episodes) == [10] * 9 + [100]
    assert "elsewhere, it is that of 10 episodes in nine of ten agents." in text_of("answer")


def test_sentences_that_compare_agents_with_policies_without_training(returns):
    for task in TASKS:
        assert iqm(returns["evaluation", "td3", task, "dae12"].final) < random_return(task)
    assert "TD3 gets no more than random actions on either task" in text_of("answer")

    means = shipped_untrained().set_index(["policy", "task"])["mean"]
    low, high = interval(iqm, returns["evaluation", "td3", TASKS[1], "planar-mirror"].final)
    assert low < means[HAND_WRITTEN, TASKS[1]] < high
    assert "TD3 then gets about as much as the hand-written policy" in text_of("answer")


@pytest.mark.slow
def test_tables_are_as_generated():
    for path, text in answer_tables.pages(answer_tables.ShippedNumbers()).items():
        assert path.read_text("utf-8") == text


def test_every_pair_of_representations_has_a_row_of_differences(returns):
    rows = table("docs/answer-details.md", "at the end")
    assert {(*configuration(row[0]), *row[1:3]) for row in rows} == {
        (algo, task, name, baseline)
        for kind, algo, task, name in returns
        for baseline in {"full": (), "scaled": ("full",)}.get(name, BASELINES)
        if (kind, algo, task, baseline) in returns
        and len(returns[kind, algo, task, name].final) >= SEEDS[algo]
    }
    p_values = []
    for first, name, baseline, at_end, _, over_run, _ in rows:
        pair = [returns["evaluation", *configuration(first), n] for n in (name, baseline)]
        assert_agrees(at_end, iqm, *(runs.final for runs in pair))
        assert_agrees(over_run, iqm, *(runs.area for runs in pair))
        p_values.append(
            [
                p_value(*(runs.final for runs in pair)),
                p_value(*(runs.area for runs in pair)),
            ]
        )
    for column, its in zip((4, 6), zip(*p_values, strict=True), strict=True):
        shown = [f"{p:.3f}" if p >= 0.001 else "< 0.001" for p in holm(its)]
        assert [row[column] for row in rows] == shown
    chosen = [f"{TASKS[0]}`, TD3", "planar", "scaled"]
    p = next(row[4] for row in rows if row[:3] == chosen)
    assert f"p is {float(p):.2f}, corrected" in text_of("answer-details")
    chosen = [f"{TASKS[0]}`, DDPG", "dae12", "full"]
    p = next(row[4] for row in rows if row[:3] == chosen)
    assert f"is lower than with `full`: p is {p}, corrected" in text_of("answer-details")


def test_final_return_of_ddpg_without_added_episodes(returns, evaluated):
    p_values = []
    for first, name, baseline, *_ in table("docs/answer-details.md", "at the end"):
        algo, task = configuration(first)
        pair = [returns["evaluation", algo, task, n].final for n in (name, baseline)]
        if (algo, name, baseline) == ("ddpg", "dae12", "full"):
            place = len(p_values)
            full, latents = (evaluated("ddpg", task, *agents) for agents in FIGURE_7[:2])
            pair = [
                np.array([means.iloc[-1] for means in side.values()]) for side in (latents, full)
            ]
        p_values.append(p_value(*pair))
    p = holm(p_values)[place]
    assert f"to two of the twelve runs, p is {p:.3f}." in text_of("answer-details")


def p_value(ours, theirs):
    """Returns that of the exact permutation test of two means of as many seeds, two-sided."""
    returns = np.concatenate([ours, theirs])
    sums = returns[relabelings(len(ours))].sum(axis=1)
    return np.mean(np.abs(sums - returns.sum() / 2) >= abs(ours.sum() - theirs.sum()) / 2 - 1e-9)


@cache
def relabelings(seeds):
    return np.array(list(combinations(range(2 * seeds), seeds)), dtype=np.int8)


def holm(p_values):
    """Returns Holm's adjusted p-values (1979)."""
    order, adjusted = np.argsort(p_values), np.empty(len(p_values))
    factors = len(p_values) - np.arange(len(p_values))
    adjusted[order] = np.maximum.accumulate(np.array(p_values)[order] * factors)
    return np.minimum(adjusted, 1)


def test_verdicts_on_the_papers_claims(returns):
    similar, variable, faster = table("docs/answer.md", "the paper's claim")
    for algo, task in (("td3", TASKS[0]), ("td3", TASKS[1]), ("ddpg", TASKS[0])):
        latents, full = (returns["evaluation", algo, task, name] for name in ("dae12", "full"))
        assert interval(iqm, latents.final, full.final, confidence=0.9)[1] < -50
        assert interval(iqm, latents.area, full.area)[1] < 0
    verdicts = chosen_from(shipped().verdicts, representation="dae12", against="full")
    verdicts = verdicts[verdicts["task"].isin(TASKS)]
    found = {
        claim: {f"{row.returns}, {row.algo}": row.verdict for row in rows.itertuples()}
        for claim, rows in verdicts.drop_duplicates(["algo", "returns", "claim"]).groupby("claim")
    }
    assert found["a"] == {
        "evaluation, TD3": "lower",
        "evaluation, DDPG": "undecided",
        "training, TD3": "lower",
        "training, DDPG": "undecided",
    }
    assert similar[1] == "contradicted with TD3: it is lower; with DDPG, not decided"
    assert {*found["b"].values()} == {"undecided"}
    assert variable[1] == "not decided"
    assert found["c"].pop("training, DDPG") == "undecided"
    assert {*found["c"].values()} == {"slower"}
    slower = "contradicted: they learn more slowly; with DDPG, not decided by training returns"
    assert faster[1] == slower
    by_task = verdicts.groupby(["algo", "returns", "claim"])["verdict"]
    assert set(by_task.nunique()) == {1}

    verdicts = chosen_from(shipped().verdicts, representation="dae12-script", against="raw")
    found = {(row.returns, row.claim): row for row in verdicts.itertuples()}
    by_evaluation = [found["evaluation", claim].verdict for claim in "abc"]
    assert by_evaluation == ["undecided", "undecided", "faster"]
    by_training = [found["training", claim].verdict for claim in "abc"]
    assert by_training == ["undecided"] * 3
    similarity = found["evaluation", "a"]
    ends = f"{similarity.corrected_low:+.0f} to {similarity.corrected_high:+.0f}"
    assert similar[2] == f"not decided: {ends}"
    assert variable[2] == "not decided"
    assert faster[2] == (
        "supported: they learn faster; not decided by training returns, or compared with `full"
    )


def test_verdicts_on_training_returns():
    keys = ["algo", "words", "representation", "against", "claim"]
    verdicts = shipped().verdicts
    assert not verdicts.duplicated(["task", "returns", *keys]).any()
    rows = verdicts.pivot(index=["task", *keys], columns="returns", values="verdict")
    rows = rows[rows["evaluation"] != rows["training"]].reset_index()
    rows = rows[~rows["task"].isin([HOPPER, CHEETAH])]
    assert {*rows["task"]} == {TASKS[0]}

    of = {"a": "the final return", "b": "variability", "c": "learning speed"}
    agents = {"": "", "settings=figure8": ", `figure8"}
    assert table("docs/answer-details.md", "training returns") == [
        [
            row.algo + agents[row.words],
            row.representation,
            row.against,
            of[row.claim],
            row.evaluation,
            row.training,
        ]
        for row in rows.itertuples()
    ]
    assert len(rows) == 7
    counted = "In seven comparisons of the Jitterbug's agents, all on `face_direction`,"
    assert counted in text_of("answer-details")


def test_forward_is_similar_to_scaled(finals):
    forward, scaled = finals(TASKS[0], "forward12", "scaled")
    assert np.abs(interval(iqm, forward, scaled, confidence=0.9)).max() < 50
    assert (round(iqm(forward)), round(iqm(scaled))) == (904, 910)


def test_what_learns_faster():
    rows = chosen_from(shipped().verdicts, returns="evaluation", claim="c")
    keys = ["algo", "task", "representation", "against"]
    found = rows.set_index(keys)["verdict"].to_dict()
    for cell in (("TD3", TASKS[0]), ("TD3", TASKS[1]), ("DDPG", TASKS[0])):
        assert [found[*cell, "planar", baseline] for baseline in BASELINES] == ["faster"] * 2
    assert found["TD3", TASKS[0], "forward12", "full"] == "undecided"


def test_where_agents_differ_from_each_other():
    rows = chosen_from(shipped().configurations, algo="TD3", returns="evaluation")
    rows = rows[~rows["words"].isin(["bfloat16", "stable-baselines3"])]
    names = "`" + rows["label"].str.removeprefix("TD3 ") + "`"
    easier, differ = rows["task"] == TASKS[0], rows["s_low"] > 0
    said = "`face_direction`, 0 is in the interval, except with {}. On `move_in_direction`, "
    said += "it is in none."
    assert said.format(in_prose(names[easier & differ], "and")) in text_of("answer-details")
    assert differ[~easier].all()


def decided(task, representation, against, claim="a"):
    """Returns the row of the sequential test on two representations."""
    chosen = {"task": task, "representation": representation, "against": against, "claim": claim}
    (row,) = chosen_from(shipped().decisions, **chosen).itertuples()
    return row


def decided_difference(row):
    """Returns the difference of means of a row of `decided`, with its interval."""
    return with_interval(row.difference, row)


def with_interval(value, ends):
    """Returns a difference and its interval in words, such as `+56 [+10, +100]`."""
    return f"{value:+.0f} [{ends.low:+.0f}, {ends.high:+.0f}]"


def test_decisions_of_the_sequential_test():
    rows = table("docs/answer-details.md", "difference of final returns")
    assert len(rows) == 7
    for task, name, against, *shown in rows:
        row = decided(task, name, against)
        assert shown == [decided_difference(row), row.verdict]


def test_what_makes_the_latents_of_the_autoencoder_useful(finals):
    names = "dae12-observation", WHITENED, "dae12", "dae12-whitened"
    plain, whitened, *scaled = finals(TASKS[0], *names)
    assert (len(plain), len(whitened), (whitened > plain.max()).sum()) == (10, 10, 9)
    for ends in (plain, whitened, *scaled):
        assert f"({ends.min():.0f} to {ends.max():.0f})" in text_of("answer-details")
    verdicts = [decided(TASKS[0], name, "scaled").verdict for name in ("dae-yaw13", WHITENED)]
    assert verdicts == ["lower", "lower"]
    assert decided(TASKS[0], "dae-yaw13", "dae12").verdict == "higher"


def test_whether_agents_vary_less(returns):
    rows = chosen_from(shipped().verdicts, claim="b")
    assert {*rows["verdict"]} == {"undecided"}
    (corrected_by,) = {*rows["corrected_by"]} - {"fewer than 6 seeds"}
    text = text_of("answer-details")
    assert corrected_by == "Holm, 42 comparisons"
    assert "a p-value of 0.05 / 42." in text

    shown = table("docs/answer-details.md", "difference of *s*")
    assert min(float(row[-1]) for row in shown) > 0.05 / 42
    figure_7 = ["DDPG, `figure8", "dae12-script", "raw", "training"]
    (p,) = (row[-1] for row in shown if row[:4] == figure_7)
    assert f"on training returns: p = {p})." in text_of("answer")

    scaled, planar = (
        returns["evaluation", "ddpg", TASKS[0], name].final for name in ("scaled", "planar")
    )
    assert (len(scaled), (scaled < 900).sum()) == (6, 1)
    assert f"one of six agents of DDPG fails ({scaled.min():.0f})" in text
    assert f"none does ({lowest_to_highest(planar)})" in text


def test_planar_coordinates_help_by_what_they_leave_out(finals):
    planar, heading, full = finals(TASKS[1], "planar", "heading", "full")
    assert (len(heading), (planar > heading.max()).sum()) == (10, 7)
    assert abs(iqm(heading) - iqm(full)) < 50
    assert decided(TASKS[1], "heading", "planar").verdict == "lower"
    assert decided(TASKS[1], "heading", "full").verdict == "undecided"


def test_text_on_mirror_symmetry_has_the_differences_of_the_runs(returns):
    rows = table("docs/answer-details.md", "at the end")
    pair = [TASKS[0], "planar-mirror", "scaled"]
    ((*_, at_end, p, _, _),) = (r for r in rows if [configuration(r[0])[1], *r[1:3]] == pair)
    text = text_of("answer-details")
    assert f"is higher than with `scaled`: {at_end} (p {p}). On" in text
    area = {key[2:]: runs.area for key, runs in returns.items() if key[:2] == ("evaluation", "td3")}
    said = (
        re.search(r"over the run, the difference is ([^.]*)\.", text),
        re.search(r"run is undecided: (.*?) against", text),
    )
    faster, *others = re.findall(r"[-+]\d+ \[[^]]*\]", " ".join(found[1] for found in said))
    assert_agrees(faster, iqm, *(area[TASKS[1], name] for name in ("planar-mirror", "planar")))
    for task, shown in zip(TASKS, others, strict=True):
        assert_agrees(shown, iqm, area[task, "planar, mirror=true"], area[task, "planar"])


def test_planar_without_the_yaw_rate(finals):
    without, planar = finals(TASKS[0], "planar-no-yaw11", "planar")
    *lower, last = (f"{final:.0f}" for final in sorted(without))
    said = f"have {', '.join(lower)} and {last}, and the ten with `planar` {planar.min():.0f} or"
    assert said in text_of("answer")


def text_of(page):
    return " ".join((ROOT / "docs" / f"{page}.md").read_text().split())


def test_what_representations_predict(returns):
    rows = jbench.open("reference").query(
        "SELECT task, representation, target, r2, errors.test_explained FROM encoder_predictions "
        "JOIN encoders USING (encoder) JOIN encoder_errors AS errors USING (encoder)"
    )
    shown = table("docs/answer.md", "yaw rate")
    draws = rows[(rows["representation"] == "dae12-observation") & (rows["target"] == "yaw_rate")]
    low, high = draws["r2"].min(), draws["r2"].max()
    assert f"{low:.2f} to {high:.2f} in the ten shipped" in text_of("answer")
    assert len(draws) == 10
    for task, name, *cells in shown:
        chosen = chosen_from(named(rows), task=task, name=name).set_index("target")
        r2 = chosen["r2"][["yaw_rate", "tilt_rate", "forward_speed", "reward"]]
        # planar's reconstruction leaves out position and heading on purpose
        variance = "" if name == "planar" else f"{chosen['test_explained'].iloc[0]:.0%}"
        final = f"{iqm(returns['evaluation', 'td3', task, name].final):.0f}"
        assert cells == [*(f"{value:.2f}" for value in r2), variance, final]


def test_published_figures_7_and_8():
    published = jbench.open("reference").query("FROM published WHERE algo = 'ddpg'")
    curve = chosen_from(published, figure="fig7").pivot(
        index="control_steps", columns="representation", values="episode_return"
    )[["full", "dae12"]]
    edges = [0, 250_000, 1_000_000, 3_000_000, 5_000_000]
    for row, low, high in zip(
        table("docs/answer.md", "| 12 latents |"), edges[:-1], edges[1:], strict=True
    ):
        means = curve[(curve.index >= low) & (curve.index < high)].mean()
        assert row[1:] == [f"{mean:.0f}" for mean in means]
    ahead = curve["full"] > curve["dae12"]
    assert ahead[ahead.index >= 230_000].all()
    assert not ahead[ahead.index < 230_000].any()
    medians = chosen_from(published, task=TASKS[1], quantile=50).sort_values("control_steps")
    last = medians.groupby(["figure", "representation"])["episode_return"].last().round()
    assert dict(last) == {
        ("fig8", "full"): 295,
        ("fig8", "dae12"): 392,
        ("fig8-10-90", "full"): 295,
        ("fig8-10-90", "dae12"): 392,
        ("fig9", "full"): 632,
    }
    assert "392 at the end" in text_of("answer")
    assert "ends at 295, no more than random actions get; with" in text_of("answer")
    assert random_return(TASKS[1]) > 295
    assert "the same algorithm, Figure 9 has 632" in text_of("answer")


RAW_16 = "raw16-without-speed_in_target_frame"
SCRIPT_16 = "dae12-without-speed_in_target_frame-script"
FIGURE_7 = (
    ("full", "published", False),
    ("dae12", "published", False),
    ("raw16", "figure8", True),
    ("dae12-script", "figure8", True),
)
FIGURE_8 = ((RAW_16, "figure8", True), (SCRIPT_16, "figure8", True))
STANDARDIZED = (
    ("raw16", "figure8", True),
    ("full", "figure8", True),
    ("full", "figure8", False),
    ("dae12-script", "figure8", True),
    ("dae12-script", "figure8", False),
)
"""Representations, settings, and whether inputs are standardized: the columns of three tables."""

EVALUATED_BY_STEP = """
SELECT algo, task, representation, seed, control_steps, avg(episode_return) AS mean,
if((settings->>'$.hyperparameters.batch_size') = '64', 'figure8', 'published') AS settings,
coalesce((settings->>'$.hyperparameters.normalize') = 'running', false) AS is_standardized
FROM evaluations JOIN runs USING (run) WHERE engine = 'batched' AND algo IN ('td3', 'ddpg')
AND settings->>'precision' IS NULL
AND (settings->>'$.hyperparameters.mirror') IS DISTINCT FROM 'true'
GROUP BY ALL ORDER BY ALL"""


@pytest.fixture(scope="module")
def evaluated():
    """Returns a function: agents of an algorithm and task, their mean returns by control step.

    It takes the representation, the settings, and whether inputs are standardized; the agents are
    by seed.
    """
    rows = jbench.open("reference").query(EVALUATED_BY_STEP)
    keys = ["algo", "task", "representation", "settings", "is_standardized"]
    by_agent = dict(iter(rows.groupby(keys)))

    def find(algo, task, representation, settings, is_standardized):
        agents = by_agent[algo, task, representation, settings, is_standardized]
        return dict(iter(agents.set_index("control_steps").groupby("seed")["mean"]))

    return find


@pytest.mark.parametrize(
    ("heading", "task", "columns"),
    [
        ("Figure 7: 16 numbers", TASKS[0], FIGURE_7),
        ("16 numbers (`raw`), standardized", TASKS[0], STANDARDIZED),
        ("`raw-without-speed_in_target_frame`", TASKS[1], FIGURE_8),
    ],
)
def test_agents_by_control_step(evaluated, heading, task, columns):
    *by_step, over_run, at_end = table("docs/answer.md", heading)
    for column, agents in enumerate(columns, 1):
        seeds = evaluated("ddpg", task, *agents)
        for row in by_step:
            values = [means[int(row[0].replace(",", ""))] for means in seeds.values()]
            assert row[column] == median_and_range(values)
        assert over_run[column] == median_and_range([means.mean() for means in seeds.values()])
        finals = [seeds[seed].iloc[-1] for seed in sorted(seeds)]
        assert at_end[column] == ", ".join(f"{final:.0f}" for final in finals)


def test_what_the_agents_of_figure_7_learn(evaluated):
    at_100k, at_end, medians = {}, {}, []
    for agents in FIGURE_7:
        seeds = evaluated("ddpg", TASKS[0], *agents)
        at_100k[agents] = np.array([means[100_000] for means in seeds.values()])
        at_end[agents] = np.array([means.iloc[-1] for means in seeds.values()])
        medians.append(f"{np.median([means.mean() for means in seeds.values()]):.0f}")
    *_, full, latents = FIGURE_7

    page = text_of("answer")
    assert f"latents get {lowest_to_highest(at_100k[latents])}, and those with the full" in page
    assert f"the full observation {lowest_to_highest(at_100k[full])}." in page

    assert [len(at_end[agents]) for agents in (full, latents)] == [10, 10]
    assert (
        f"All ten with latents have learned the task ({lowest_to_highest(at_end[latents])})" in page
    )
    learned = at_end[full] > 500
    assert [learned.sum(), (~learned).sum()] == [7, 3]
    assert f"seven have ({lowest_to_highest(at_end[full][learned])})" in page
    assert (at_end[latents] < at_end[full][learned].min()).sum() == 8
    assert at_end[full][learned].std() < at_end[latents].std()
    assert f"three have not ({lowest_to_highest(at_end[full][~learned])})" in page

    table_1, table_1_latents, figure_7, figure_7_latents = medians
    assert f"its median is {table_1} with the settings of Table 1 and {figure_7} with" in page
    assert f"the median with latents is {table_1_latents} and {figure_7_latents}." in page


def test_the_agents_of_figure_7_vary_differently_over_the_run(evaluated):
    *_, full, latents = (
        np.array([means.mean() for means in evaluated("ddpg", TASKS[0], *agents).values()])
        for agents in FIGURE_7
    )
    deviations = "{:.0f} with the latents and {:.0f} without".format(
        *(side.std(ddof=1) for side in (latents, full))
    )
    welch = ttest_ind(latents, full, equal_var=False).pvalue
    decision = decided(TASKS[0], "dae12-script", "raw", "c")
    page = text_of("answer")
    assert f"(standard deviations of {deviations}), so" in page
    # After ten of ten planned seeds, the whole share is spent.
    share = f"this comparison's share of the error rate is {decision.spent:.4f}."
    assert f"Welch's test has p = {welch:.3f}, and {share}" in page


def test_comparisons_of_the_agents_of_figure_7():
    verdicts = chosen_from(shipped().verdicts, representation="dae12-script", against="raw")
    rows = {(row.returns, row.claim): row for row in verdicts.itertuples()}
    page = text_of("answer")

    at_end, over_run = (decided(TASKS[0], "dae12-script", "raw", claim) for claim in "ac")
    assert f"return over the run is higher: {decided_difference(over_run)} by the" in page
    assert f"it is undecided which gets more:** {decided_difference(at_end)} by the" in page
    by_training = rows["training", "c"]
    found = f"{by_training.value:+.0f} {corrected(by_training)}, corrected for 42 comparisons."
    assert by_training.corrected_by == "Holm, 42 comparisons"
    assert f"this is undecided:** {found}" in page

    verdicts = chosen_from(shipped().verdicts, representation="dae12-script", against="full")
    wanted = {"claim": "c", "returns": "evaluation", "words": "settings=figure8"}
    (row,) = chosen_from(verdicts, **wanted).itertuples()
    assert (row.verdict, row.corrected_by) == ("undecided", "Holm, 41 comparisons")
    assert f"{row.value:+.0f} {corrected(row)}, corrected for 41 comparisons." in page

    spread = chosen_from(shipped().configurations, returns="evaluation", algo="DDPG")
    spread = spread.set_index(["representation", "words"])["s"]
    latents, full = (spread[name, "settings=figure8"] for name in ("dae12-script", "raw"))
    assert f"is {latents:.0f} with the latents and {full:.0f} with the full observation." in page


def test_what_standardized_inputs_do_to_the_full_observation(evaluated):
    columns = [[*evaluated("ddpg", TASKS[0], *agents).values()] for agents in STANDARDIZED]
    assert [len(seeds) for seeds in columns] == [10, 10, 10, 10, 10]
    raw, standardized, full, _, _ = columns

    page = text_of("answer")
    early = [
        lowest_to_highest([means[100_000] for means in seeds])
        for seeds in (raw, standardized, full)
    ]
    assert "get {} with `raw` and {} with `full`; the ten with `full` as it is get {}.".format(
        *early
    ) in page  # fmt: skip

    failed, *learned = sorted(means.iloc[-1] for means in full)
    assert f"nine get {lowest_to_highest(learned)}, and one gets {failed:.0f}." in page
    at_end = sorted(means.iloc[-1] for means in standardized)
    failed, learned = at_end[:4], at_end[4:]
    found = f"six get {lowest_to_highest(learned)}, and four get {lowest_to_highest(failed)}."
    assert found in page


def test_what_standardized_inputs_change_between_observations():
    configurations = chosen_from(shipped().seeds, returns="evaluation", algo="DDPG", task=TASKS[0])
    seeds = {
        key: rows.sort_values("seed")
        for key, rows in configurations.groupby(["representation", "words"])
    }
    page = text_of("answer")

    running = seeds["dae12-script", "settings=figure8"]
    none = seeds["dae12-script", "settings=figure8, normalize=none"]
    found = difference_in_words(running["over_run"], none["over_run"])
    assert f"with and without them differ by {found}." in page
    planned = chosen_from(shipped().decisions, against="dae12-script", claim="a")
    (planned,) = chosen_from(planned, algo="DDPG", task=TASKS[0]).itertuples()
    assert planned.verdict == "undecided"
    assert f"change the return: {decided_difference(planned)} by the" in page

    standardized = seeds["full", "settings=figure8"]
    full = seeds["full", "settings=figure8, normalize=none"]
    found = difference_in_words(standardized["over_run"], full["over_run"])
    p = p_value(standardized["over_run"].to_numpy(), full["over_run"].to_numpy())
    assert f"with `full` by {found} (permutation test: p = {p:.3f})." in page

    planned = chosen_from(shipped().decisions, representation="full", against="full", claim="a")
    (planned,) = chosen_from(planned, algo="DDPG", task=TASKS[0]).itertuples()
    assert planned.verdict == "undecided"
    assert f"the return with `full`**: {decided_difference(planned)} by the" in page

    over_run = difference_in_words(running["over_run"], standardized["over_run"])
    assert f"from `full` over the run is {over_run}; where" in page
    as_they_are = difference_in_words(none["over_run"], full["over_run"])
    assert f"where both are as they are, it is {as_they_are}." in page

    sides = (running, standardized, none, full)
    change = estimate(
        lambda *means: (
            difference(interquartile_mean)(*means[:2]) - difference(interquartile_mean)(*means[2:])
        ),
        *([np.array(side["over_run"])] for side in sides),
    )
    assert f"These two differ by {with_interval(change.value, change)}." in page

    at_end = (
        difference_in_words(running["final"], standardized["final"]),
        difference_in_words(none["final"], full["final"]),
    )
    assert "At the end, the differences are {} and {}.".format(*at_end) in page


@pytest.mark.parametrize(("row", "representation"), [(0, "full"), (2, "dae12")])
def test_table_of_td3_with_standardized_inputs(row, representation):
    of = seeds_on_robot(TASKS[0], algo="TD3")
    without = of[representation]
    with_them = of[f"{representation}, normalize=running"]
    shown = rows_of_td3(TASKS[0])[row : row + 2]
    assert representation in shown[0][1]
    assert shown[1][1] == "the same, standardized"
    for seeds, cells in zip((without, with_them), shown, strict=True):
        assert len(seeds) == 10
        assert cells[2] == f"{iqm(seeds['over_run']):.0f}"
        assert cells[4] == f"{iqm(seeds['final']):.0f}"
        assert cells[6] == ", ".join(f"{final:.0f}" for final in seeds["final"])

    assert shown[0][3] == shown[0][5] == ""
    assert shown[1][3] == difference_in_words(with_them["over_run"], without["over_run"])
    assert shown[1][5] == difference_in_words(with_them["final"], without["final"])


def test_what_standardized_inputs_do_to_td3():
    text = text_of("answer")
    of = seeds_on_robot(TASKS[0], algo="TD3")
    latents = of["dae12, normalize=running"]["final"]
    assert f"agents with them get {lowest_to_highest(latents)}, and random actions 246." in text
    assert iqm(latents) < 246

    with_them, without = (of[name]["over_run"] for name in ("full, normalize=running", "full"))
    gain = difference_in_words(with_them, without)
    assert f"{gain} over the run (permutation test: p < 0.001)." in text
    assert p_value(with_them.to_numpy(), without.to_numpy()) < 0.001


@pytest.mark.parametrize(
    ("representation", "against", "verdict", "sentence"),
    [
        ("dae12", "full", "lower", "{} at the end by the"),
        ("dae12", "dae12", "undecided", "the latents is undecided: {} by the sequential test."),
        ("full", "full", "undecided", "the difference is undecided: {} by the sequential test."),
    ],
)
def test_planned_comparisons_of_td3_with_standardized_inputs(
    representation, against, verdict, sentence
):
    rows = chosen_from(shipped().decisions, algo="TD3", task=TASKS[0], words="normalize=running")
    (found,) = chosen_from(rows, representation=representation, against=against).itertuples()
    assert (found.verdict, found.seeds, found.returns) == (verdict, 10, "evaluation")
    assert sentence.format(decided_difference(found)) in text_of("answer")


def test_what_each_step_adds(returns):
    rows = table("docs/answer.md", "| step |")
    steps = ["full", "scaled", "heading", "planar", "planar-mirror"]
    assert [row[1:3] for row in rows] == [[*pair] for pair in pairwise(steps)]
    for row in rows:
        for task, (over_run, at_end) in zip(TASKS, (row[3:5], row[5:7]), strict=True):
            after, before = (returns["evaluation", "td3", task, name] for name in row[2:0:-1])
            assert_agrees(at_end, iqm, after.final, before.final)
            assert_agrees(over_run, iqm, after.area, before.area)

    areas = {name: iqm(returns["evaluation", "td3", TASKS[0], name].area) for name in steps}
    gains = [f"{areas[name] - areas['full']:.0f}" for name in ("scaled", "planar")]
    assert "over the run**: {} of {}.".format(*gains) in text_of("answer")


def difference_in_words(ours, theirs):
    found = estimate(difference(interquartile_mean), [np.array(ours)], [np.array(theirs)])
    return with_interval(found.value, found)


def test_the_agents_of_figure_8(evaluated):
    full, latents = ([*evaluated("ddpg", TASKS[1], *agents).values()] for agents in FIGURE_8)
    at_end = [[means.iloc[-1] for means in seeds] for seeds in (full, latents)]
    assert [len(seeds) for seeds in at_end] == [5, 5]
    page = text_of("answer")
    with_full, with_latents = map(lowest_to_highest, at_end)
    assert f"get {with_full} with the 16 numbers and {with_latents} with the latents" in page
    random = random_return(TASKS[1])
    assert f"Random actions get {random:.0f}." in page
    assert max(map(max, at_end)) < random

    rows = chosen_from(shipped().verdicts, representation=SCRIPT_16, returns="evaluation")
    found = {row.claim: row for row in rows.itertuples()}
    assert {row.verdict for row in found.values()} == {"undecided"}
    assert [found[claim].corrected_by for claim in "ac"] == ["sequential test"] * 2
    assert {row.seeds for row in found.values()} == {5}
    similarity = found["a"]
    interval = with_interval(similarity.value, similarity)
    assert f"difference of the final returns is {interval}, without" in page


def test_published_figure_8_within_the_steps_of_the_runs():
    rows = jbench.open("reference").query("FROM published WHERE figure = 'fig8' AND quantile = 50")
    medians = rows.pivot(index="control_steps", columns="representation", values="episode_return")
    early = medians[medians.index <= 300_000]
    full, latents = lowest_to_highest(early["full"]), lowest_to_highest(early["dae12"])
    page = text_of("answer")
    assert f"its medians are {full} with the full observation and {latents} with" in page
    differences = (medians["dae12"] - medians["full"]).abs()
    assert f"differ by at most {differences[differences.index <= 830_000].max():.0f}." in page


def corrected(row):
    return f"[{row.corrected_low:+.0f}, {row.corrected_high:+.0f}]"


def lowest_to_highest(values):
    return f"{min(values):.0f} to {max(values):.0f}"


def median_and_range(values):
    return f"{np.median(values):.0f} ({min(values):.0f} to {max(values):.0f})"


ON_OTHER_ROBOTS = (
    (HOPPER, ("full", "full, normalize=running", "dae8")),
    (CHEETAH, ("full", "full, normalize=running", "dae12")),
)


def seeds_on_robot(task, algo="TD3"):
    """Returns the rows of evaluation returns on a robot by representation and other settings."""
    rows = chosen_from(shipped().seeds, task=task, algo=algo, returns="evaluation")
    words = rows["words"].map(lambda words: f", {words}" if words else "")
    return dict(iter(rows.groupby(rows["representation"] + words)))


def decided_on(task, representation, words=""):
    """Returns the sequential decision on a robot's final returns, and its interval in words."""
    keys = {"study": "robots", "task": task, "returns": "evaluation", "words": words}
    rows = chosen_from(shipped().decisions, representation=representation, **keys)
    (found,) = rows.itertuples()
    return found, f"{found.difference:+,.0f} [{found.low:+,.0f}, {found.high:+,.0f}]"


@pytest.mark.parametrize(("task", "names"), ON_OTHER_ROBOTS)
def test_table_of_other_robots(task, names):
    of = seeds_on_robot(task)
    assert {*of} == {*names}
    for row, name in zip(rows_of_td3(task), names, strict=True):
        assert ("standardized" in row[1]) == ("normalize" in name)
        assert len(of[name]) == 5
        assert row[2] == f"{iqm(of[name]['over_run']):,.0f}"
        assert row[4] == f"{iqm(of[name]['final']):,.0f}"
        assert row[6] == ", ".join(f"{final:,.0f}" for final in of[name]["final"])
        if name == "full":
            continue
        for text, column in ((row[3], "over_run"), (row[5], "final")):
            pair = (of[name][column].to_numpy(), of["full"][column].to_numpy())
            assert_agrees(text.replace(",", "").replace(" ", ", ", 1), iqm, *pair)


def test_hopper():
    of = seeds_on_robot(HOPPER)
    found, interval = decided_on(HOPPER, "dae8")
    assert (found.verdict, found.seeds) == ("lower", 5)
    assert f"eleven numbers**: {interval}. Each" in text_of("answer")
    assert of["full"]["final"].min() > of["dae8"]["final"].max()
    sentence = "Each agent with the full observation has a higher final return than each agent with"
    assert sentence in text_of("answer")

    lengths = jbench.open("reference").query(
        "SELECT seed, avg(length) AS length FROM evaluations JOIN runs USING (run) "
        f"WHERE task = '{HOPPER}' AND representation = 'full' AND control_steps = steps "
        "AND runs.settings->>'$.hyperparameters.normalize' IS NULL GROUP BY seed"
    )["length"]
    assert f"last {lowest_to_highest(lengths)} control steps" in text_of("answer")


def test_cheetah():
    of = seeds_on_robot(CHEETAH)
    found, interval = decided_on(CHEETAH, "dae12")
    assert (found.verdict, found.seeds) == ("undecided", 5)
    text = text_of("answer")
    assert f"seventeen numbers**: {interval}. Four" in text
    lowest, *others = sorted(of["full"]["final"])
    latents = of["dae12"]["final"]
    assert lowest < 1 < latents.max() < others[0]
    sentence = f"higher final returns ({lowest_to_highest(others)}) than each agent with latents "
    assert (
        f"{sentence}({lowest_to_highest(latents)}). The fifth learns nothing ({lowest:.0f})."
        in text
    )


def test_standardized_inputs_on_other_robots():
    hopper, on_hopper = decided_on(HOPPER, "full", "normalize=running")
    cheetah, on_cheetah = decided_on(CHEETAH, "full", "normalize=running")
    assert (hopper.verdict, cheetah.verdict) == ("undecided", "undecided")
    decided = f"help is undecided**: {on_hopper} on Hopper, and {on_cheetah} on Cheetah, where "
    finals = seeds_on_robot(CHEETAH)["full, normalize=running"]["final"]
    learned = f"all five agents with standardized inputs learn ({lowest_to_highest(finals)})."
    assert finals.min() > 100  # random actions get 4
    assert decided + learned in text_of("answer")


def test_verdicts_by_robot():
    shown = table("README.md", "| task | latents |")
    assert len(shown) == 4
    plain = {"returns": "evaluation", "algo": "TD3", "claim": "a", "words": ""}
    decisions = chosen_from(shipped().decisions, **plain)
    for task, words, seeds, interval, verdict in shown:
        latents, _, observed = words.partition(" latents of ")
        rows = chosen_from(decisions, task=task, representation=f"dae{latents}", against="full")
        (found,) = rows.itertuples()
        assert (str(found.seeds), found.verdict) == (seeds, verdict)
        assert interval == f"{found.difference:+,.0f} [{found.low:+,.0f}, {found.high:+,.0f}]"
        assert observed == f"{find_task(task).observation_size} numbers"


def test_published_figure_9():
    rows = jbench.open("reference").query("FROM published WHERE figure = 'fig9' AND quantile = 50")
    last = chosen_from(rows, task=TASKS[1], algo="td3").sort_values("control_steps").iloc[-1]
    reached = f"the paper's TD3 reaches {last['episode_return']:.0f} on `move_in_direction`"
    assert reached in text_of("answer")


def test_what_ddpg_learns_on_the_three_other_tasks():
    runs = chosen_from(shipped().seeds, algo="DDPG", returns="evaluation")
    others = runs[~runs["task"].isin(TASKS)]
    assert {*others["representation"]} == {"full"}
    for task, returns in others.groupby("task")["final"]:
        assert len(returns) == 3
        assert f"{returns.min():.0f} to {returns.max():.0f} on `{task}`" in text_of("answer")
    random = random_return("move_from_origin")
    assert f"(random actions: {random:.0f})" in text_of("answer")


def test_differences_of_the_two_engines():
    seeds = chosen_from(shipped().seeds, task=TASKS[0], representation="full")
    for algo, counts, *shown in table("docs/agents.md", "final evaluation return"):
        for text, kind in zip(shown, ("training", "evaluation"), strict=True):
            rows = chosen_from(seeds, algo=algo, returns=kind).groupby("words")["final"]
            sides = [rows.get_group(words) for words in ("stable-baselines3", "")]
            assert counts == ", ".join(str(len(side)) for side in sides)
            assert text == difference_in_words(*sides)


def test_what_ppo_learns():
    agents = chosen_from(shipped().seeds, algo="PPO").sort_values("seed")
    cells = agents.groupby(["task", "words", "returns"])["final"]
    published = (
        jbench.open("reference")
        .query(
            "SELECT task, max_by(episode_return, control_steps) AS last FROM published "
            "WHERE algo = 'ppo' AND quantile = 50 AND control_steps <= 1000000 GROUP BY task"
        )
        .set_index("task")["last"]
    )
    rows = table("docs/agents.md", "last 100 training episodes")
    assert 2 * len(rows) == cells.ngroups
    for task, settings, *returns, paper in rows:
        words = {"published": "", "script": "settings=script"}[settings]
        for shown, kind in zip(returns, ("training", "evaluation"), strict=True):
            finals = cells.get_group((task, words, kind))
            assert shown == ", ".join(f"{final:.0f}" for final in finals)
        assert paper == f"{published[task]:.0f}"

    for task in ("move_from_origin", TASKS[1]):
        evaluated = chosen_from(agents, task=task, returns="evaluation")
        assert evaluated["final"].max() < random_return(task)


@pytest.mark.slow
def test_comparisons_that_the_sequential_test_has_decided(tmp_path):
    succeed("merge", "reference", results=tmp_path)
    typed = ("sweep", "question", "--until-decided", "--dry-run", "--json")
    rows = json.loads(succeed(*typed, results=tmp_path).stdout)["comparisons"]
    # The report has the same decisions.
    tested = [(row["difference"], row["low"], row["high"]) for row in rows if row["seeds"]]
    decisions = shipped().decisions.query("study == 'question'")
    shown = decisions[["difference", "low", "high"]]
    finite = shown.replace([np.inf, -np.inf], np.nan)  # JSON has no infinite numbers
    np.testing.assert_allclose(finite, np.array(tested, float), rtol=1e-9)
    decided = {
        (*row["comparison"].replace(" td3", "").replace("against ", "").split(), row["verdict"])
        for row in rows
        if row["verdict"] != "undecided"
    }
    lower = [(name, base) for name in ("dae12", "pca12", "random12") for base in BASELINES]
    assert decided == {
        *((TASKS[0], *pair, "smaller") for pair in lower),
        *((TASKS[0], name, "scaled", "smaller") for name in ALONE),
        (TASKS[0], "dae-yaw13", "dae12", "larger"),
        (TASKS[0], "planar", "full", "larger"),
        *((TASKS[1], "dae12", base, "smaller") for base in BASELINES),
        (TASKS[1], "heading", "planar", "smaller"),
        *((TASKS[1], "planar", base, "larger") for base in BASELINES),
    }
    assert f"{len(decided)} of its {len(rows)} comparisons" in text_of("answer-details")


def test_page_on_statistics_has_the_medians_of_ddpg(returns):
    training, evaluation = (
        np.median(returns[kind, "ddpg", TASKS[0], "full"].final)
        for kind in ("training", "evaluation")
    )
    assert (
        f"training return of {training:.0f} and a median evaluation return of {evaluation:.0f}"
    ) in text_of("statistics")
