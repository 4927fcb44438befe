"""Rotary inertia: turning its sections along the contact edges takes a moment that softens the belt with speed."""

from __future__ import annotations

from dataclasses import replace

from gateway.closure.effects.base import NOWHERE, Conditions, Parameter
from gateway.closure.ring_options import RingOptions
from gateway.types import FloatArray


class RotaryInertia:
    """Bending stiffness EI - rho I V^2."""

    name = "rotary inertia"
    summary = "The inertia of the belt's sections takes off its bending stiffness, with the square of speed."
    equation = "EI less rho I (R omega)^2"
    # rho A h^2 / 12 of a ring of 2 to 8 kg/m, 10 to 30 mm thick: 2e-5 to 6e-4 kg m.
    parameters = (
        Parameter(
            "inertia_kgm", "kg m", low=0.0, high=1e-3, prior_std=5e-4, step=1e-5, factor=1e6, display_unit="mg m"
        ),
    )
    seen_by = "radial axis, as bending that falls with speed: two speeds, the faster the better"
    confused_with = (
        "bending (Bs) and the tread: at one speed they take up all of it; anti-alias filter and tread damping between "
        "speeds"
    )
    already_in = NOWHERE
    needs_exact = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return a ring of 3.5 kg/m, 20 mm thick."""
        return ((1.2e-4,),)

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the inertia."""
        return replace(options, rotary_inertia_kgm=options.rotary_inertia_kgm + float(parameters[0]))


EFFECT = RotaryInertia()
