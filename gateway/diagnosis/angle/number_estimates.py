"""Dimensionless numbers of the tire from a fit, with errors that include the residual."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.effect import GroupConditions
from gateway.diagnosis.effects.wheel_nonuniformity import ROLLING_RADIUS
from gateway.diagnosis.result import Fitted, TireState

# Bending below this share of tension is not determined.
_MIN_BENDING_SHARE: Final = 1e-3
# Standard errors from which two states contradict each other.
_CONTRADICTION_SIGMAS: Final = 3.0
_HALF_ANGLE: Final = "contact_half_angle_rad"
_TREAD: Final = "tread_stiffness_npm2"
# Errors due to contact edges between the nodes of the solver's grid, as shares: rms over rings drawn at random.
_GRID_SHARES: Final = {"Bs": 5e-5, "Cw": 8e-5, "Rs": 5e-5, "Ts": 2.5e-4, _TREAD: 3.5e-4, _HALF_ANGLE: 4e-4}
# In proportion to the load that was stated.
_LOAD_PROPORTIONAL: Final = frozenset({*RING_NUMBERS, _TREAD})
_UNITS: Final = {_TREAD: "N/m^2", _HALF_ANGLE: "rad"}


@dataclass(frozen=True, slots=True)
class OpenEffect:
    """An effect that the data neither show nor exclude and that makes up most of the error of numbers.

    Attributes:
        name: of the effect.
        probability: that it is present.
        numbers: whose errors it makes up.
        ratio: largest ratio of their errors to those without it or, where it is more likely present, with it.
    """

    name: str
    probability: float
    numbers: tuple[str, ...]
    ratio: float


def open_effects(sets: Sequence[tuple[Fit, float]], estimates: Mapping[str, Fitted]) -> tuple[OpenEffect, ...]:
    """Return the effects whose presence is open and makes up most of the error of numbers, most probable first.

    Args:
        sets: fit and probability of each set of effects; probabilities add up to 1.
        estimates: their mean, with all its errors. The numbers are those of the state with the most revolutions.
    """
    campaign = sets[0][0].model.campaign
    index = _first_group(campaign, _reference_state(campaign))
    entries = [(weight, *_values_and_errors(fit, index)) for fit, weight in sets]
    name_sets = [frozenset(effect.name for effect in fit.model.effects) for fit, _ in sets]
    _, errors = _mean_of(entries)
    effects = []
    for name in sorted(frozenset().union(*name_sets)):
        probability = sum(weight for (weight, *_), names in zip(entries, name_sets, strict=True) if name in names)
        if probability >= criteria.NAMED:
            continue
        is_likely = probability > 0.5
        _, conditional_errors = _mean_of(
            [entry for entry, names in zip(entries, name_sets, strict=True) if (name in names) == is_likely]
        )
        ratios = {}
        for number in RING_NUMBERS:
            std = estimates[number].std
            without = math.sqrt(max(std**2 - errors[number] ** 2 + conditional_errors[number] ** 2, 0.0))
            if std > criteria.OPEN_RATIO * without > 0.0:
                ratios[number] = std / without
        if ratios:
            effects.append(OpenEffect(name, probability, tuple(ratios), max(ratios.values())))
    return tuple(sorted(effects, key=lambda effect: (-effect.probability, effect.name)))


def estimates_of(
    sets: Sequence[tuple[Fit, float]],
    better: Sequence[Mapping[str, Fitted]] = (),
    contradicted: frozenset[int] = frozenset(),
    left_ratio: float = 1.0,
) -> tuple[dict[str, Fitted], dict[str, bool]]:
    """Return every estimate, and whether the data determine it.

    The state with the most revolutions goes by the plain names, `Bs`; others by `Bs (3500 N, 210 kPa)`. A value is the
    mean over the sets of effects. Its variance is the mean of theirs, discrepancy included, plus that of their values.

    Args:
        sets: fit and probability of each set of effects; probabilities add up to 1.
        better: estimates by models that explain more of the same data. The distance to the farthest is an error too.
        contradicted: states whose recordings contradict each other or are in doubt: nothing of them is determined.
        left_ratio: rms of what the sets leave of the wheel's plane over that of the noise. Evidence counts less by it
            from `criteria.TEMPERED` on, and an error is then judged as if it were larger by its root.
    """
    estimates: dict[str, Fitted] = {}
    determined: dict[str, bool] = {}
    campaign = sets[0][0].model.campaign
    groups = campaign.groups
    doubt_factor = math.sqrt(left_ratio) if left_ratio >= criteria.TEMPERED else 1.0
    for state, tire_state in _tire_states(campaign).items():
        index = _first_group(campaign, state)
        suffix = "" if tire_state is None else f" ({_state_name(tire_state)})"
        conditions_known = groups[index].load_known and groups[index].pressure_known
        values, errors = _mean_of([(weight, *_values_and_errors(fit, index)) for fit, weight in sets])
        for name, value in values.items():
            distances = [abs(value - others[name + suffix].value) for others in better if name + suffix in others]
            errors[name] = math.hypot(errors[name], max(distances, default=0.0))
            estimates[name + suffix] = Fitted(
                value, errors[name], _UNITS.get(name, ""), quantity=name, state=tire_state
            )
            determined[name + suffix] = state not in contradicted and _is_determined(
                name, values, errors, doubt_factor, conditions_known
            )
    return estimates, determined


def belt_widths(campaign: Campaign, estimates: Mapping[str, Fitted]) -> dict[int, Fitted]:
    """Return Cw of each state whose load and pressure are stated: assumed ones contradict nothing."""
    assumed = {group.state for group in campaign.groups if not (group.load_known and group.pressure_known)}
    widths = {estimate.state: estimate for estimate in estimates.values() if estimate.quantity == "Cw"}
    return {state: widths[named] for state, named in _tire_states(campaign).items() if state not in assumed}


def belt_widths_apart(widths: Iterable[Fitted]) -> tuple[Fitted, Fitted] | None:
    """Return the lower and the higher of the two Cw farthest apart that contradict each other, None without such.

    Cw is the belt's width over its radius, the same at every load and pressure. All numbers of a state are proportional
    to its load over its pressure: where that is stated wrongly, Cw is off by the same share.
    """
    ordered = sorted((width for width in widths if width.value > 0.0), key=lambda width: width.value)
    pairs = (pair for pair in combinations(ordered, 2) if contradict(*pair))
    return max(pairs, key=lambda pair: pair[1].value / pair[0].value, default=None)


def contradict(first: Fitted, second: Fitted) -> bool:
    """Return whether two estimates of the same number differ by three standard errors and more."""
    return abs(first.value - second.value) > _CONTRADICTION_SIGMAS * math.hypot(first.std, second.std)


def widened(estimates: Mapping[str, Fitted], low: Fitted, high: Fitted) -> dict[str, Fitted]:
    """Return estimates whose errors contain the distance of two states that contradict each other.

    Args:
        estimates: of all states.
        low: Cw of one state.
        high: of the other.
    """
    share = math.log(high.value / low.value)
    return {
        name: replace(estimate, std=math.hypot(estimate.std, share * estimate.value))
        if estimate.quantity in _LOAD_PROPORTIONAL
        else estimate
        for name, estimate in estimates.items()
    }


def still_determined(estimates: Mapping[str, Fitted], determined: Mapping[str, bool]) -> dict[str, bool]:
    """Return which estimates are determined once their errors were widened."""
    return {
        name: was_determined and estimates[name].std < criteria.DETERMINED * abs(estimates[name].value)
        for name, was_determined in determined.items()
    }


def _reference_state(campaign: Campaign) -> int:
    """Return the state with the most revolutions."""
    counts = [0] * campaign.states
    for group in campaign.groups:
        counts[group.state] += group.revolutions
    return int(np.argmax(counts))


def _tire_states(campaign: Campaign) -> dict[int, TireState | None]:
    """Return load and pressure of each state, in the order of estimates: first that with the most revolutions, None."""
    reference = _reference_state(campaign)
    states: dict[int, TireState | None] = {}
    names: list[str] = []
    for state in sorted({group.state for group in campaign.groups}, key=lambda state: (state != reference, state)):
        conditions = campaign.groups[_first_group(campaign, state)].conditions
        tire_state = TireState(conditions.load_n, conditions.pressure_pa)
        names.append(_state_name(tire_state))
        number = names.count(names[-1])
        states[state] = None if state == reference else tire_state._replace(number=number if number > 1 else 0)
    return states


def _first_group(campaign: Campaign, state: int) -> int:
    return next(index for index, group in enumerate(campaign.groups) if group.state == state)


def _values_and_errors(fit: Fit, index: int) -> tuple[dict[str, float], dict[str, float]]:
    """Return the estimates of one group's state by one set of effects, and their standard errors."""
    values = _values(fit, fit.vector, index)
    return values, _errors(fit, fit.covariance, index, values)


def _mean_of(
    sets: Sequence[tuple[float, Mapping[str, float], Mapping[str, float]]],
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the mean of values of several sets, and its standard error.

    Args:
        sets: weight, values and errors of each.
    """
    mean: dict[str, float] = {}
    square: dict[str, float] = {}
    total = sum(weight for weight, *_ in sets)
    for share, values, errors in sets:
        weight = share / total
        for name, value in values.items():
            mean[name] = mean.get(name, 0.0) + weight * value
            square[name] = square.get(name, 0.0) + weight * (value**2 + errors[name] ** 2)
    return mean, {name: math.sqrt(max(square[name] - value**2, 0.0)) for name, value in mean.items()}


def _state_name(state: TireState) -> str:
    """Return the name of a state in the keys of estimates: its load and pressure, and the contact's number."""
    contact = f", contact {state.number}" if state.number else ""
    return f"{state.load_n:.0f} N, {state.pressure_pa / 1e3:.0f} kPa{contact}"


def _is_determined(
    name: str, values: Mapping[str, float], errors: Mapping[str, float], doubt_factor: float, conditions_known: bool
) -> bool:
    is_precise = doubt_factor * errors[name] < criteria.DETERMINED * abs(values[name])
    if name == _HALF_ANGLE:
        return is_precise
    number, _, denominator = name.partition("/")
    if denominator and not conditions_known:
        return is_precise
    if denominator:
        return _is_determined(number, values, errors, doubt_factor, conditions_known)
    if name == "Bs":
        is_precise = is_precise and values[name] > _MIN_BENDING_SHARE * values["Cw"]
    return is_precise and conditions_known


def _values(fit: Fit, vector: FloatArray, index: int) -> dict[str, float]:
    """Return the estimates of one group's state at these parameters."""
    group, layout = fit.model.campaign.groups[index], fit.model.layout
    numbers = fit.model.core.numbers(vector[layout.state(group.state)], _with_radius(fit, vector, group.conditions))
    values = dict(numbers)
    values.update({f"{name}/Cw": numbers[name] / numbers["Cw"] for name in RING_NUMBERS if name != "Cw"})
    shape = fit.model.shape(vector, index)
    values[_HALF_ANGLE] = 0.5 * (shape.trailing_edge_rad - shape.leading_edge_rad)
    return values


def _with_radius(fit: Fit, vector: FloatArray, conditions: GroupConditions) -> GroupConditions:
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
    errors = {
        name: math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))
        for name, gradient in _gradients(fit, index, values).items()
    }
    for name, value in values.items():
        shares = (_GRID_SHARES.get(part, 0.0) for part in name.split("/"))
        errors[name] = math.hypot(errors[name], *(share * value for share in shares))
    return errors


def _gradients(fit: Fit, index: int, values: Mapping[str, float]) -> dict[str, FloatArray]:
    """Return the derivatives (P,) of the estimates of one group's state by the parameters of a fit."""
    layout = fit.model.layout
    where = layout.state(fit.model.campaign.groups[index].state)
    steps = dict(zip(range(where.start, where.stop), fit.model.core.steps.tolist(), strict=True))
    for effect in fit.model.effects:
        if effect.name == ROLLING_RADIUS.name:
            steps[layout.effect(effect.name).start] = effect.parameters[0].step
    gradients = {name: np.zeros(layout.size) for name in values}
    for parameter_index, step in steps.items():
        vector = fit.vector.copy()
        vector[parameter_index] += step
        for name, value in _values(fit, vector, index).items():
            gradients[name][parameter_index] = (value - values[name]) / step
    return gradients


def before_and_after(before: Mapping[str, Fitted], after: Mapping[str, Fitted]) -> dict[str, tuple[Fitted, Fitted]]:
    """Pair the estimates that both have."""
    return {name: (value, after[name]) for name, value in before.items() if name in after}
