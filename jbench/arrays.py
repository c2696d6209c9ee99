"""The functions of the array API for arrays of numpy and of torch."""

from typing import Any

from array_api_compat import array_namespace

Array = Any
"""An array of numpy or of torch."""

_known: dict[type, Any] = {}


def namespace(array: Any) -> Any:
    """Returns the functions of the array API for the library of an array.

    Like `array_api_compat.array_namespace`, which examines an array for as long as a small
    operation takes; here each type of array is examined once. Raises a TypeError for what is no
    array.
    """
    found = _known.get(type(array))
    if found is None:
        found = _known[type(array)] = array_namespace(array)
    return found
