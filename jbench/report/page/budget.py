"""Limits the size of a page, so that it can be sent and opened."""

from collections.abc import Sequence


def share_each(sizes: Sequence[int], total: int) -> int:
    """Returns the maximum size of each item so that all together take at most `total`.

    Small items take what they need, and the large ones share the rest equally.
    """
    left = total
    ordered = sorted(sizes)
    for i, size in enumerate(ordered):
        share = left // (len(ordered) - i)
        if size > share:
            return max(1, share)
        left -= size
    return max([1, *sizes])
