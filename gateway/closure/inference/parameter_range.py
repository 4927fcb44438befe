"""Reason to reject a value outside a parameter's physical range."""

from gateway.closure.effects.effect import Parameter
from gateway.reasons import Code, Reason


def outside_range(parameter: Parameter, value: float) -> Reason:
    """Return the reason to reject a value (SI) of a parameter; its numbers are in the display unit."""
    return Reason(
        Code.IMPLAUSIBLE_PARAMETER,
        parameter=parameter.name,
        value=value * parameter.factor,
        low=parameter.low * parameter.factor,
        high=parameter.high * parameter.factor,
        unit=parameter.display_unit or parameter.unit,
    )
