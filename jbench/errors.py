"""Exceptions, each with its exit code."""


class RequestError(ValueError):
    """A wrong request: one sentence that says what is wrong and what to type instead."""

    exit_code = 2


class WorkError(RuntimeError):
    """Work that failed although the request was right: one sentence that says what failed."""

    exit_code = 1
