"""What a fit says of the tire, with errors that know of what the model leaves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.closure.diagnosis import Fitted
from gateway.closure.fit import Fit
from gateway.closure.likelihood import Whitened
from gateway.closure.observation import ORDERS
from gateway.closure.residual import group_residuals

FloatArray = NDArray[np.float64]

NUMBERS: Final = ("Bs", "Cw", "Rs", "Ts")
# Orders over which the residual's power is smoothed before its phases are drawn anew.
_SMOOTHED: Final = 7
# A number known worse than this is not determined; nor is bending below this share of tension.
_WORST_SHARE: Final = 0.3
_LEAST_BENDING: Final = 1e-3
_HALF_ANGLE: Final = "contact_half_angle_rad"
_UNITS: Final = {"tread_stiffness_npm2": "N/m^2", _HALF_ANGLE: "rad"}


def full_covariance(fit: Fit, data: Whitened) -> FloatArray:
    """Return the covariance of the parameters by noise and by model error, (P, P).

    Model error: what a fit leaves of every order, as if its phase were drawn anew each time (physics notes, section
    8), carried through the linear fit. An order's power is that of its neighbourhood.
    """
    covariance = fit.covariance()
    total = covariance.copy()
    kernel = np.ones(_SMOOTHED) / _SMOOTHED
    for rows, residual in zip(fit.rows, group_residuals(fit, data), strict=True):
        excess = np.maximum(0.5 * np.abs(residual.orders_mps2) ** 2 - residual.variance, 0.0)
        size = np.sqrt(np.stack([np.convolve(axis, kernel, mode="same") for axis in excess]))
        response = (rows.rows * (rows.weight * size)[:, None]).sum(axis=0).reshape(-1, 3 * ORDERS)
        shift = covariance[:, rows.places] @ np.concatenate([response.real, response.imag], axis=1)
        total += shift @ shift.T
    return total


def estimates_of(fit: Fit, data: Whitened) -> tuple[dict[str, Fitted], dict[str, bool]]:
    """Return every estimate, and whether the data determine it.

    The state with the most revolutions goes by the plain names, `Bs`; others by `Bs (3500 N, 210 kPa)`.
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
        suffix = ""
        if state != reference:
            suffix = f" ({conditions.load_n:.0f} N, {conditions.pressure_pa / 1e3:.0f} kPa)"
        known = groups[index].load_known and groups[index].pressure_known
        for name, (value, enough) in _of_state(fit, covariance, index, known).items():
            found[name + suffix], determined[name + suffix] = value, enough
    return found, determined


def _of_state(fit: Fit, covariance: FloatArray, index: int, known: bool) -> dict[str, tuple[Fitted, bool]]:
    group, core = fit.model.campaign.groups[index], fit.model.core
    where = fit.model.layout.state(group.state)
    state = fit.vector[where]
    own = covariance[where, where]
    result: dict[str, tuple[Fitted, bool]] = {}
    numbers = core.numbers(state, group.conditions)
    for name, value in numbers.items():
        gradient = _gradient(core.numbers, state, group.conditions, name)
        std = math.sqrt(max(float(gradient @ own @ gradient), 0.0))
        enough = std < _WORST_SHARE * abs(value)
        if name == "Bs":
            enough = enough and value > _LEAST_BENDING * numbers["Cw"]
        result[name] = Fitted(value, std, _UNITS.get(name, "")), enough and known
    for name in ("Bs", "Rs", "Ts"):
        ratio = numbers[name] / numbers["Cw"]
        at, tension = NUMBERS.index(name), NUMBERS.index("Cw")
        variance = own[at, at] + own[tension, tension] - 2.0 * own[at, tension]
        std = ratio * math.sqrt(max(float(variance), 0.0))
        result[f"{name}/Cw"] = Fitted(ratio, std), result[name][1] or (not known and std < _WORST_SHARE * ratio)
    result[_HALF_ANGLE] = _half_angle(fit, covariance, index)
    return result


def _gradient(numbers, state: FloatArray, conditions, name: str) -> FloatArray:  # type: ignore[no-untyped-def]
    base = numbers(state, conditions)[name]
    gradient = np.zeros(len(state))
    for place in range(len(state)):
        moved = state.copy()
        moved[place] += 1e-6
        gradient[place] = (numbers(moved, conditions).get(name, base) - base) * 1e6
    return gradient


def _half_angle(fit: Fit, covariance: FloatArray, index: int) -> tuple[Fitted, bool]:
    group = fit.model.campaign.groups[index]
    where = fit.model.layout.state(group.state)

    def half_angle(vector: FloatArray) -> float:
        shape = fit.model.shape(vector, index)
        return 0.5 * (shape.trailing_edge_rad - shape.leading_edge_rad)

    value = half_angle(fit.vector)
    gradient = np.zeros(len(fit.vector))
    for place, step in zip(range(where.start, where.stop), fit.model.core.steps, strict=True):
        moved = fit.vector.copy()
        moved[place] += step
        gradient[place] = (half_angle(moved) - value) / step
    std = math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))
    return Fitted(value, std, "rad"), std < _WORST_SHARE * value


def before_and_after(before: Mapping[str, Fitted], after: Mapping[str, Fitted]) -> dict[str, tuple[Fitted, Fitted]]:
    """Pair the estimates that both have."""
    return {name: (value, after[name]) for name, value in before.items() if name in after}
