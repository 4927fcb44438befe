"""Structural damping: the sidewall resists the speed at which the turning belt deforms it."""

from __future__ import annotations

from dataclasses import replace

from gateway.closure.effects.base import NOWHERE, Conditions, Parameter
from gateway.closure.ring_options import RingOptions
from gateway.types import FloatArray


class StructuralDamping:
    """Viscous sidewall of one damping time, radial and tangential alike (c_n of Eq. 11)."""

    name = "structural damping"
    summary = "Losses in the sidewall: the deflection lags behind the road, the contact leans forward."
    equation = "adds c omega du/dtheta to the sidewall's force, c = damping time * kw; loss angle omega * damping time"
    # 3.3e-4 s is a rolling resistance of 0.7 % at 65 km/h; 2e-3 s would be 4 %, more than any tire has. Losses are
    # never negative.
    parameters = (
        Parameter("damping_time_s", "s", low=0.0, high=2e-3, prior_std=1e-3, step=2e-5, factor=1e3, display_unit="ms"),
    )
    seen_by = "radial axis, sine part of orders 2 to 8, growing as Omega^3; two speeds tell it from what is geometry"
    confused_with = (
        "contact asymmetry: its derivative is 0.98 alike at one speed, 0.96 at 40 to 100 km/h, but does not grow with "
        "speed; tread damping, in higher orders; contact centre"
    )
    already_in = NOWHERE
    needs_exact = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return a rolling resistance of about 0.7 %."""
        return ((3e-4,),)

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the damping time."""
        return replace(options, damping_time_s=options.damping_time_s + float(parameters[0]))


EFFECT = StructuralDamping()
