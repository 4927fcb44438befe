"""One tire at slightly different loads and pressures: shared constants and their values in each state.

A state's parameters are logarithms of the numbers over the load number Q / (p0 R^2), as these alone set the shape. Of a
tire whose load and pressure change by the factors e^q and e^p,

    EI and the tread's stiffness stay:      parameters change by -q
    the tension's width b stays:            p - q
    sidewall stiffness k0 (1 + s (e^p - 1)): ln(1 + s (e^p - 1)) - q

with s the share of it that pressure makes.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.effect import GroupConditions

# Between a fifth and four fifths of a sidewall's stiffness are the pressure's. Within a state pressures differ by a
# percent at most, so that this guess is off by 0.3 % of the stiffness at worst.
_PRESSURE_SHARE: Final = 0.5
_SIDEWALL: Final = ("Rs", "Ts")
_STIFFNESSES: Final = ("Bs", *_SIDEWALL, "tread_stiffness_npm2")
# Growth of the half angle with the load: 0.62 to 0.81 on the exact ring at 2500 to 8000 N.
_HALF_ANGLE_EXPONENT: Final = 0.7
# Loads or pressures that differ by less are equal.
_EQUALITY_TOLERANCE: Final = 1e-9


def references(campaign: Campaign) -> list[GroupConditions]:
    """Return the conditions at which each state's parameters hold: those of its first group."""
    first_conditions: dict[int, GroupConditions] = {}
    for group in campaign.groups:
        first_conditions.setdefault(group.state, group.conditions)
    return [first_conditions[state] for state in range(campaign.states)]


def shift(names: Sequence[str], there: GroupConditions, reference: GroupConditions) -> FloatArray:
    """Return the change of a state's parameters (K,) at other conditions of the same tire."""
    load, pressure = _log(there.load_n, reference.load_n), _log(there.pressure_pa, reference.pressure_pa)
    sidewall = math.log1p(_PRESSURE_SHARE * math.expm1(pressure))
    return np.array(
        [
            (sidewall if name in _SIDEWALL else 0.0) - load
            if name in _STIFFNESSES
            else (pressure - load if name == "Cw" else 0.0)
            for name in names
        ]
    )


def half_angles_rad(campaign: Campaign) -> list[float]:
    """Return the contact half angle of each group: one measured angle for each state, at the load of the group."""
    reference_of = references(campaign)
    factors = [
        math.exp(_HALF_ANGLE_EXPONENT * _log(group.conditions.load_n, reference_of[group.state].load_n))
        for group in campaign.groups
    ]
    mean = [0.0] * campaign.states
    for state in range(campaign.states):
        members = [
            (group, factor) for group, factor in zip(campaign.groups, factors, strict=True) if group.state == state
        ]
        counts = [group.revolutions for group, _ in members]
        angles = [group.half_angle_rad / factor for group, factor in members]
        mean[state] = float(np.average(angles, weights=counts)) if members else math.nan
    return [mean[group.state] * factor for group, factor in zip(campaign.groups, factors, strict=True)]


def slopes(names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of `shift` by the logarithms of load and pressure, (K,) each, at the reference."""
    by_load = np.array([-1.0 if name in (*_STIFFNESSES, "Cw") else 0.0 for name in names])
    by_pressure = np.array([_PRESSURE_SHARE if name in _SIDEWALL else float(name == "Cw") for name in names])
    return by_load, by_pressure


def _log(value: float, reference: float) -> float:
    change = math.log(value / reference)
    return change if abs(change) > _EQUALITY_TOLERANCE else 0.0
