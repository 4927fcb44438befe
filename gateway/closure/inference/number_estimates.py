"""Dimensionless numbers of the tire from a fit, with errors that include the residual."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.closure.data.campaign_data import ORDERS
from gateway.closure.effects.effect import GroupConditions
from gateway.closure.effects.wheel_nonuniformity import ROLLING_RADIUS
from gateway.closure.inference.fit import Fit
from gateway.closure.inference.likelihood import Whitened
from gateway.closure.inference.residual import GroupResidual, group_residuals
from gateway.closure.result import Fitted, TireState
from gateway.types import FloatArray

NUMBERS: Final = ("Bs", "Cw", "Rs", "Ts")
# Orders over which the residual's power is smoothed, and its phase is one: it sits within 0.4 rad of the contact's
# centre.
_SMOOTHED: Final = 7
# A number known worse than this is not determined; nor is bending below this share of tension.
_WORST_SHARE: Final = 0.3
_LEAST_BENDING: Final = 1e-3
_HALF_ANGLE: Final = "contact_half_angle_rad"
_UNITS: Final = {"tread_stiffness_npm2": "N/m^2", _HALF_ANGLE: "rad"}


def full_covariance(fit: Fit, data: Whitened) -> FloatArray:
    """Return the covariance of the parameters by noise and by model error, (P, P).

    The model error of an order is taken over its neighbourhood. It is the larger of two: the error allowed for the
    effects' equations and for computation, and the residual of the fit beyond noise. The linear fit propagates it
    with a phase that is independent between states. The phase is common to _SMOOTHED orders, since the error lies in
    one part of the revolution, and to all blocks and recordings of a state, since they share one shape.
    """
    covariance = fit.covariance()
    total = covariance.copy()
    groups = fit.model.campaign.groups
    residuals = group_residuals(fit, data)
    for state in range(fit.model.campaign.states):
        response = np.zeros((len(covariance), 3, ORDERS), dtype=np.complex128)
        for index, (rows, residual) in enumerate(zip(fit.rows, residuals, strict=True)):
            if groups[index].state == state:
                size = np.sqrt(np.maximum(_doubt(rows.weight, data.variance[index]), _left(residual)))
                response[rows.places] += (rows.rows * (rows.weight * size)[:, None]).sum(axis=0)
        together = _neighbours(np.concatenate([response.real, response.imag], axis=1))
        shift = covariance @ together.reshape(len(covariance), -1)
        total += shift @ shift.T
    return total


def _doubt(weight: FloatArray, variance: FloatArray) -> FloatArray:
    """Return the mean square that equations and computing may leave of each order of one group, (3, ORDERS)."""
    used = weight > 0.0
    square: FloatArray = np.where(used, np.where(used, weight, 1.0) ** -2.0 - variance, 0.0)
    mean: FloatArray = np.maximum(square, 0.0).mean(axis=0)
    return mean


def _left(residual: GroupResidual) -> FloatArray:
    """Return the mean square beyond noise that the fit leaves around each order of one group, (3, ORDERS)."""
    excess = 0.5 * np.abs(residual.orders_mps2) ** 2 - residual.variance
    kernel = np.ones(_SMOOTHED) / _SMOOTHED
    smooth: FloatArray = np.stack([np.convolve(axis, kernel, mode="same") for axis in excess])
    return np.maximum(smooth, 0.0)


def _neighbours(response: FloatArray) -> FloatArray:
    """Return responses (P, k, ORDERS) whose squares add up to those of errors that are alike in orders near by."""
    padded = np.pad(response, ((0, 0), (0, 0), (_SMOOTHED, _SMOOTHED - 1)))
    summed = np.cumsum(padded, axis=2)
    result: FloatArray = (summed[..., _SMOOTHED:] - summed[..., :-_SMOOTHED]) / math.sqrt(_SMOOTHED)
    return result


def estimates_of(
    fit: Fit, data: Whitened, undecided: Sequence[Sequence[Fit]] = (), far_off: Collection[int] = ()
) -> tuple[dict[str, Fitted], dict[str, bool]]:
    """Return every estimate, and whether the data determine it.

    The state with the most revolutions goes by the plain names, `Bs`; others by `Bs (3500 N, 210 kPa)`.

    Args:
        fit: the model.
        data: whitened.
        undecided: for every effect that the data do not tell from its rivals the fits with each of these in its place;
            an error holds as well by how much they would change the estimate.
        far_off: states whose estimates are not determined, since the model is far from their data.
    """
    covariance = full_covariance(fit, data)
    found: dict[str, Fitted] = {}
    determined: dict[str, bool] = {}
    groups = fit.model.campaign.groups
    counts = [0] * fit.model.campaign.states
    for group in groups:
        counts[group.state] += sum(block.count for block in group.blocks)
    reference = int(np.argmax(counts))
    for state in sorted(range(len(counts)), key=lambda state: state != reference):
        index = next((i for i, group in enumerate(groups) if group.state == state), None)
        if index is None:
            continue
        conditions = groups[index].conditions
        tire_state = None if state == reference else TireState(conditions.load_n, conditions.pressure_pa)
        suffix = "" if tire_state is None else f" ({state_name(conditions)})"
        known = groups[index].load_known and groups[index].pressure_known
        values = _values(fit, fit.vector, index)
        errors = _errors(fit, covariance, index, values)
        for rivals in undecided:
            others = [_values(rival, rival.vector, index) for rival in rivals]
            for name, value in values.items():
                errors[name] = math.hypot(errors[name], max(abs(other[name] - value) for other in others))
        for name, value in values.items():
            found[name + suffix] = Fitted(value, errors[name], _UNITS.get(name, ""), quantity=name, state=tire_state)
            determined[name + suffix] = state not in far_off and _is_determined(name, values, errors, known)
    return found, determined


def state_name(conditions: GroupConditions) -> str:
    """Return the name of a state in the keys of estimates: its load and pressure."""
    return f"{conditions.load_n:.0f} N, {conditions.pressure_pa / 1e3:.0f} kPa"


def _is_determined(name: str, values: Mapping[str, float], errors: Mapping[str, float], known: bool) -> bool:
    enough = errors[name] < _WORST_SHARE * abs(values[name])
    if name == _HALF_ANGLE:
        return enough
    number, _, ratio = name.partition("/")
    if ratio and not known:
        return enough
    if ratio:
        return _is_determined(number, values, errors, known)
    if name == "Bs":
        enough = enough and values[name] > _LEAST_BENDING * values["Cw"]
    return enough and known


def _values(fit: Fit, vector: FloatArray, index: int) -> dict[str, float]:
    """Return the estimates of one group's state at these parameters."""
    group, layout = fit.model.campaign.groups[index], fit.model.layout
    numbers = fit.model.core.numbers(vector[layout.state(group.state)], _in_earnest(fit, vector, group.conditions))
    values = dict(numbers)
    values.update({f"{name}/Cw": numbers[name] / numbers["Cw"] for name in ("Bs", "Rs", "Ts")})
    shape = fit.model.shape(vector, index)
    values[_HALF_ANGLE] = 0.5 * (shape.trailing_edge_rad - shape.leading_edge_rad)
    return values


def _in_earnest(fit: Fit, vector: FloatArray, conditions: GroupConditions) -> GroupConditions:
    """Return the conditions with the radius that the belt has if the one stated is wrong.

    The waveform over R omega^2 tells every stiffness over the load: EI / (Q R^2), p0 b R / Q, kw R^2 / Q, kv R^2 / Q,
    tread likewise. So Bs, Cw, Rs, Ts are what it tells times the load number Q / (p0 R^2), the tread's stiffness times
    Q / R^2, and at the same load and pressure all of them fall with R^2. Their ratios and the contact's angle do not.
    """
    for effect in fit.model.effects:
        if effect.name == ROLLING_RADIUS.name:
            error = float(vector[fit.model.layout.effect(effect.name)][0])
            return replace(conditions, radius_m=conditions.radius_m * (1.0 + error))
    return conditions


def _errors(fit: Fit, covariance: FloatArray, index: int, values: Mapping[str, float]) -> dict[str, float]:
    """Return the standard error of each of the estimates of one group's state."""
    layout = fit.model.layout
    where = layout.state(fit.model.campaign.groups[index].state)
    steps = dict(zip(range(where.start, where.stop), fit.model.core.steps.tolist(), strict=True))
    for effect in fit.model.effects:
        if effect.name == ROLLING_RADIUS.name:
            steps[layout.effect(effect.name).start] = effect.parameters[0].step
    gradients = {name: np.zeros(layout.size) for name in values}
    for place, step in steps.items():
        moved = fit.vector.copy()
        moved[place] += step
        for name, value in _values(fit, moved, index).items():
            gradients[name][place] = (value - values[name]) / step
    return {name: math.sqrt(max(float(gradient @ covariance @ gradient), 0.0)) for name, gradient in gradients.items()}


def before_and_after(before: Mapping[str, Fitted], after: Mapping[str, Fitted]) -> dict[str, tuple[Fitted, Fitted]]:
    """Pair the estimates that both have."""
    return {name: (value, after[name]) for name, value in before.items() if name in after}
