"""Tests that a command with a failing system call prints one error and loses no results.

The repeated command must have the results of a command without a fault.
"""

import json
import subprocess
import sys
from collections import Counter

import pytest

from tests.forking import ROOT

SAMPLE = {"collect": 1, "merge": 2}
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
    command = [sys.executable, "-m", "tests.faults.fault_harness", json.dumps({"verbs": verbs})]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    cases = [json.loads(line) for line in done.stdout.splitlines()]
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
