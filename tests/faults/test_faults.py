"""Tests that a command with a failing system call prints one error and loses no results.

The repeated command must have the results of a command without a fault.
"""

import json
from collections import Counter

import pytest

from tests.command_line import Process

SAMPLE = {"collect": 2}
"""Number of faults of each command."""

LARGER_SAMPLE = {
    "collect": 8,
    "train-dae": 3,
    "train-encoder": 4,
    "train": 6,
    "resume": 8,
    "evaluate": 12,
    "merge": 14,
    "repair": 14,
    "export": 6,
    "import": 8,
}

VERBS = (*LARGER_SAMPLE, "sweep", "report")


def run_cases(verbs):
    """Runs the harness; returns its cases, none of which has problems."""
    process = Process("tests.faults.fault_harness:main", {"verbs": verbs})
    printed, errors = process.communicate()
    assert process.returncode == 0, errors
    cases = [json.loads(line) for line in printed.splitlines()]
    assert [case for case in cases if case["problems"]] == []
    return cases


def test_command_with_fault_reports_error_and_loses_nothing():
    cases = run_cases(SAMPLE)
    assert Counter(case["verb"] for case in cases) == SAMPLE
    # A fault that never occurs would pass all checks. An interrupted `close` is not an error.
    codes = [case["code"] for case in cases if case["call"] != "close"]
    assert codes.count(1) > len(codes) / 2


@pytest.mark.slow
@pytest.mark.parametrize("verb", LARGER_SAMPLE)
def test_command_with_more_faults_reports_error_and_loses_nothing(verb):
    assert len(run_cases({verb: LARGER_SAMPLE[verb]})) == LARGER_SAMPLE[verb]


@pytest.mark.faults
@pytest.mark.parametrize("verb", VERBS)
def test_fault_at_each_call_loses_nothing(verb):
    assert len(run_cases({verb: None})) > 50
