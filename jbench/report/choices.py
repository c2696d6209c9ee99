"""What a reader chooses of a report: names, bounds of normalized returns, and a margin."""

from collections.abc import Iterable, Sequence

from jbench.errors import RequestError
from jbench.numbers import whole
from jbench.report.data.configuration import Configuration
from jbench.report.data.sources import Source
from jbench.report.request import Request
from jbench.studies.quantities import MARGIN
from jbench.wording import in_prose


def use_choices(source: Source, request: Request) -> None:
    """Sets the margin and the bounds of normalized returns that a reader typed, if any."""
    use_margin(source.configurations, request.margin)
    for task, low, high in request.normalize:
        _use_bounds(source.configurations, task, (low, high))
        source.notes.append(
            f"Normalized returns: of {task}, {whole(low)} is 0 and {whole(high)} is 1."
        )


def _use_bounds(
    configurations: Iterable[Configuration], task: str, bounds: tuple[float, float]
) -> None:
    """Sets the returns of a task that are 0 and 1 where returns are normalized.

    Raises:
        RequestError: if there is no such task, or no other one to join it with.
    """
    tasks = dict.fromkeys(config.task for config in configurations)
    if task not in tasks:
        there = in_prose(tasks, "and") if tasks else "no runs"
        raise RequestError(f"--normalize {task}: the report has no such task; it has {there}.")
    if len(tasks) == 1:
        raise RequestError(
            f"--normalize {task}: returns of a single task are not normalized; leave --normalize "
            "out."
        )

    for config in configurations:
        if config.task == task:
            config.return_range = bounds


def use_margin(configurations: Iterable[Configuration], margin: float | None) -> None:
    """Sets the margin, if one is typed, of configurations on tasks whose largest return is unknown.

    Raises:
        RequestError: if there are none.
    """
    if margin is None:
        return

    unknown = [config for config in configurations if not config.margin]
    if not unknown:
        raise RequestError(
            f"--margin {margin:g}: on these tasks, final returns are similar within {MARGIN:g}; "
            "leave --margin out."
        )

    for config in unknown:
        config.margin = margin


def rename(
    configurations: Iterable[Configuration], names: Sequence[tuple[str, str]]
) -> dict[str, str]:
    """Gives representations, or the methods of a file, the names that a reader has chosen.

    A name of a kind, such as `six-rows`, means all sizes, which keep them if there are several.

    Returns:
        The new names by the old ones.

    Raises:
        RequestError: if there is nothing of such a name, or two things would have the same one.
    """
    every = list(configurations)
    known = {config.identity[config.named_by]: config for config in every}
    chosen = dict[str, str]()
    for old, new in names:
        of_kind = [name for name, config in known.items() if config.identity["kind"] == old]
        if old in known:
            chosen[old] = new
        elif of_kind:
            for name in of_kind:
                chosen[name] = new if len(of_kind) == 1 else new + name.removeprefix(old)
        else:
            raise RequestError(
                f"--names {old}={new}: the report has no {old}; it has {', '.join(known)}."
            )

    # Curves, rows and cells of one name would be taken for one.
    shown: dict[str, str] = {}
    for old in known:
        new = chosen.get(old, old)
        other = shown.setdefault(new, old)
        if other != old:
            raise RequestError(
                f"--names: {other} and {old} would both be called {new}; choose another name for "
                "one of them."
            )

    for config in every:
        old = config.identity[config.named_by]
        if old in chosen:
            config.shown = chosen[old]
            config.set_words(config.each_word)

    return chosen
