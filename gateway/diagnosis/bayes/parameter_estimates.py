"""An effect's parameters: value with unit, error over the sets of effects, and the physical range."""

import math
from collections.abc import Sequence

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.effects.effect import Parameter
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Fitted


def outside_range(parameter: Parameter, value: float) -> Reason:
    """Return the reason to reject a value (SI) of a parameter; its numbers are in the display unit."""
    return Reason(
        DiagnosisCode.IMPLAUSIBLE_PARAMETER,
        parameter=parameter.name,
        value=value * parameter.factor,
        low=parameter.low * parameter.factor,
        high=parameter.high * parameter.factor,
        unit=parameter.display_unit or parameter.unit,
    )


def beyond_range(parameters: Sequence[Parameter], values: FloatArray, errors: FloatArray) -> Reason | None:
    """Return why parameters are impossible: the first beyond its range by more than its error allows; None if possible.

    Args:
        parameters: of an effect.
        values: in SI, (P,).
        errors: standard errors, (P,).
    """
    for parameter, value, error in zip(parameters, values.tolist(), errors.tolist(), strict=True):
        tolerance = criteria.BEYOND_BOUND * error
        if not parameter.low - tolerance <= value <= parameter.high + tolerance:
            return outside_range(parameter, value)
    return None


def parameters_over_sets(
    parameters: Sequence[Parameter],
    shown: tuple[FloatArray, FloatArray],
    sets: Sequence[tuple[tuple[FloatArray, FloatArray], float]],
    gain_std: float = 0.0,
) -> dict[str, Fitted]:
    """Return an effect's parameters in one set, by name; their errors are over all sets that matter.

    The value shown is that of the most probable set, with which the other effects' values go together. What the choice
    of the set leaves open, the mean square distance to it, is part of its error.

    Args:
        parameters: of the effect.
        shown: their values in that set and the variances, (P,) each.
        sets: the same of every set with the effect that matters, and its weight; none if the effect is in none.
        gain_std: relative standard error of the sensor's gain.
    """
    values, variances = shown
    total = sum(weight for _, weight in sets)
    if total > 0.0:
        spreads = [weight / total * (variance + np.square(estimate - values)) for (estimate, variance), weight in sets]
        variances = np.sum(spreads, axis=0)
    return {
        parameter.name: fitted_parameter(parameter, float(value), math.sqrt(max(float(variance), 0.0)), gain_std)
        for parameter, value, variance in zip(parameters, values, variances, strict=True)
    }


def fitted_parameter(parameter: Parameter, value: float, std: float, gain_std: float = 0.0) -> Fitted:
    """Return a parameter's value in SI, with its display unit; its error includes that of the effect's equation.

    Args:
        parameter: of an effect.
        value: in SI.
        std: standard error by the data.
        gain_std: relative standard error of the sensor's gain, a part of the error of what goes with it.
    """
    display = parameter.factor, parameter.display_unit, parameter.inverse_display
    by_gain = gain_std * value if parameter.by_gain else 0.0
    by_equation = math.hypot(parameter.equation_share * value, parameter.equation_std)
    std = math.hypot(std, parameter.shared_std or 0.0, by_gain, by_equation)
    # A whole number is tried, not fitted: it has no error.
    return Fitted(value, 0.0 if parameter.whole else std, parameter.unit, *display)
