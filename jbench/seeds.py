"""Seeds and sizes as users type them, on the command line and in the file of a sweep."""

import re

from jbench.errors import RequestError

_MAX_NUMBERS = 10_000  # in one range; more is a typing error


def parse_numbers(
    text: str, option: str = "--seeds", example: str = "seeds like 0-9, or 0,2,5-7"
) -> list[int]:
    """Returns the whole numbers of a text like 0-9 or 0,2,5-7, each once, in order.

    Raises a RequestError, which names option and example, if it is not such a text.
    """
    numbers: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"(\d{1,19})(?:-(\d{1,19}))?", part.strip())
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, -1)
        if not 0 <= last - first < _MAX_NUMBERS:
            raise RequestError(f"{option} {text}: type {example}.")
        numbers.update(range(first, last + 1))
    return sorted(numbers)
