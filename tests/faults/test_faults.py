"""After any failing call: one sentence, intact results, and the same end at a second try."""

import json
import subprocess
import sys

import pytest

from tests.forking import ROOT

SAMPLE = {"collect": 2, "train": 1, "resume": 1, "evaluate": 2, "merge": 2, "repair": 2}
"""Faults of the verbs of a quick test."""

LARGER_SAMPLE = {
    **{"collect": 8, "train-dae": 3, "train-encoder": 4, "train": 6, "resume": 8},
    **{"evaluate": 12, "merge": 14, "repair": 14, "export": 6, "import": 8},
}

VERBS = (*LARGER_SAMPLE, "sweep", "report")


def tried(verbs):
    """The cases of the harness, by verb."""
    command = [sys.executable, "-m", "tests.faults.fault_harness", json.dumps({"verbs": verbs})]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    cases = [json.loads(line) for line in done.stdout.splitlines()]
    return {verb: [case for case in cases if case["verb"] == verb] for verb in verbs}


@pytest.fixture(scope="module")
def sample():
    return tried(SAMPLE)


@pytest.mark.parametrize("verb", SAMPLE)
def test_a_verb_that_meets_a_fault_says_so_and_loses_nothing(sample, verb):
    assert len(sample[verb]) == SAMPLE[verb]
    assert [case for case in sample[verb] if case["problems"]] == []


def test_the_faults_are_met(sample):
    # A fault that is armed and never met would pass everything. An interrupted `close` is no error.
    every = [case for cases in sample.values() for case in cases]
    codes = [case["code"] for case in every if case["call"] != "close"]
    assert codes.count(1) > len(codes) / 2


@pytest.mark.slow
@pytest.mark.parametrize("verb", LARGER_SAMPLE)
def test_a_verb_that_meets_more_faults_says_so_and_loses_nothing(verb):
    cases = tried({verb: LARGER_SAMPLE[verb]})[verb]
    assert len(cases) == LARGER_SAMPLE[verb]
    assert [case for case in cases if case["problems"]] == []


@pytest.mark.faults
@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_meets_a_fault_at_each_of_its_calls(verb):
    cases = tried({verb: None})[verb]
    assert len(cases) > 50
    assert [case for case in cases if case["problems"]] == []
