"""Tread damping: the tread pushes harder while it is being compressed, so that the pressure shifts to the entry."""

from __future__ import annotations

from dataclasses import replace

from gateway.closure.effects.base import NOWHERE, Conditions, Parameter
from gateway.closure.ring_options import RingOptions
from gateway.types import FloatArray


class TreadDamping:
    """Viscous tread of one damping time."""

    name = "tread damping (shifted pressure)"
    summary = "Losses in the tread: the contact pressure and the contact itself shift towards the leading edge."
    equation = "q = kt (penetration + damping time * omega d(penetration)/dtheta) where positive"
    # 7e-4 s is a rolling resistance of 0.66 % at 65 km/h; 3e-3 s is about 3 %, more than any tire has.
    parameters = (
        Parameter(
            "damping_time_s", "s", low=0.0, high=3e-3, prior_std=1.5e-3, step=5e-6, factor=1e3, display_unit="ms"
        ),
    )
    seen_by = "radial axis, sine part of orders above 8, at both contact edges; grows faster than Omega^2"
    confused_with = "structural damping and contact asymmetry, -0.3 alike, in lower orders; contact centre"
    already_in = NOWHERE
    needs_exact = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return a rolling resistance of about 0.5 %."""
        return ((5e-4,),)

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the damping time."""
        return replace(options, tread_damping_time_s=options.tread_damping_time_s + float(parameters[0]))


EFFECT = TreadDamping()
