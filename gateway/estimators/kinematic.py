"""Speed and contact from the timing and the edges of one revolution; needs no tire model but the belt radius."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from gateway.estimators.base import AngleAverage, Conditions, Estimate, Revolution, Status
from gateway.reasons import Code, Reason

NAMES: Final = ("speed_mps", "leading_edge_rad", "trailing_edge_rad", "contact_length_m")

# Share of interpolated samples above which edges, which may lie in the gap, are provisional.
_MUCH_MISSING: Final = 0.01


class KinematicEstimator:
    """Speed, both contact edges and contact length, of each revolution by itself."""

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "kinematic"

    def reset(self) -> None:
        """Nothing is remembered."""

    def update(
        self,
        revolution: Revolution,
        average: AngleAverage,  # noqa: ARG002 - the interface's; a revolution by itself is enough here
        conditions: Conditions,
    ) -> tuple[Estimate, ...]:
        """Return speed_mps, leading_edge_rad, trailing_edge_rad and contact_length_m of this revolution.

        The standard error of the speed is that of the timing of the two contacts; an error of the belt radius comes on
        top and scales speed and contact length alike. Contact length is the material length R (trailing - leading).
        Never raises on values.
        """
        return tuple(self._estimates(revolution, conditions))

    def _estimates(self, revolution: Revolution, conditions: Conditions) -> Iterator[Estimate]:
        radius = conditions.radius_m
        leading, trailing = revolution.leading_edge_rad, revolution.trailing_edge_rad
        leading_std, trailing_std = revolution.leading_edge_std_rad, revolution.trailing_edge_std_rad
        status, reasons = _condition(revolution)
        speed = radius * revolution.omega_radps
        yield _estimate(NAMES[0], speed, speed * revolution.period_std_s / revolution.period_s, status, reasons)
        yield _estimate(NAMES[1], leading, leading_std, status, reasons)
        yield _estimate(NAMES[2], trailing, trailing_std, status, reasons)
        # The two edges' definition may be off the same way: the errors add without cancelling.
        length_std = radius * (leading_std + trailing_std)
        yield _estimate(NAMES[3], radius * (trailing - leading), length_std, status, reasons)


def _estimate(name: str, value: float, std: float, status: Status, reasons: tuple[Reason, ...]) -> Estimate:
    if not math.isfinite(value):
        return Estimate.invalid(name, *(reasons or (Reason(Code.NO_CONTACT_EDGES),)))
    return Estimate(name, value, std, status, reasons)


def _condition(revolution: Revolution) -> tuple[Status, tuple[Reason, ...]]:
    """Return how far this revolution's timing and edges can be trusted, and why not further."""
    reasons = list(revolution.faults)
    if revolution.saturated:
        reasons.append(Reason(Code.RADIAL_SATURATED))
    if revolution.missing_fraction > _MUCH_MISSING:
        reasons.append(Reason(Code.SAMPLES_LOST_SHARE, share=revolution.missing_fraction))
    return (Status.PROVISIONAL if reasons else Status.VALID), tuple(dict.fromkeys(reasons))
