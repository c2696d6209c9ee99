"""Makes each system call of each verb that writes fail, and counts broken promises.

    python benchmarks/faults.py                    every call with every error
    python benchmarks/faults.py --one-error        every call with one of the errors
    python benchmarks/faults.py --verbs train,merge

`tests/faults/fault_harness.py` defines the cases and the checks after each. This script prints each
case that breaks a promise, and a table with the number of cases, or `wrong of cases`, for each verb
and call. Ctrl-C prints the table of what was tried.
"""

import argparse
import contextlib
import json
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

# These imports need the directory in sys.path.
from tests.faults.fault_injection import CALLS  # noqa: E402
from tests.faults.fault_verbs import VERBS  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--verbs", help="Only these, separated by commas.")
    parser.add_argument("--calls", help="Only these, separated by commas.")
    parser.add_argument("--one-error", action="store_true", help="One error for each call.")
    parser.add_argument("--sample", type=int, help="Number of cases of each verb, drawn at random.")
    options = parser.parse_args()
    verbs = options.verbs.split(",") if options.verbs else VERBS
    request = {
        "verbs": dict.fromkeys(verbs, options.sample),
        "calls": options.calls.split(",") if options.calls else CALLS,
        "every_error": not options.one_error,
    }
    began = time.monotonic()
    tried: Counter[tuple[str, str]] = Counter()
    wrong: Counter[tuple[str, str]] = Counter()
    command = [sys.executable, "-m", "tests.faults.fault_harness", json.dumps(request)]
    # Ctrl-C also ends the harness; the table contains the cases until then.
    with (
        subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as harness,
        contextlib.suppress(KeyboardInterrupt),
    ):
        assert harness.stdout is not None
        for line in harness.stdout:
            case = json.loads(line)
            tried[case["verb"], case["call"]] += 1
            if tried.total() % 100 == 0:
                print(f"{tried.total():,} cases, now {case['verb']}", file=sys.stderr, flush=True)
            if case["problems"]:
                wrong[case["verb"], case["call"]] += 1
                print(case["verb"], case["fault"], *case["problems"], sep="\n  ", file=sys.stderr)
    print(table(tried, wrong))
    seconds = time.monotonic() - began
    print(f"{tried.total():,} cases, {wrong.total():,} of them wrong, in {seconds:,.0f} s")
    return 1 if harness.returncode or wrong else 0


def table(tried: Counter[tuple[str, str]], wrong: Counter[tuple[str, str]]) -> str:
    """Returns a Markdown table with a row for each verb and a column for each call."""
    lines = [f"| verb | {' | '.join(CALLS)} |", "|---" * (1 + len(CALLS)) + "|"]
    for verb in dict.fromkeys(verb for verb, _ in tried):
        cells = []
        for call in CALLS:
            bad, count = wrong[verb, call], tried[verb, call]
            cells.append(f"**{bad} of {count}**" if bad else f"{count:,}")
        lines.append(f"| {verb} | {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
