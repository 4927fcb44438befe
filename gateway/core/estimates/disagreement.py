"""Error that a stated value has because another statement disagrees with it by less than a contradiction."""

import math
from typing import Final

CONTRADICTION: Final = 3.0
"""Standard errors, of both together, from which two values contradict each other."""


def disagreement_std(difference: float, std: float) -> float:
    """Return the root mean square error of a statement that a measurement disagrees with.

    Two values that are `CONTRADICTION` standard errors apart count as a wrong statement, so there a wrong one is at
    least as likely as a chance. Below, the odds fall as the likelihood of the chance rises: exp((x^2 - 9) / 2) at x
    standard errors. A wrong statement is wrong by what the errors do not explain of the difference, x^2 - 1. So there
    is no error up to one standard error, a quarter of the difference at two, and two thirds of it at three.

    Args:
        difference: of the two values.
        std: one standard error of the difference, positive.

    Returns:
        The error, in the unit of the difference; at most 0.7 of it.
    """
    unexplained = difference * difference - std * std
    if not (std > 0.0 and unexplained > 0.0):
        return 0.0
    squared = min((difference / std) ** 2, CONTRADICTION**2)
    odds = math.exp(0.5 * (squared - CONTRADICTION**2))
    return math.sqrt(unexplained * odds / (1.0 + odds))


def error_of(value: float, std: float, expected_std: float) -> float:
    """Return the root mean square of a quantity that should be zero within an expected error, and was measured.

    Args:
        value: as measured.
        std: its standard error, positive.
        expected_std: what is expected of it, likewise.
    """
    combined_std = math.hypot(std, expected_std)
    if abs(value) > CONTRADICTION * combined_std:
        return math.hypot(value, std)
    likely = value * (expected_std / combined_std) ** 2
    return math.hypot(max(abs(likely), disagreement_std(value, combined_std)), std * expected_std / combined_std)
