"""The option --log of commands that train."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from jbench.commands.output import Output

if TYPE_CHECKING:
    from jbench.settings.run import RunSettings
    from jbench.store import Results


@contextmanager
def logged(
    log: str | None, results: "Results", runs: Sequence["RunSettings"], output: Output
) -> Iterator[None]:
    """Copies the rows of runs to an experiment tracker (`names.LOGGERS`), if one is named.

    Raises:
        RequestError: if the tracker's library is not installed.
    """
    if log is None:
        yield
        return
    from jbench.loggers.logger import make_logger
    from jbench.loggers.mirror import mirrored

    logger = make_logger(log, results.path)
    output.say(logger.where)
    with mirrored(results, {run.id for run in runs}, logger, output.warn):
        yield
