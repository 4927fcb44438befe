"""Contribution of a set of effects to the sensor's axes as a table over speed, for subtraction before estimating."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.revolutions.effect_correction import CorrectedEffect, CorrectionTable, EffectParameter
from gateway.core.types import ComplexArray
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.data.campaign_data import Block, Campaign, Group
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL
from gateway.diagnosis.model.baseline import NoShapeError
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel
from gateway.diagnosis.result import Finding, Fitted, Verdict

_SPEEDS: Final = 9
# Effects found at some speeds, loads and pressures are valid slightly beyond them.
_SPEED_MARGIN: Final = 0.1
_LOAD_MARGIN: Final = 0.05
_PRESSURE_MARGIN: Final = 0.05
# The quantities that the lateral estimators measure stay in the signal.
MEASURED: Final = frozenset({"ply steer", "conicity", "carcass compliance"})


def contribution_table(fit: Fit, findings: tuple[Finding, ...]) -> CorrectionTable | None:
    """Return the table of the identified effects, for the state with the most revolutions.

    What other estimators measure (ply steer, conicity, carcass compliance) is left out. The table holds for that
    state's load and pressure: with another contact the same effects add something else; and for the way that a wheel
    rolls on the car, forward, unless all was recorded in reverse.

    Args:
        fit: of the identified effects.
        findings: the effects, with their parameters.
    """
    named = {finding.name: finding.parameters for finding in findings if finding.verdict is Verdict.NAMED}
    effects = tuple(effect for effect in fit.model.effects if effect.name in named.keys() - MEASURED)
    if not effects:
        return None
    campaign = fit.model.campaign
    index = _reference(campaign)
    group = campaign.groups[index]
    reverse = group.conditions.reverse
    of_state = [entry for entry in campaign.groups if (entry.state, entry.conditions.reverse) == (group.state, reverse)]
    speeds_radps = np.array([entry.conditions.omega_radps for entry in of_state])
    low, high = float(speeds_radps.min()) * (1.0 - _SPEED_MARGIN), float(speeds_radps.max()) * (1.0 + _SPEED_MARGIN)
    omegas = np.linspace(low, high, _SPEEDS)
    imagined = tuple(_at_speed(group, float(omega)) for omega in omegas)
    imagined_campaign = Campaign(campaign.wheel, campaign.recordings, imagined, 1, {})
    model = ClosureModel(imagined_campaign, fit.model.core, fit.model.effects)
    vector = np.zeros(model.layout.size)
    vector[model.layout.state(0)] = fit.model.tire(fit.vector, index)
    for number in range(len(imagined)):
        vector[model.layout.centre(number)] = fit.vector[fit.model.layout.centre(index)]
    sensor = fit.vector[fit.model.layout.sensor]
    vector[model.layout.sensor] = sensor
    for effect in fit.model.effects:
        vector[model.layout.effect(effect.name)] = fit.vector[fit.model.layout.effect(effect.name)]
    vector_without = vector.copy()
    for effect in effects:
        vector_without[model.layout.effect(effect.name)] = 0.0
    try:
        change = [a[0] - b[0] for a, b in zip(model.predict(vector), model.predict(vector_without), strict=True)]
    except NoShapeError:
        # Without its effects the ring has no solution at these parameters, so there is nothing to subtract from.
        return None
    orders = np.stack(change)
    if reverse:
        # Only a diagnosis turns the circumferential axis of reverse recordings to the rolling direction.
        orders[:, CIRCUMFERENTIAL] *= -1.0
    load, pressure = group.conditions.load_n, group.conditions.pressure_pa
    return CorrectionTable(
        position=campaign.wheel,
        omega_radps=omegas,
        orders_mps2=orders,
        effects=tuple(CorrectedEffect(effect.name, _effect_parameters(named[effect.name])) for effect in effects),
        radius_m=group.conditions.radius_m,
        omega_range_radps=(low, high),
        load_range_n=_around(load, _LOAD_MARGIN) if group.load_known else None,
        pressure_range_pa=_around(pressure, _PRESSURE_MARGIN) if group.pressure_known else None,
        sensor_offset_m=group.declared_offset_m + float(sensor.sum()),
        sensor_id=campaign.sensor_id,
        sources=campaign.recordings,
        vehicle=campaign.vehicle,
        tire=campaign.tire,
    )


def added_by(fit: Fit, effect: AngleEffect) -> list[ComplexArray]:
    """Return the contribution of an effect to the orders of every group, (3, ORDERS) each.

    It is not computed from derivatives: an order or a decay of 0 is not the absence of the effect.
    """
    vector_without = fit.vector.copy()
    vector_without[fit.model.layout.effect(effect.name)] = 0.0
    added = []
    for index, predicted in enumerate(fit.predicted):
        try:
            added.append(fit.model.predict_mean(fit.vector, index) - fit.model.predict_mean(vector_without, index))
        except (NoShapeError, np.linalg.LinAlgError):
            # Without the effect the ring has no solution at these parameters.
            added.append(predicted * math.nan)
    return added


def _reference(campaign: Campaign) -> int:
    """Return the largest group of the state with the most revolutions, preferably one rolling forward."""
    forward = any(not group.conditions.reverse for group in campaign.groups)
    counts = [0 if forward and group.conditions.reverse else group.revolutions for group in campaign.groups]
    of_state = [0] * campaign.states
    for group, count in zip(campaign.groups, counts, strict=True):
        of_state[group.state] += count
    main_state = int(np.argmax(of_state))
    return max((i for i, g in enumerate(campaign.groups) if g.state == main_state), key=lambda i: counts[i])


def _at_speed(group: Group, omega_radps: float) -> Group:
    """Return the group as it would be at a steady speed."""
    conditions = replace(
        group.conditions,
        omega_radps=omega_radps,
        omega_dot_radps2=0.0,
        temperature_degc=group.conditions.reference_degc,
    )
    block = Block(1, conditions, group.blocks[0].orders_mps2)
    return replace(group, conditions=conditions, blocks=(block,), state=0)


def _around(value: float, margin: float) -> tuple[float, float]:
    return value * (1.0 - margin), value * (1.0 + margin)


def _effect_parameters(parameters: Mapping[str, Fitted]) -> tuple[EffectParameter, ...]:
    return tuple(EffectParameter(name, p.value, p.std, p.unit) for name, p in parameters.items())
