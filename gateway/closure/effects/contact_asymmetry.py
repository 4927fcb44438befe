"""Contact asymmetry: friction along the belt carries an axle torque and leans the contact to one edge."""

from __future__ import annotations

from dataclasses import replace

from gateway.closure.effects.base import NOWHERE, Conditions, Parameter
from gateway.closure.ring_options import RingOptions
from gateway.types import FloatArray


class ContactAsymmetry:
    """Driving (positive) or braking torque at the axle, beyond that of the losses, over load and belt radius."""

    name = "contact asymmetry"
    summary = "A driving or braking torque winds the belt up against the rim; leading and trailing edge differ."
    equation = (
        "axle torque = that of the losses + traction * Q R, carried by friction in proportion to q along the contact"
    )
    # Drive torque at steady speed is 1 to 5 % of the load; hard braking up to 50 %, beyond which tires slip.
    parameters = (
        Parameter("traction", "", low=-0.5, high=0.5, prior_std=0.2, step=2e-3, factor=100.0, display_unit="%"),
    )
    seen_by = "radial axis, sine part of all orders, as Omega^2 at every speed alike"
    confused_with = (
        "structural damping: its derivative is 0.98 alike at one speed, but grows with speed; braking against driving "
        "decides; contact centre"
    )
    already_in = NOWHERE
    needs_exact = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return driving and braking at 5 % of the load."""
        return ((0.05,), (-0.05,))

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the traction."""
        return replace(options, traction=options.traction + float(parameters[0]))


EFFECT = ContactAsymmetry()
