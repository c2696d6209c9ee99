"""Wording that messages, tables and figures share."""


def counted(count: int, noun: str, plural: str = "") -> str:
    """Formats a number of things: `1 seed`, `1,200 seeds`; the plural ends in s by default."""
    return f"{count:,} {noun if count == 1 else plural or f'{noun}s'}"


def are(count: int) -> str:
    """Returns the verb for a number of things."""
    return "is" if count == 1 else "are"
