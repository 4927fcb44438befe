"""Pace at which estimators renew what rests on an average, decided by counts of revolutions and by conditions alone.

An average over many revolutions changes little in one. Between renewals an estimate follows the average by its own
linear response, so only terms of second order lag (docs/explanation/estimators.md has the bound). Counts and conditions
do not depend on how samples arrive: live, replay and batch renew at the same revolutions.
"""

from __future__ import annotations

import math
from typing import Final

# Revolutions up to which everything is renewed in each, and the longest pause between renewals afterwards.
_EVERY_UP_TO: Final = 16
LONGEST: Final = 32


def is_due(count: int) -> bool:
    """Return whether to renew after `count` revolutions: whenever they have grown by about a tenth, at most by 32."""
    if count <= _EVERY_UP_TO:
        return True
    step = min(1 << ((count - 1).bit_length() - 4), LONGEST)
    return count % step == 0


def differs(value: float, renewed: float, allowed: float) -> bool:
    """Return whether a condition differs from that of the last renewal by more than allowed; True where either is NaN.

    Two values that are both not known do not differ.
    """
    if math.isnan(value) and math.isnan(renewed):
        return False
    return not abs(value - renewed) <= allowed
