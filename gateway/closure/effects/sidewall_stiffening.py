"""Sidewall stiffening: the sidewall's stiffness grows, or falls, with its deflection."""

from __future__ import annotations

from dataclasses import replace

from gateway.closure.effects.base import NOWHERE, Conditions, Parameter
from gateway.closure.ring_options import RingOptions
from gateway.types import FloatArray


class SidewallStiffening:
    """Relative growth of kw and kv per metre of deflection."""

    name = "sidewall stiffening"
    summary = "The sidewall is not linear: where the belt is pushed in far, it pushes back harder."
    equation = "kw and kv times (1 + growth |u|), u the deflection of each"
    # 10 % either way over a deflection of 20 mm is 5 per metre; twice that bounds what is a sidewall.
    parameters = (Parameter("growth_pm", "1/m", low=-10.0, high=15.0, prior_std=6.0, step=0.1),)
    seen_by = "radial axis, orders 2 to 12, as Omega^2; several loads with their own deflections"
    confused_with = (
        "the four numbers and the tread's stiffness, which take up 97 % of it; drum curvature, -0.7 alike; shear "
        "flexibility, 0.6 alike"
    )
    already_in = NOWHERE
    needs_exact = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return 10 % at 20 mm, either way."""
        return ((5.0,), (-5.0,))

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the growth."""
        return replace(options, stiffening_pm=options.stiffening_pm + float(parameters[0]))


EFFECT = SidewallStiffening()
