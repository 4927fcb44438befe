"""Torsional ripple: a driveline, a brake or a road that makes the wheel's speed waver within the revolution."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

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
    bare,
)
from gateway.closure.effects.belt import slopes, spin_projections
from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.types import FloatArray

# Cardan joints (2), tripods (3), tire non-uniformity and brake judder (1 to 3), wheel bolts (5), motor cogging and
# gears (6, 12, 24, ..).
_STARTS: Final = (*range(1, 25), 30, 36, 40, 48)
_START_SHARE: Final = 2e-3
# Ripple of a rolling wheel is some 0.1 %, brake judder reaches 1 %; more would be felt as shaking, not measured.
_LARGEST: Final = 0.03
# How far from a whole number an order may come out, and errors beyond that.
_WHOLE: Final = 0.05
_BEYOND: Final = 3.0


class _Waver(NamedTuple):
    """Of cosine and sine of one order, (2, FIELD_SIZE) each: change of speed, warp of the angle, change of change."""

    speed: FloatArray
    warp: FloatArray
    rate: FloatArray

    def mixed(self, other: _Waver, share: float) -> _Waver:
        """Return (1 - share) of this and `share` of another."""
        return _Waver(*((1.0 - share) * one + share * two for one, two in zip(self, other, strict=True)))


class TorsionalRipple:
    """Angular speed omega (1 + C cos(k phi) + S sin(k phi)), phi the angle that time tells at a steady speed.

    The pipeline's angle is phi: it runs evenly between two contact centres. The sensor's true angle is ahead by
    (C sin(k phi) + S (1 - cos(k phi))) / k, which is 0 at both. The tire rolls without slip, so the axle surges along.
    """

    name = "torsional ripple"
    summary = "The wheel's angular speed wavers a whole number of times a revolution, in step with the wheel."
    equation = (
        "(1 + u)^2 s(theta + w) - s + du/dt omega spin, u = C cos(k theta) + S sin(k theta), "
        "w = (C sin(k theta) + S (1 - cos(k theta))) / k"
    )
    parameters = (
        Parameter("cosine", "", -_LARGEST, _LARGEST, 0.02, 1e-6, factor=100.0, display_unit="%"),
        Parameter("sine", "", -_LARGEST, _LARGEST, 0.02, 1e-6, factor=100.0, display_unit="%"),
        # Only whole orders repeat in every revolution; between two, each has its share.
        Parameter("order", "per revolution", 0.9, 60.0, 40.0, 1e-4, prior_mean=4.0),
    )
    seen_by = "All three axes, all around: 2 u s, edges of the contact warped by w, circumferential reaction; omega^2."
    confused_with = (
        "Orders 1 and 2, on the radial axis alone: imbalance (0.9 alike), AC coupling and belt extension (0.8); with "
        "the circumferential axis AC coupling and contact asymmetry (0.6), run-out (0.7, order 1). From order 4 on "
        "nothing. Neighbouring orders are half alike. An axle that keeps its speed (a slipping tread) lacks the surge."
    )
    already_in = NOWHERE
    stage = Stage.BELT
    axes = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    linear = False

    def reason_against(self, parameters: FloatArray, std: FloatArray) -> str:
        """Refuse an order that is not whole: it would not repeat every revolution."""
        order = float(parameters[2])
        if abs(order - round(order)) <= _WHOLE + _BEYOND * float(std[2]):
            return ""
        return f"its order would be {order:.2f} per revolution, and only whole orders repeat"

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return the orders that machines have."""
        return tuple((_START_SHARE, _START_SHARE, float(order)) for order in _STARTS)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return what the wheel with ripple reads, less what it reads without; a Taylor series in the warp."""
        if not parameters[:2].any():
            return bare(here)
        speed, warp, rate = (parameters[:2] @ part for part in _waver(here, float(parameters[2])))
        turned, steady, spin = _parts(here)
        result: FloatArray = np.square(1.0 + speed) * _moved(turned, warp) - turned[0]
        result += _moved(steady, warp) - steady[0]
        result += (here.conditions.omega_radps**2 * rate) * _moved(spin, warp)
        return result

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by both shares and by the order, towards the next higher order at a whole one."""
        order = float(parameters[2])
        waver, higher = _waver(here, order), _difference(here, order)
        speed, warp, rate = (parameters[:2] @ part for part in waver)
        along = [
            np.concatenate([part, (parameters[:2] @ more)[np.newaxis]])
            for part, more in zip(waver, higher, strict=True)
        ]
        turned, steady, spin = _parts(here)
        square = here.conditions.omega_radps**2
        by_speed = 2.0 * (1.0 + speed) * _moved(turned, warp)
        by_warp = np.square(1.0 + speed) * _moved(turned[1:], warp) + _moved(steady[1:], warp)
        by_warp += square * rate * _moved(spin[1:], warp)
        by_rate = square * _moved(spin, warp)
        rows: FloatArray = along[0][:, np.newaxis] * by_speed
        rows += along[1][:, np.newaxis] * by_warp
        rows += along[2][:, np.newaxis] * by_rate
        return rows


def _whole(here: Here, order: int) -> _Waver:
    place = order * here.theta_rad
    cosine, sine = np.cos(place), np.sin(place)
    return _Waver(
        np.stack([cosine, sine]),
        np.stack([sine, 1.0 - cosine]) / order,
        np.stack([-order * sine, order * cosine]),
    )


def _waver(here: Here, order: float) -> _Waver:
    low = _below(order)
    share = order - low
    return _whole(here, low).mixed(_whole(here, low + 1), share) if share else _whole(here, low)


def _difference(here: Here, order: float) -> _Waver:
    low = _below(order)
    return _Waver(*(two - one for one, two in zip(_whole(here, low), _whole(here, low + 1), strict=True)))


def _below(order: float) -> int:
    """Return the whole order at or below; what lies below 1 is taken from orders 1 and 2 on."""
    return max(1, math.floor(order))


def _parts(here: Here) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what goes with omega^2, what does not and the reaction to spin, each (4, 3, FIELD_SIZE) with slopes."""
    steady, spin = bare(here), bare(here)
    steady[RADIAL] = STANDARD_GRAVITY_MPS2 * here.shape.gravity_radial
    steady[CIRCUMFERENTIAL] = STANDARD_GRAVITY_MPS2 * here.shape.gravity_circumferential
    spin[CIRCUMFERENTIAL], spin[RADIAL] = spin_projections(here)
    curves = np.stack([here.signal_mps2 - steady, steady, spin])
    with_slopes = np.concatenate([curves[np.newaxis], slopes(curves, 3)])
    return with_slopes[:, 0], with_slopes[:, 1], with_slopes[:, 2]


def _moved(curve: FloatArray, warp: FloatArray) -> FloatArray:
    """Return a curve with its slopes, (k, 3, FIELD_SIZE), at theta + warp."""
    result: FloatArray = curve[-1]
    for at in range(len(curve) - 2, -1, -1):
        result = curve[at] + (warp / (at + 1)) * result
    return result


EFFECT = TorsionalRipple()
