"""The filter in front of the converter delays and rounds what the sensor feels."""

from __future__ import annotations

import math

import numpy as np

from gateway.closure.effects.base import (
    CIRCUMFERENTIAL,
    LATERAL,
    NOWHERE,
    RADIAL,
    Conditions,
    Here,
    Parameter,
    Stage,
    StartModel,
)
from gateway.closure.effects.order_filter import ORDER, filtered
from gateway.types import ComplexArray, FloatArray

_ROOT_2 = math.sqrt(2.0)


class AntiAliasFilter:
    """A two-pole Butterworth low-pass on all three axes; its parameter is 1 / corner, 0 for no filter.

    Its delay at low orders is the contact's as well: the contact's centre is found behind the filter. So what the
    filter changes is taken from a signal that is as late, and a corner does not move the centre.
    """

    name = "anti-alias filter"
    summary = "A low-pass in front of the converter, not declared: all axes are late and lose their highest orders."
    equation = (
        "order n times exp(i sqrt(2) x) / (1 + i sqrt(2) x - x^2), x = n omega / (2 pi corner); the "
        "centre is as late as the filter's delay"
    )
    # Bandwidths of inner-liner elements: 400 Hz to 24 kHz; below 150 Hz no contact would be seen.
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "inverse_corner_s",
            "s",
            -1e-5,
            1.0 / 150.0,
            1e-3,
            1e-6,
            factor=1e3,
            display_unit="ms",
            inverse_display=(1.0, "Hz"),
        ),
    )
    seen_by = "contact edges, all axes, best at high speed; two speeds tell Hz from orders"
    confused_with = (
        "bending stiffness, shear flexibility and tread damping at one speed: these go with the angle, the filter with "
        "frequency; its delay alone looks like another contact centre"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.ELECTRIC
    axes: tuple[int, ...] = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    linear = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return corners of 1400 and 700 Hz: it goes with the cube, a step from far below would lead beyond."""
        return (7e-4,), (1.5e-3,)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return what the filter changes."""
        return filtered(here.signal_mps2, _passed(self._order_hz(here) * float(parameters[0])) - 1.0)

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return its derivative by the inverse corner."""
        per = self._order_hz(here)
        x = per * float(parameters[0])
        # d/dx of ln: i sqrt(2) - (i sqrt(2) - 2 x) / (1 + i sqrt(2) x - x^2)
        slope = 1j * _ROOT_2 - (1j * _ROOT_2 - 2.0 * x) / (1.0 + x * (1j * _ROOT_2 - x))
        return filtered(here.signal_mps2, per * _passed(x) * slope)[None]

    @staticmethod
    def _order_hz(here: Here) -> ComplexArray:
        return ORDER * (here.conditions.omega_radps / (2.0 * math.pi))


def _passed(x: ComplexArray) -> ComplexArray:
    """Return the filter's gain without its delay, at frequencies over its corner."""
    result: ComplexArray = np.exp(1j * _ROOT_2 * x) / (1.0 + x * (1j * _ROOT_2 - x))
    return result


EFFECT = AntiAliasFilter()
