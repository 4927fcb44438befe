"""Names of wheel positions that differ in left and right only."""

from functools import lru_cache
from typing import Final

_LETTERS: Final = {"L": "R", "l": "r", "LEFT": "RIGHT", "Left": "Right", "left": "right"}


@lru_cache(maxsize=1024)
def right_of(position: str) -> str | None:
    """Return the name of the wheel on the right of a left wheel: FL -> FR, rear.left -> rear.right; else None."""
    for left_letter, right_letter in _LETTERS.items():
        if (len(left_letter) > 1 and left_letter in position) or (
            len(left_letter) == 1 and position.endswith(left_letter)
        ):
            head, _, tail = position.rpartition(left_letter)
            return f"{head}{right_letter}{tail}"
    return None
