"""Hyperparameters that all runs of a report share: a note has them instead of every name."""

import re
from collections.abc import Sequence

from jbench.report.data.configuration import Configuration
from jbench.settings.run import RunSettings
from jbench.settings.variants import hyperparameter_words


def leave_out_shared(configurations: Sequence[Configuration]) -> str:
    """Takes the hyperparameters that all trained configurations name out of their names.

    Returns:
        These hyperparameters in words; empty if there are none.
    """
    trained = [c for c in configurations if isinstance(c.settings, RunSettings)]
    if not trained:
        return ""

    shared = [
        word
        for word in hyperparameter_words(trained[0].settings)
        if all(_pattern(word).search(config.words) for config in trained)
    ]
    for config in trained:
        words = config.words
        for word in shared:
            words = _pattern(word).sub("", words)
        config.set_words(words.removeprefix(", "))

    return ", ".join(shared)


def _pattern(word: str) -> re.Pattern[str]:
    """Returns what matches a word of a name, with the comma before it."""
    return re.compile(rf"(?:^|, ){re.escape(word)}(?=, |$)")
