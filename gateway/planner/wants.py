"""The largest error that is wanted of a quantity."""

from typing import NamedTuple


class Want(NamedTuple):
    """The largest error of a quantity, in the unit of its name."""

    quantity: str
    error: float
