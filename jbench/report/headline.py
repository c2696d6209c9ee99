"""The headline of a report: one plain sentence or two on what was learned."""

from collections.abc import Iterator, Mapping

import pandas as pd

from jbench.names import FULL, in_prose
from jbench.report.data.returns import FILE, steps, whole
from jbench.statistics.bootstrap import DECIDING_SEEDS

_OUTCOMES = {
    "higher": "reach higher final returns",
    "lower": "reach lower final returns",
    "faster": "learn faster",
    "slower": "learn more slowly",
    "similar": "reach similar final returns",
}
_MAX_WORDS = 30


def headline(verdicts: pd.DataFrame, configurations: pd.DataFrame, compared: pd.DataFrame) -> str:
    """Returns the headline, of at most 30 words; it names tasks where the answer depends on them.

    All rows are of one kind of return; there are comparisons only if two sides are compared.
    """
    known = configurations[configurations["seeds"] > 0]
    if known.empty:
        return "There are no returns yet."
    from_file = FILE in {*known["source"]}
    single = from_file and known["label"].nunique() == 1
    if known["seeds"].max() < DECIDING_SEEDS and not single:
        seeds, longest = int(known["seeds"].max()), steps(known["steps"].max())
        count = "one seed" if seeds == 1 else f"{seeds} seeds"
        if from_file:
            return f"{count.capitalize()} of a method can't decide a comparison."
        return f"Too early to say: {count} of {longest} control steps can't decide anything."
    if len(compared) and len(compared[["a", "b"]].drop_duplicates()) == 1:
        return _on_sides(compared[compared["task"].isin(known["task"])])
    against_full = verdicts[verdicts["against"] == FULL]
    if against_full.empty:
        return _best(known)
    clauses = dict(_clauses(against_full))
    if not clauses:
        return "Whether agents learn as well on a reduced observation is undecided."
    algos = against_full["algo"][against_full["verdict"].isin([*clauses])].unique()
    who = f"{algos[0]} agents" if len(algos) == 1 else "agents"
    while len(_sentence(clauses, who).split()) > _MAX_WORDS and len(clauses) > 1:
        clauses.popitem()
    return _sentence(clauses, who)


def _on_sides(comparisons: pd.DataFrame) -> str:
    first, other = comparisons[["a", "b"]].iloc[0]
    words = [*comparisons["verdict"]]
    counts = {word: words.count(word) for word in ("higher", "lower", "similar") if word in words}
    if not counts:
        answer = "undecided"
    elif len(comparisons) == 1:
        (answer,) = counts
    else:
        answer = in_prose([f"{word} in {count}" for word, count in counts.items()], "and")
        tasks = comparisons["task"].nunique() == len(comparisons)
        answer += f" of {len(comparisons)} {'tasks' if tasks else 'configurations'}"
    return f"The final return with {first}, compared with {other}, is {answer}."


def _sentence(clauses: Mapping[str, str], who: str) -> str:
    text = "; ".join(clauses.values())
    if "higher" in clauses:
        text = text.replace(_OUTCOMES["lower"], "lower ones")
    return f"Compared with the full observation, {who} {text}."


def _clauses(verdicts: pd.DataFrame) -> Iterator[tuple[str, str]]:
    """Yields outcomes and a clause on each: with which representations, on which tasks."""
    where: dict[str, dict[str, list[str]]] = {}
    for representation, rows in verdicts.groupby("representation", sort=False):
        outcomes: dict[str, list[str]] = {}
        for task, group in rows.groupby("task", sort=False):
            outcomes.setdefault(_outcome(group), []).append(str(task))
        for outcome, tasks in outcomes.items():
            everywhere = len(tasks) == rows["task"].nunique()
            on = "" if everywhere else f" on {in_prose(tasks, 'and')}"
            where.setdefault(outcome, {}).setdefault(on, []).append(str(representation))
    for outcome, verb in _OUTCOMES.items():
        if outcome in where:
            parts = sorted(where[outcome].items())
            texts = [f"with {in_prose(names, 'and')}{on}" for on, names in parts]
            yield outcome, f"{verb} {', and '.join(texts)}"


def _outcome(rows: pd.DataFrame) -> str:
    """Returns how agents on a representation end on a task, or learn, if all algorithms agree."""
    final, speed = ({*rows["verdict"][rows["claim"] == claim]} for claim in ("a", "c"))
    for words in (final - {"undecided"}, speed - {"undecided"}):
        if len(words) == 1 and words != {"similar"}:
            return str(words.pop())
    return "similar" if final == {"similar"} else "undecided"


def _best(configurations: pd.DataFrame) -> str:
    best = configurations.loc[configurations.groupby("task", sort=False)["median"].idxmax()]
    text = ""
    for row in best.to_dict("records"):
        median = f"a median return of {whole(row['median'])} on {row['task']}"
        longer = f"{text} {row['label']} reaches {median}.".strip()
        if not text or len(longer.split()) <= _MAX_WORDS:
            text = longer
    return text
