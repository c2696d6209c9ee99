"""Tests of what reports say of runs of different code."""

import pytest

from jbench.report.data.code import own_words


@pytest.mark.parametrize(
    ("words", "others", "own"),
    [
        ("hidden_layers=[8, 8], code 3f2a91", "hidden_layers=[8, 8], code 3f2c44", "code 3f2a91"),
        ("code 3f2a91 of 2026-11-28", "code 77c0d2 of 2026-11-28", "code 3f2a91 of 2026-11-28"),
        ("tau=0.1, code 3f2a91", "", "tau=0.1, code 3f2a91"),
        ("", "code 3f2a91", ""),
        ("sizes=[8, 8], tau=0.1", "sizes=[8, 4], tau=0.1", "sizes=[8, 8], tau=0.1"),
    ],
)
def test_other_runs_are_named_by_what_they_do_not_share(words, others, own):
    assert own_words(words, others) == own
