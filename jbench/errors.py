"""Exceptions, each with its exit code."""


class RequestError(ValueError):
    """A wrong request: one sentence that says what is wrong and what to type instead."""

    exit_code = 2


class NothingYetError(RequestError):
    """There is nothing to report yet; more results may change that."""


class WorkError(RuntimeError):
    """Work that failed although the request was right: one sentence that says what failed."""

    exit_code = 1

    @property
    def reason(self) -> str:
        """What failed, as a clause without what to do."""
        return str(self).rstrip(".")


class ElsewhereError(WorkError):
    """Work that another process is doing, so that it is not done yet."""

    exit_code = 3


def sentence_of_failure(error: BaseException) -> str:
    """Returns the sentence of a `RequestError` or `WorkError`; of others, type and text."""
    ours = isinstance(error, RequestError | WorkError)
    return str(error) if ours else f"{type(error).__name__}: {error}"
