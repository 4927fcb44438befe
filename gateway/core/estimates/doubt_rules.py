"""Rules by which doubt about what is stated reaches estimates.

All of them apply. What one of them brings shows where it is left out: `tools/bench_validity.py --left-out`.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Final


class DoubtRule(StrEnum):
    """One rule, by what it looks at."""

    STEADY_VALUE = "steady value"  # over R Omega^2, by which radius, gain or rate are contradicted or doubted
    SHORT_OF_IT = "steady value, short of a contradiction"
    GRAVITY = "gravity"
    COUPLING = "coupling"  # steady value lost in spite of a stated DC coupling
    AXES = "relations of the axes"
    SENSOR_OFFSET = "sensor offset"  # below the neutral layer, by the circumferential axis
    ROLL = "roll by two ways"
    TILT = "yaw of a tilted sensor"
    HUB_MOTION = "motion of the hub"
    SENSOR_LIMITS = "band, corner, steps"
    WIDTH = "width of the new tire"  # against load, pressure and radius
    TWO_LOADS = "loads by two ways"
    POSSIBLE = "what is possible"
    OWN_DRIFT = "own drift"
    TURNS = "several turns in one"


EVERY_RULE: Final = frozenset(DoubtRule)
