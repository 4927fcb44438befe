"""Library of the laws that a search tries: effects of the catalogue, for a base without them, and others."""

import copy
from collections.abc import Collection
from typing import Final

from gateway.core.constants import AXIS_NAMES
from gateway.diagnosis.effects.acquisition import CIRCUMFERENTIAL_DELAY, LATERAL_DELAY
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL, SignalEffect
from gateway.diagnosis.effects.local_effects import LOCAL_CHANGES, LOCAL_KINK, LOCAL_TREAD_STIFFNESS, WheelOrder
from gateway.diagnosis.effects.mounting import SENSOR_LENGTH
from gateway.diagnosis.effects.sensor_response import CIRCUMFERENTIAL_HYSTERESIS, LATERAL_HYSTERESIS, RADIAL_HYSTERESIS
from gateway.diagnosis.laws.sensor_errors import AxisCube, AxisSquare, CrossAxis, GainBelowZero
from gateway.ring.rolling_ring import Change

_AXLE_ORDERS: Final = (2, 3, 4)
# The axis that reads, and the one that it reads.
_LEAKS: Final = ((LATERAL, CIRCUMFERENTIAL), (RADIAL, CIRCUMFERENTIAL), (CIRCUMFERENTIAL, RADIAL))


def library(without: Collection[str] = ()) -> dict[str, SignalEffect]:
    """Return laws by name.

    Args:
        without: effects of the catalogue that are in the model already.
    """
    every = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    delays, hystereses = (
        (
            CIRCUMFERENTIAL_DELAY,
            LATERAL_DELAY,
        ),
        (CIRCUMFERENTIAL_HYSTERESIS, LATERAL_HYSTERESIS, RADIAL_HYSTERESIS),
    )
    titled: list[tuple[SignalEffect, str]] = [
        *((change, change.name) for change in (*LOCAL_CHANGES, LOCAL_KINK, LOCAL_TREAD_STIFFNESS)),
        *((WheelOrder("", 0, order, Change.RIM, ()), f"axle height of order {order}") for order in _AXLE_ORDERS),
        *((delay, f"delay of the {AXIS_NAMES[delay.axis]} axis") for delay in delays),
        *((hysteresis, f"hysteresis of the {AXIS_NAMES[hysteresis.axis]} axis") for hysteresis in hystereses),
        *((error, error.name) for error in map(GainBelowZero, every)),
        *((error, error.name) for power in (AxisSquare, AxisCube) for error in map(power, (CIRCUMFERENTIAL, LATERAL))),
        *((error, error.name) for error in (CrossAxis(sink, source) for sink, source in _LEAKS)),
        (SENSOR_LENGTH, "mean over a length"),
    ]
    laws = {}
    for effect, title in titled:
        if effect.name not in without:
            law = copy.copy(effect)
            law.name, law.title, law.rank = f"law: {title}", title, 0
            laws[law.name] = law
    return laws
