"""Library of the laws that a search tries."""

from __future__ import annotations

from typing import Final

from gateway.closure.laws.law import Law
from gateway.closure.laws.local_law import SHAPES, AxleOrder, LocalLaw, Responses
from gateway.closure.laws.sensor_law import sensor_laws

_AXLE_ORDERS: Final = (2, 3, 4)


def library() -> dict[str, Law]:
    """Return new laws by name; those of one library share what they work out of the belt."""
    responses = Responses()
    laws: tuple[Law, ...] = (
        *(LocalLaw(shape, responses) for shape in SHAPES),
        *(AxleOrder(order, responses) for order in _AXLE_ORDERS),
        *sensor_laws(),
    )
    return {law.name: law for law in laws}
