"""Writes the tables of README and of docs/answer*.md from the shipped runs: docs/answer_tables.py.

A table stands between `<!-- table: NAME -->` and `<!-- end of table -->`. Its numbers are those of
`jbench report --results reference`; the sentences around it are written by hand.
"""

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from scipy.stats import permutation_test

import jbench
from jbench.array_types import FloatArray
from jbench.report.frames import Frames
from jbench.settings.defaults import nearest_base
from jbench.statistics.bootstrap import difference, estimate, interquartile_mean
from jbench.store.shipped import shipped_results
from jbench.studies.quantities import VARIABILITY

ROOT = Path(__file__).resolve().parents[1]
PLACE = r"(<!-- table: {name} -->\n\n).*?(\n<!-- end of table -->)"

TASKS = ("face_direction", "move_in_direction")
FEWEST_SEEDS = 6

AUTHORS_STEPS = (20_000, 60_000, 100_000, 140_000, 180_000, 220_000, 260_000, 300_000)
"""Evaluations that the tables of agents by control step show."""


@dataclass
class Shown:
    """A row of the main table: a representation with TD3.

    Attributes:
        words: what the agent observes, in the words of a page.
        name: the representation, and other settings, as the report names them.
    """

    words: str
    name: str


@dataclass
class Step:
    """A change of what the agent observes, on the way from `full` to `planar-mirror`.

    Attributes:
        words: the change, in the words of a page.
        name: the representation after it.
        before: the representation before it.
    """

    words: str
    name: str
    before: str


@dataclass
class Pair:
    """Two representations with which an algorithm was trained on a task, compared by returns."""

    algo: str
    task: str
    name: str
    against: str


@dataclass
class Agents:
    """A column of a table of agents of DDPG by control step.

    Attributes:
        words: whose settings they have, and what they observe.
        task: what they learn.
        representation: as the database names it.
        settings: those of Table 1 (`published`) or of Figures 7 and 8 (`figure8`).
        is_standardized: whether they standardize their inputs, as `figure8` has it by default.
    """

    words: str
    task: str
    representation: str
    settings: Literal["published", "figure8"]
    is_standardized: bool


STEPS = (
    Step("the numbers are min-max scaled", "scaled", "full"),
    Step("directions and speeds are in the robot's own frame", "heading", "scaled"),
    Step("position, heading and observed speed are left out", "planar", "heading"),
    Step("states with the target on the right are mirrored", "planar-mirror", "planar"),
)

README_ROWS = (
    Shown("full observation (`full`)", "full"),
    Shown("min-max scaled (`scaled`)", "scaled"),
    Shown("robot's frame (`planar`)", "planar"),
    Shown("robot's frame, mirrored (`planar-mirror`)", "planar-mirror"),
    Shown("autoencoder (`dae12`)", "dae12"),
    Shown(
        "autoencoder, observation's own scale, whitened (`dae12-observation-whitened`)",
        "dae12-observation-whitened",
    ),
)

ANSWER_ROWS = (
    Shown("all 16 or 19 numbers (`full`)", "full"),
    Shown("all of them, min-max scaled (`scaled`)", "scaled"),
    Shown("12 numbers in the robot's own frame (`planar`)", "planar"),
    Shown("these 12, mirrored if the target is on the right (`planar-mirror`)", "planar-mirror"),
    Shown("`planar`, with mirrored minibatches (`planar, mirror=true`)", "planar, mirror=true"),
    Shown("`planar`, position and heading (`heading`)", "heading"),
    Shown("12 latents trained to predict (`forward12`)", "forward12"),
    Shown("12 random directions (`random12`)", "random12"),
    Shown("12 principal components (`pca12`)", "pca12"),
    Shown("12 latents of the autoencoder (`dae12`)", "dae12"),
    Shown("the same, whitened (`dae12-whitened`)", "dae12-whitened"),
    Shown("the same and the yaw rate (`dae-yaw13`)", "dae-yaw13"),
    Shown("12 latents, on the observation's own scale (`dae12-observation`)", "dae12-observation"),
    Shown("the same, whitened (`dae12-observation-whitened`)", "dae12-observation-whitened"),
)

DIFFERENCES_ORDER = (
    "scaled",
    "planar",
    "planar, mirror=true",
    "planar-mirror",
    "heading",
    "forward12",
    "random12",
    "pca12",
    "dae12",
    "dae12-whitened",
    "dae12-observation",
    "dae12-observation-whitened",
    "dae-yaw13",
)


FIGURE_7 = (
    Agents("Table 1: 16 numbers (`full`)", TASKS[0], "full", "published", False),
    Agents("Table 1: 12 latents (`dae12`)", TASKS[0], "dae12", "published", False),
    Agents("Figure 7: 16 numbers (`raw`)", TASKS[0], "raw16", "figure8", True),
    Agents("Figure 7: 12 latents (`dae12-script`)", TASKS[0], "dae12-script", "figure8", True),
)

STANDARDIZED = (
    Agents("16 numbers (`raw`), standardized", TASKS[0], "raw16", "figure8", True),
    Agents("16 numbers (`full`), standardized", TASKS[0], "full", "figure8", True),
    Agents("16 numbers (`full`) as they are", TASKS[0], "full", "figure8", False),
    Agents("12 latents, standardized", TASKS[0], "dae12-script", "figure8", True),
    Agents("12 latents as they are", TASKS[0], "dae12-script", "figure8", False),
)

FIGURE_8 = (
    Agents(
        "16 numbers (`raw-without-speed_in_target_frame`)",
        TASKS[1],
        "raw16-without-speed_in_target_frame",
        "figure8",
        True,
    ),
    Agents(
        "12 latents of them (`dae12-without-speed_in_target_frame-script`)",
        TASKS[1],
        "dae12-without-speed_in_target_frame-script",
        "figure8",
        True,
    ),
)


@dataclass
class AgentsOfTD3:
    """A row of a table of agents of TD3: with the settings of Table 1, or those of other robots.

    Attributes:
        task: what they learn.
        words: what they observe, in the words of a page.
        name: the representation, and other settings, as the report names them.
        against: the agents from which their row has differences.
    """

    task: str
    words: str
    name: str
    against: str = "full"


WITH_TD3 = (
    AgentsOfTD3(TASKS[0], "16 numbers (`full`)", "full"),
    AgentsOfTD3(TASKS[0], "the same, standardized", "full, normalize=running"),
    AgentsOfTD3(TASKS[0], "12 latents (`dae12`)", "dae12", "dae12"),
    AgentsOfTD3(TASKS[0], "the same, standardized", "dae12, normalize=running", "dae12"),
)

OTHER_ROBOTS = (
    AgentsOfTD3("gym:Hopper-v5", "11 numbers (`full`)", "full"),
    AgentsOfTD3("gym:Hopper-v5", "the same, standardized", "full, normalize=running"),
    AgentsOfTD3("gym:Hopper-v5", "8 latents (`dae8`)", "dae8"),
    AgentsOfTD3("dmc:cheetah-run", "17 numbers (`full`)", "full"),
    AgentsOfTD3("dmc:cheetah-run", "the same, standardized", "full, normalize=running"),
    AgentsOfTD3("dmc:cheetah-run", "12 latents (`dae12`)", "dae12"),
)

ON_EACH_ROBOT = (
    AgentsOfTD3(TASKS[0], "12 latents of 16 numbers", "dae12"),
    AgentsOfTD3(TASKS[1], "12 latents of 19 numbers", "dae12"),
    AgentsOfTD3("gym:Hopper-v5", "8 latents of 11 numbers", "dae8"),
    AgentsOfTD3("dmc:cheetah-run", "12 latents of 17 numbers", "dae12"),
)
"""What README says of the paper's question: TD3 on latents against `full`, robot by robot."""


class ShippedNumbers:
    """Evaluation returns of the shipped runs of DDPG and TD3, as the report has them."""

    def __init__(self) -> None:
        """Reads the rows and computes the frames of their report, which takes half a minute."""
        frames = Frames(shipped_results())

        self.seeds = _of_evaluations(frames.seeds)
        self.baselines = frames.baselines
        self.verdicts = frames.verdicts
        self.decisions = _of_evaluations(frames.decisions)

    def returns(self, algo: str, task: str, name: str, column: str = "final") -> FloatArray:
        """Returns a number of each seed (seeds,): its `final` return, or that `over_run`."""
        rows = self.seeds
        chosen = (rows["algo"] == algo) & (rows["task"] == task) & (rows["name"] == name)
        return rows.loc[chosen, column].to_numpy()

    def final_return(self, task: str, name: str) -> str:
        """Returns TD3's interquartile mean of final returns; "" if there is no such run."""
        final = self.returns("TD3", task, name)
        return f"{interquartile_mean([final]):.0f}" if len(final) else ""

    def difference(self, pair: Pair, column: str = "final") -> str:
        """Returns a difference of interquartile means with its 95% interval.

        Such as `+56 [+10, +100]`; "" without runs, or of a representation and itself.
        """
        ours = self.returns(pair.algo, pair.task, pair.name, column)
        theirs = self.returns(pair.algo, pair.task, pair.against, column)
        if not len(ours) or pair.name == pair.against:
            return ""

        found = estimate(difference(interquartile_mean), [ours], [theirs])
        return f"{found.value:+,.0f} [{found.low:+,.0f}, {found.high:+,.0f}]"

    def p_value(self, pair: Pair, column: str = "final") -> float:
        """Returns that of the exact two-sided permutation test of means."""
        test = permutation_test(
            [
                self.returns(pair.algo, pair.task, pair.name, column),
                self.returns(pair.algo, pair.task, pair.against, column),
            ],
            lambda ours, theirs, axis: np.mean(ours, axis=axis) - np.mean(theirs, axis=axis),
            n_resamples=np.inf,
            vectorized=True,
            batch=20_000,
        )
        return float(test.pvalue)

    def mean_of_policy(self, task: str, policy: str) -> str:
        """Returns the mean return of 100 episodes of the policy `random` or `hand-written`."""
        rows = self.baselines[
            (self.baselines["task"] == task) & (self.baselines["policy"] == policy)
        ]
        return f"{rows['mean'].item():.0f}"


def _of_evaluations(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns rows of evaluation returns of the batched engine in float32, with names of pages."""
    words = ["", "mirror=true", "normalize=running"]
    rows = rows[(rows["returns"] == "evaluation") & rows["words"].isin(words)]
    rows = rows[rows["algo"].isin(["DDPG", "TD3"])]

    name = rows["representation"].where(
        rows["words"] == "", rows["representation"] + ", " + rows["words"]
    )
    return rows.assign(name=name)


def holm(p_values: list[float]) -> list[float]:
    """Returns p-values that are corrected for their number (Holm, 1979), in the same order."""
    adjusted = [0.0] * len(p_values)
    largest = 0.0
    for rank, index in enumerate(np.argsort(p_values)):
        largest = max(largest, p_values[index] * (len(p_values) - rank))
        adjusted[index] = min(largest, 1.0)
    return adjusted


def main_table(numbers: ShippedNumbers, shown: tuple[Shown, ...], first_column: str) -> str:
    """Returns the table of TD3's final returns on two tasks.

    Beside them are the differences from `full`, at the end and over the run.
    """
    easier, harder = TASKS
    lines = [
        f"| {first_column} | `{easier}` | difference at the end | difference over the run "
        f"| `{harder}` | difference at the end | difference over the run |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in shown:
        cells = []
        for task in TASKS:
            pair = Pair("TD3", task, row.name, "full")
            cells.append(numbers.final_return(task, row.name))
            cells.append(numbers.difference(pair))
            cells.append(numbers.difference(pair, "over_run"))
        lines.append(f"| {row.words} | {' | '.join(cells)} |")

    for words, policy in (
        ("random actions", "random"),
        ("the hand-written policy", "hand-written"),
    ):
        first = numbers.mean_of_policy(TASKS[0], policy)
        second = numbers.mean_of_policy(TASKS[1], policy)
        lines.append(f"| {words} | {first} |  |  | {second} |  |  |")
    return "\n".join(lines)


def steps_table(numbers: ShippedNumbers) -> str:
    """Returns the table of what each step from `full` to `planar-mirror` adds with TD3."""
    easier, harder = TASKS
    lines = [
        f"| step | from | to | `{easier}`: over the run | at the end "
        f"| `{harder}`: over the run | at the end |",
        "|---|---|---|---|---|---|---|",
    ]
    for step in STEPS:
        cells = [step.words, f"`{step.before}`", f"`{step.name}`"]
        for task in TASKS:
            pair = Pair("TD3", task, step.name, step.before)
            cells.append(numbers.difference(pair, "over_run"))
            cells.append(numbers.difference(pair))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def differences_table(numbers: ShippedNumbers) -> str:
    """Returns the table of all differences, at the end and over the run, with p-values."""
    pairs = [
        Pair(algo, task, name, against)
        for algo, task in (("TD3", TASKS[0]), ("TD3", TASKS[1]), ("DDPG", TASKS[0]))
        for name in DIFFERENCES_ORDER
        for against in ("full", "scaled")
        if name != against and len(numbers.returns(algo, task, name)) >= FEWEST_SEEDS
    ]
    at_end = holm([numbers.p_value(pair) for pair in pairs])
    over_run = holm([numbers.p_value(pair, "over_run") for pair in pairs])

    lines = [
        "| configuration | observation | against | at the end | p at the end "
        "| over the run | p over the run |",
        "|---|---|---|---|---|---|---|",
    ]
    above = ""
    for pair, p_at_end, p_over_run in zip(pairs, at_end, over_run, strict=True):
        configuration = f"`{pair.task}`, {pair.algo}"
        cells = [
            "" if configuration == above else configuration,
            f"`{pair.name}`",
            f"`{pair.against}`",
            numbers.difference(pair),
            _p_in_words(p_at_end),
            numbers.difference(pair, "over_run"),
            _p_in_words(p_over_run),
        ]
        lines.append(f"| {' | '.join(cells)} |")
        above = configuration
    return "\n".join(lines)


def variability_table(verdicts: pd.DataFrame) -> str:
    """Returns the comparisons whose corrected interval of the difference of *s* excludes 0."""
    rows = verdicts[verdicts["claim"] == VARIABILITY.claim]
    rows = rows[~rows["corrected_by"].str.startswith("fewer")]
    rows = rows[(rows["corrected_low"] > 0) | (rows["corrected_high"] < 0)]

    lines = [
        "| agents | observation | against | returns | difference of *s* | p |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows.to_dict("records"):
        agents = row["algo"] + (", `figure8`" if row["words"] == "settings=figure8" else "")
        observations = [f"`{row['representation']}`", f"`{row['against']}`"]
        interval = f"[{row['corrected_low']:+.0f}, {row['corrected_high']:+.0f}]"
        (p_value,) = re.findall(r"p = ([\d.]+)", row["text"])
        cells = [agents, *observations, row["returns"], interval, p_value]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def table_of_td3(numbers: ShippedNumbers, rows: tuple[AgentsOfTD3, ...]) -> str:
    """Returns a table of agents of TD3, with each row's differences from other agents."""
    lines = [
        "| task | observation | over the run | difference | at the end | difference "
        "| each agent, at the end |",
        "|---|---|---|---|---|---|---|",
    ]
    above = ""
    for row in rows:
        pair = Pair("TD3", row.task, row.name, row.against)
        cells = ["" if row.task == above else f"`{row.task}`", row.words]
        for column in ("over_run", "final"):
            returns = numbers.returns("TD3", row.task, row.name, column)
            cells.append(f"{interquartile_mean([returns]):,.0f}")
            cells.append(numbers.difference(pair, column))
        cells.append(_each(numbers.returns("TD3", row.task, row.name)))
        lines.append(f"| {' | '.join(cells)} |")
        above = row.task
    return "\n".join(lines)


def verdicts_table(numbers: ShippedNumbers) -> str:
    """Returns the table of the sequential test's verdicts on latents against `full`, by robot."""
    lines = ["| task | latents | seeds | difference | verdict |", "|---|---|---|---|---|"]
    for row in ON_EACH_ROBOT:
        rows = numbers.decisions
        latents = (rows["algo"] == "TD3") & (rows["task"] == row.task) & (rows["name"] == row.name)
        against_full = (rows["claim"] == "a") & (rows["against"] == "full")
        (decision,) = rows[latents & against_full].to_dict("records")

        ends = f"[{decision['low']:+,.0f}, {decision['high']:+,.0f}]"
        interval = f"{decision['difference']:+,.0f} {ends}"
        cells = [f"`{row.task}`", row.words, str(decision["seeds"]), interval, decision["verdict"]]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _p_in_words(p_value: float) -> str:
    """Returns such as `0.215`, or `< 0.001`."""
    return f"{p_value:.3f}" if p_value >= 0.001 else "< 0.001"


def ddpg_evaluations() -> pd.DataFrame:
    """Returns mean evaluation returns of DDPG: a row for each evaluation.

    Its columns are task, representation, settings, is_standardized, seed, control_steps and mean;
    see `Agents`.
    """
    rows = jbench.open("reference").query(
        "SELECT task, representation, seed, control_steps, avg(episode_return) AS mean, "
        "runs.settings->>'$.hyperparameters' AS hyperparameters "
        "FROM evaluations JOIN runs USING (run) "
        "WHERE algo = 'ddpg' AND engine = 'batched' GROUP BY ALL"
    )
    settings = {}
    is_standardized = {}
    for task, text in set(zip(rows["task"], rows["hyperparameters"], strict=True)):
        hyperparameters = json.loads(text)
        settings[text] = nearest_base("ddpg", hyperparameters, task)
        is_standardized[text] = hyperparameters.get("normalize") == "running"

    return rows.assign(
        settings=rows["hyperparameters"].map(settings),
        is_standardized=rows["hyperparameters"].map(is_standardized),
    )


def table_by_step(columns: tuple[Agents, ...], evaluations: pd.DataFrame) -> str:
    """Returns a table of agents by control step, over the run and at the end.

    A cell has the median of the agents, and the lowest and highest of them.
    """
    curves = [_curves(agents, evaluations) for agents in columns]
    rows = [["control steps", *(agents.words for agents in columns)]]
    for steps in AUTHORS_STEPS:
        rows.append(
            [f"{steps:,}", *(_median_and_range(one.loc[steps].to_numpy()) for one in curves)]
        )

    rows.append(["over the run", *(_median_and_range(one.mean().to_numpy()) for one in curves)])
    rows.append(["each agent, at the end", *(_each(one.iloc[-1]) for one in curves)])
    heading, *lines = [f"| {' | '.join(cells)} |" for cells in rows]
    return "\n".join([heading, f"|{'---|' * len(rows[0])}", *lines])


def _curves(agents: Agents, evaluations: pd.DataFrame) -> pd.DataFrame:
    """Returns mean evaluation returns by control step and seed."""
    chosen = evaluations["task"] == agents.task
    chosen &= evaluations["representation"] == agents.representation
    chosen &= evaluations["settings"] == agents.settings
    chosen &= evaluations["is_standardized"] == agents.is_standardized
    return evaluations[chosen].pivot(index="control_steps", columns="seed", values="mean")


def _each(values: Iterable[float]) -> str:
    """Returns whole numbers such as `181, 833, 212`."""
    return ", ".join(f"{value:,.0f}" for value in values)


def _median_and_range(values: FloatArray) -> str:
    """Returns such as `312 (180 to 867)`."""
    return f"{np.median(values):.0f} ({values.min():.0f} to {values.max():.0f})"


def with_table(text: str, name: str, table: str) -> str:
    """Returns a page's text with another table in a place. Raises a ValueError if it has none."""
    pattern = PLACE.format(name=re.escape(name))
    changed, count = re.subn(
        pattern, lambda found: f"{found[1]}{table}\n{found[2]}", text, flags=re.DOTALL
    )
    if count != 1:
        raise ValueError(f"the page has {count} places for the table {name}")
    return changed


def pages(numbers: ShippedNumbers) -> dict[Path, str]:
    """Returns the text of each page with its tables."""
    readme = ROOT / "README.md"
    answer = ROOT / "docs" / "answer.md"
    details = ROOT / "docs" / "answer-details.md"

    readme_table = main_table(numbers, README_ROWS, "final evaluation return")
    answer_table = main_table(numbers, ANSWER_ROWS, "the agent observes")
    answer_text = with_table(answer.read_text("utf-8"), "main", answer_table)
    answer_text = with_table(answer_text, "steps", steps_table(numbers))
    evaluations = ddpg_evaluations()
    by_step = {"figure-7": FIGURE_7, "standardized": STANDARDIZED, "figure-8": FIGURE_8}
    for name, columns in by_step.items():
        answer_text = with_table(answer_text, name, table_by_step(columns, evaluations))
    answer_text = with_table(answer_text, "with-td3", table_of_td3(numbers, WITH_TD3))
    answer_text = with_table(answer_text, "robots", table_of_td3(numbers, OTHER_ROBOTS))
    details_text = details.read_text("utf-8")
    details_text = with_table(details_text, "differences", differences_table(numbers))
    details_text = with_table(details_text, "variability", variability_table(numbers.verdicts))
    readme_text = with_table(readme.read_text("utf-8"), "main", readme_table)
    readme_text = with_table(readme_text, "verdicts", verdicts_table(numbers))
    return {
        readme: readme_text,
        answer: answer_text,
        details: details_text,
    }


if __name__ == "__main__":
    for path, text in pages(ShippedNumbers()).items():
        path.write_text(text, "utf-8")
