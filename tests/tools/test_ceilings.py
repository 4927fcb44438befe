"""What the project promises, and how large it is, may only become smaller."""

import ast

from tools import ceilings


def test_counts_are_within_their_limits() -> None:
    counted = ceilings.counts()
    assert counted.keys() == ceilings.CEILINGS.keys()
    assert {name: count for name, count in counted.items() if count > ceilings.CEILINGS[name].limit} == {}


def test_complexity_counts_paths() -> None:
    (function,) = ast.parse(
        "def f(a, b):\n    if a and b:\n        return 1\n    for x in a:\n        pass\n    return [y for y in b]"
    ).body
    assert ceilings._complexity(function) == 5
