"""Tests of the length of a report's headline, on verdicts and medians that are given."""

import pandas as pd

from jbench.report.data.source_names import OWN
from jbench.report.headline import headline


def configurations(*medians):
    """Returns a configuration of eight seeds for each median, on task1, task2 and so on."""
    rows = [
        {"task": f"task{number}", "median": median, "label": "TD3 full", "source": OWN, "seeds": 8}
        for number, median in enumerate(medians, 1)
    ]
    return pd.DataFrame(rows).assign(steps_min=100_000, steps=100_000)


def verdicts(names_by_outcome):
    """Returns the verdicts on final returns of representations, against full on task1."""
    rows = [
        {"representation": name, "verdict": outcome}
        for outcome, names in names_by_outcome.items()
        for name in names
    ]
    return pd.DataFrame(rows).assign(task="task1", algo="TD3", against="full", claim="a")


def test_last_outcomes_are_left_out_of_more_than_34_words():
    of_34_words = verdicts({"similar": "pq", "higher": "abcd", "lower": "uvw"})
    assert headline(of_34_words, configurations(900.0), pd.DataFrame()) == (
        "Compared with the full observation, TD3 agents on task1 reach higher final returns with "
        "a, b, c and d; lower ones with u, v and w; reach similar final returns with p and q."
    )
    of_35_words = verdicts({"similar": "pq", "higher": "abcd", "lower": "uvwx"})
    assert headline(of_35_words, configurations(900.0), pd.DataFrame()) == (
        "Compared with the full observation, TD3 agents on task1 reach higher final returns with "
        "a, b, c and d; lower ones with u, v, w and x."
    )


def test_single_outcome_is_named_however_long_it_is():
    names = [f"name{number}" for number in range(40)]
    found = headline(verdicts({"higher": names}), configurations(900.0), pd.DataFrame())
    assert found.endswith("name37, name38 and name39.")


def test_best_configurations_are_as_many_as_fit():
    # Each sentence has 14 words.
    nothing_reduced = verdicts({"higher": "a"}).assign(against="scaled")
    assert headline(nothing_reduced, configurations(900.0, 800.0, 700.0), pd.DataFrame()) == (
        "TD3 full reaches a median return of 900 on task1 after 100k control steps. "
        "TD3 full reaches a median return of 800 on task2 after 100k control steps."
    )
