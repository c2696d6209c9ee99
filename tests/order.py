"""The order of the tests in the processes of pytest-xdist.

With `--dist worksteal`, each worker begins with a contiguous share of the tests, and a worker that
has finished takes over the second half of the longest share. So the tests at the beginning of a
share stay in one worker, and what they have in common is made once: the frames of the shipped runs,
a browser, or the trainings of a module.
"""

import os

SHIPPED_FRAMES = (
    "tests/report/test_answer.py",
    "tests/report/test_golden.py::test_numbers_are_as_before[shipped-",
)
BROWSER = "chromium"
"""The fixture of all tests in a browser."""
OWN_CODE = (
    "tests/commands/test_packages.py",
    "tests/commands/test_changed_code.py",
    "tests/commands/test_your_own_robot.py",
)
PIPELINE = ("tests/commands/test_pipeline.py",)
ONNX = (
    "tests/policies/test_onnx_export.py",
    "tests/training/test_mirrored_actions.py",
    "tests/agents/test_normalized_inputs.py",
)
TRAININGS = ("tests/training/test_checkpoints.py", "tests/commands/test_encoders.py")

BEGINNINGS = ((SHIPPED_FRAMES, BROWSER), (OWN_CODE, PIPELINE), (TRAININGS, ONNX))
"""The groups that begin each of three shares; each group has prefixes of its tests, or a fixture.

The groups of a share take less than a third of the time of all tests.
"""


def workers() -> int:
    """Returns the number of processes that run the tests: 1 without pytest-xdist."""
    return int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", 1))


def place(item):
    """Returns the share and the group that a test belongs to, or None."""
    for share, groups in enumerate(BEGINNINGS):
        for number, group in enumerate(groups):
            if group in item.fixturenames if group is BROWSER else item.nodeid.startswith(group):
                return share, number
    return None


def in_shares(items, count):
    """Returns the tests in the order in which each group begins the share of a worker.

    Args:
        items: all tests.
        count: of workers, whose shares have sizes as in `xdist.scheduler.worksteal`.
    """
    beginnings = [[] for _ in range(count)]
    others = []
    for item in items:
        found = place(item)
        if found is None:
            others.append(item)
        else:
            share, group = found
            beginnings[share % count].append((share, group, item))

    ordered = []
    for number, beginning in enumerate(beginnings):
        size = (len(items) - len(ordered)) // (count - number)
        ordered += [item for *_, item in sorted(beginning, key=lambda entry: entry[:2])]
        room = max(0, size - len(beginning))
        ordered += others[:room]
        others = others[room:]
    return ordered + others
