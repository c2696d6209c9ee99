"""Commands that look at this machine and at code of others: doctor, check."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Argument, Option

from jbench import names, typed_values
from jbench.commands import options, output, parsing
from jbench.errors import RequestError, WorkError
from jbench.wording import are, counted, with_article

if TYPE_CHECKING:
    from jbench.checks.checked import Checked


def doctor(
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """Check that jbench works on this machine: versions, cores, drivers, results directory.

    A line for each check. It leaves no file behind. The exit code is 1 if something will fail.
    """
    from jbench.checks.machine import check_machine
    from jbench.store import Results

    database = Results(results)
    if results.exists() or names.is_reference(results):
        database = parsing.results_to_read(results)

    _show(check_machine(database), {})


def check(
    name: str = Argument(
        ...,
        metavar="MODULE:CLASS",
        help="A task, agent, update rule, kind of encoder or policy of yours, in a module of the "
        "working directory or of an installed package, or by the name of its entry point.",
    ),
    kind: str | None = Option(
        None,
        "--as",
        metavar="WHAT",
        help="What it is: task, agent, rule, encoder or policy (default: found out).",
    ),
    task: str | None = options.some_task(
        None, help="Task to check it on, unless it is one (default: face_direction)."
    ),
    latents: int | None = options.whole_number(
        None,
        "--latent",
        unit="LATENTS",
        least=1,
        help="Latents of an encoder (default: 12, or the most it has).",
    ),
    set_: list[str] = options.SET_OF_CODE,
    json: bool = options.JSON,
) -> None:
    """Check a task, an agent, an update rule, an encoder or a policy of yours.

    It is run through what jbench will demand of it, in short episodes, in seconds; nothing is
    written. A line for each check says what is missing; the exit code is 1 if something is.
    """
    from jbench.checks.code import KINDS, CheckRequest, check_code, kind_of_code

    checked_as = (
        kind_of_code(name) if kind is None else typed_values.known("kind of code", kind, KINDS)
    )
    if task is not None and checked_as == "task":
        raise RequestError(f"{name} is a task, which is checked on itself: leave --task out.")

    settings = parsing.parse_overrides(set_)
    request = CheckRequest(name, task or "face_direction", settings, latents)
    output.say(f"{name} is checked as {with_article(checked_as)}.")
    _show(check_code(checked_as, request), {"name": name, "what": checked_as})


def _show(lines: Iterable["Checked"], about: dict[str, Any]) -> None:
    """Prints checks as they are made; raises a WorkError if one fails."""
    checked = []
    for line in lines:
        output.say(f"{line.state:5}  {line.name}: {line.text}")
        checked.append(line)

    failing = [line.name for line in checked if line.state == "fails"]
    output.document({**about, "ok": not failing, "checks": [line._asdict() for line in checked]})
    if failing:
        count = counted(len(failing), "check")
        raise WorkError(f"{count} {are(len(failing))} not passed: {', '.join(failing)}; see above.")
