"""The headline of a report: one plain sentence or two on what was learned."""

import re
from collections.abc import Iterator, Mapping

import pandas as pd

from jbench.numbers import steps, whole
from jbench.report.data.source_names import FILE
from jbench.representation_names import FULL
from jbench.statistics.verdicts import DECIDING_SEEDS
from jbench.studies.quantities import FINAL_RETURN, SIMILAR, SPEED, UNDECIDED
from jbench.wording import in_prose

_OUTCOMES = {
    "higher": "reach higher final returns",
    "lower": "reach lower final returns",
    "faster": "learn faster",
    "slower": "learn more slowly",
    SIMILAR: "reach similar final returns",
}
_MAX_WORDS = 34
_MAX_TASKS = 2  # that a sentence names


def headline(
    verdicts: pd.DataFrame, configurations: pd.DataFrame, compared: pd.DataFrame, common: str = ""
) -> str:
    """Returns the headline, of at most 34 words; it names tasks where the answer depends on them.

    All rows are of one kind of return; there are comparisons only if two sides are compared, which
    may have settings in common.
    """
    known = configurations[configurations["seeds"] > 0]
    if known.empty:
        return "There are no returns yet."

    from_file = FILE in {*known["source"]}
    single = from_file and known["label"].nunique() == 1
    is_decided = (verdicts["verdict"] != UNDECIDED).any()
    if known["seeds"].max() < DECIDING_SEEDS and not single and not is_decided:
        seeds = int(known["seeds"].max())
        longest = steps(known["steps"][known["seeds"] == seeds].max())
        count = "one seed" if seeds == 1 else f"{seeds} seeds"
        if from_file:
            return f"{count.capitalize()} of a method can't decide a comparison."
        return f"Too early to say: {count} of {longest} control steps can't decide anything."

    if len(compared) and len(compared[["a", "b"]].drop_duplicates()) == 1:
        rows = compared[compared["task"].isin(known["task"])]
        equally_long = known.groupby("task")["steps"].nunique().max() == 1
        outcome = _on_sides(rows, equally_long)
        return f"With {common}, the {outcome}" if common else f"The {outcome}"

    against_full = verdicts[verdicts["against"] == FULL]
    if against_full.empty:
        return _best(known)

    clauses = dict(_clauses(against_full))
    if not clauses:
        about = _about(against_full, in_prose(against_full["algo"].unique(), "and"))
        return f"Whether {about} learn as well on a reduced observation is undecided."

    while len(_sentence(clauses, against_full).split()) > _MAX_WORDS and len(clauses) > 1:
        clauses.popitem()

    return _sentence(clauses, against_full)


def _about(verdicts: pd.DataFrame, algos: str) -> str:
    """Names the agents, and their task if there is one."""
    tasks = list(verdicts["task"].unique())
    return f"{algos} agents on {tasks[0]}" if len(tasks) == 1 else f"{algos} agents"


def _on_sides(comparisons: pd.DataFrame, equally_long: bool) -> str:
    """Returns the outcome of a comparison, without the article before it.

    Sides of different lengths have their control steps.
    """
    first, other = comparisons[["a", "b"]].iloc[0]
    words = [*comparisons["verdict"]]
    counts = {word: words.count(word) for word in ("higher", "lower", SIMILAR) if word in words}
    if not counts:
        answer = UNDECIDED
    elif len(comparisons) == 1:
        (answer,) = counts
    else:
        answer = in_prose([f"{word} in {count}" for word, count in counts.items()], "and")
        tasks = comparisons["task"].nunique() == len(comparisons)
        answer += f" of {len(comparisons)} {'tasks' if tasks else 'configurations'}"

    after = ""
    if not equally_long:
        ends = comparisons["steps"]
        shown = dict.fromkeys((steps(ends.min()), steps(ends.max())))
        after = f" after {' to '.join(shown)} control steps"

    return f"final return with {first}, compared with {other}, is {answer}{after}."


def _sentence(clauses: Mapping[str, str], verdicts: pd.DataFrame) -> str:
    """Returns the verdicts in one sentence, which names agents once if all have the same."""
    text = "; ".join(clauses.values())
    if "higher" in clauses:
        text = text.replace(_OUTCOMES["lower"], "lower ones")

    # Each clause names its own agents and tasks where they differ.
    named = {*re.findall(r" \(([^()]*)\)", text)}
    about = "agents"
    if len(named) == 1 or verdicts["algo"].nunique() == 1:
        algos = [*named] or [*verdicts["algo"].unique()]
        about = _about(verdicts[verdicts["algo"].isin(algos)], algos[0])
        text = text.replace(f" ({algos[0]})", "")

    tasks = list(verdicts["task"].unique())
    on = f" on {in_prose(tasks, 'and')}" if 1 < len(tasks) <= _MAX_TASKS else ""
    on = "" if " on " in text else on
    return f"Compared with the full observation{on}, {about} {text}."


def _clauses(verdicts: pd.DataFrame) -> Iterator[tuple[str, str]]:
    """Yields outcomes and a clause on each: with which representations, agents, on which tasks."""
    names_agents = verdicts["algo"].nunique() > 1
    # Of each outcome, the representations by where it is found.
    found: dict[str, dict[str, list[str]]] = {}
    for representation, rows in verdicts.groupby("representation", sort=False):
        for outcome, where in _outcomes(rows, names_agents):
            found.setdefault(outcome, {}).setdefault(where, []).append(str(representation))

    for outcome, verb in _OUTCOMES.items():
        if outcome in found:
            parts = sorted(found[outcome].items())
            texts = [f"with {in_prose(names, 'and')}{where}" for where, names in parts]
            yield outcome, f"{verb} {', and '.join(texts)}"


def _outcomes(rows: pd.DataFrame, names_agents: bool) -> Iterator[tuple[str, str]]:
    """Yields the outcomes of a representation, and in words where: ` on face_direction (TD3)`.

    Args:
        rows: verdicts on the representation.
        names_agents: whether the algorithms are named.
    """
    tasks: dict[tuple[str, str], list[str]] = {}
    for task, group in rows.groupby("task", sort=False):
        outcome, algos = _outcome(group)
        agents = f" ({in_prose(algos, 'and')})" if names_agents and algos else ""
        tasks.setdefault((outcome, agents), []).append(str(task))

    for (outcome, agents), names in tasks.items():
        everywhere = len(names) == rows["task"].nunique()
        on = "" if everywhere else f" on {in_prose(names, 'and')}"
        yield outcome, on + agents


def _outcome(rows: pd.DataFrame) -> tuple[str, list[str]]:
    """Returns how agents on a representation end on a task, or learn, and which algorithms do.

    It is undecided if algorithms disagree. Those count of which all variants agree.
    """
    final = _agreed(rows[rows["claim"] == FINAL_RETURN.claim])
    speed = _agreed(rows[rows["claim"] == SPEED.claim])
    for decided in (final, speed):
        words = {*decided.values()} - {UNDECIDED}
        if len(words) == 1 and words != {SIMILAR}:
            (word,) = words
            return word, [algo for algo, verdict in decided.items() if verdict == word]

    if {*final.values()} == {SIMILAR}:
        return SIMILAR, [*final]
    return UNDECIDED, []


def _agreed(rows: pd.DataFrame) -> dict[str, str]:
    """Returns the verdict of each algorithm; undecided if its variants have different ones."""
    verdicts: dict[str, str] = {}
    for algo, group in rows.groupby("algo", sort=False):
        words = group["verdict"].unique()
        verdicts[str(algo)] = str(words[0]) if len(words) == 1 else UNDECIDED
    return verdicts


def _best(configurations: pd.DataFrame) -> str:
    """Returns sentences on the best configuration of each task, as many as fit."""
    best = configurations.loc[configurations.groupby("task", sort=False)["median"].idxmax()]
    text = ""
    for row in best.to_dict("records"):
        reached = f"a median return of {whole(row['median'])} on {row['task']}"
        ends = dict.fromkeys((steps(row["steps_min"]), steps(row["steps"])))
        median = f"{reached} after {' to '.join(ends)} control steps"
        longer = f"{text} {row['label']} reaches {median}.".strip()
        if not text or len(longer.split()) <= _MAX_WORDS:
            text = longer

    return text
