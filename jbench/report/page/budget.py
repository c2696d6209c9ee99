"""How the room in a page is shared, so that it stays small enough to be sent and opened."""

from collections.abc import Sequence


def share_each(sizes: Sequence[int], total: int) -> int:
    """Returns how much each of these may take, so that all together take `total` or less.

    Small ones take what they need, and the large ones share what is left equally.
    """
    left = total
    ordered = sorted(sizes)
    for i, size in enumerate(ordered):
        share = left // (len(ordered) - i)
        if size > share:
            return max(1, share)
        left -= size
    return max([1, *sizes])
