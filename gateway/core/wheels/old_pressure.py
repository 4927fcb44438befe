"""Age of a measured pressure, and how far it may have changed since its reading."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from statistics import median
from typing import Final

from firmware_protocol.messages import Environment

ENVIRONMENT_INTERVALS: Final = 5.0
"""Readings of pressure and temperature are old after this many of their own intervals,"""

ENVIRONMENT_LEAST_S: Final = 5.0
"""and after this time: pressure and temperature change within minutes, so that some lost readings do not matter."""

Reading = tuple[int, Environment, float]
"""Hub time in us, reading, and the error that sensor health gives its pressure, Pa."""


def old_pressure_s(readings: Sequence[Reading], at_us: float) -> float | None:
    """Return the age at hub time `at_us` of a measured pressure that is old; None while it is current.

    Args:
        readings: the latest, in the order of their times.
        at_us: hub time.
    """
    for tick_us, reading, _ in reversed(readings):
        if tick_us <= at_us and reading.pressure_pa is not None:
            if (at_us - tick_us) * 1e-6 <= ENVIRONMENT_LEAST_S:
                return None
            break
    ticks_us = [tick_us for tick_us, reading, _ in readings if tick_us <= at_us and reading.pressure_pa is not None]
    if not ticks_us:
        return None
    interval_s = median(after - before for before, after in pairwise(ticks_us)) * 1e-6 if len(ticks_us) > 1 else 0.0
    age_s = (at_us - ticks_us[-1]) * 1e-6
    return age_s if age_s > max(ENVIRONMENT_LEAST_S, ENVIRONMENT_INTERVALS * interval_s) else None


def change_since_reading_pa(latest_first: Iterable[Reading]) -> float:
    """Return one standard error of a pressure by its change since the latest reading.

    Until the next reading it is taken to change as it did since the one before, as in a puncture: by anything between
    nothing and all of that, uniformly. The first reading says nothing of a change.

    Args:
        latest_first: readings, the latest one first.
    """
    pressures = (reading.pressure_pa for _, reading, _ in latest_first if reading.pressure_pa is not None)
    latest_pa = next(pressures, None)
    previous_pa = next(pressures, None)
    return abs(latest_pa - previous_pa) / math.sqrt(3.0) if latest_pa is not None and previous_pa is not None else 0.0
