"""Shear flexibility: the belt's sections need not stay square to it, which rounds the contact edges less."""

from __future__ import annotations

import math
from dataclasses import replace

from gateway.closure.effects.base import NOWHERE, Conditions, Parameter
from gateway.closure.ring_options import RingOptions
from gateway.types import FloatArray


class ShearFlexibility:
    """Square of the shear length, EI / GA: the belt's response is regular in it."""

    name = "shear flexibility"
    summary = "The belt shears between its cords (a Timoshenko belt): sharper contact edges than bending allows."
    equation = "section's turn from the tangent = shear force / GA; parameter EI / GA, the shear length squared"
    # A belt of 20 to 30 cm^2 of rubber of 3 to 5 MPa has GA of 6 to 15 kN, and with EI of 2 to 10 N m^2 lengths of 10
    # to 40 mm, which is all of the layer sqrt(EI / T) at a contact edge; cords make it less. Shear never stiffens.
    # Below 1 mm the belt's own grid, and the grid of whatever made the data, look the same.
    parameters = (
        Parameter(
            "length_squared_m2",
            "m^2",
            low=1e-6,
            high=1.6e-3,
            prior_std=4e-4,
            step=5e-6,
            factor=1e6,
            display_unit="mm^2",
        ),
    )
    seen_by = "radial axis, orders 20 and up at the contact edges; circumferential axis, which the section's turn tilts"
    confused_with = (
        "bending (Bs) and the tread's stiffness, which take up half of it; sidewall stiffening, 0.6 alike; the "
        "circumferential axis tells them apart"
    )
    already_in = NOWHERE
    needs_exact = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return shear lengths of 3 and of 10 mm."""
        return ((1e-5,), (1e-4,))

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the shear length.

        Raises:
            ValueError: a negative square.
        """
        square = options.shear_length_m**2 + float(parameters[0])
        if square < 0.0:
            raise ValueError(f"the square of the shear length must not be negative, not {square:g} m^2")
        return replace(options, shear_length_m=math.sqrt(square))


EFFECT = ShearFlexibility()
