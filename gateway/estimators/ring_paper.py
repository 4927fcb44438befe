"""The ring paper's estimator: Eq. 28 and 29 as printed but for their misprints. The named reference.

It is what the paper describes, not the best that the signal allows: on the geometrically exact ring its numbers are off
by tens of percent, because a loaded belt is not a linear ring and contact pressure is not uniform. The equations, what
was repaired and the measured errors are in docs/ring-paper-estimator.md. Its standard errors cover noise, the fit's
residual, load, pressure and contact angle; they do not cover that model error.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.estimators.base import AngleAverage, Conditions, Estimate, Revolution, Status
from gateway.estimators.ring_fit import RingFit, fit_ring_numbers

FloatArray = NDArray[np.float64]

NUMBERS: Final = ("Bs", "Cw", "Rs", "Ts")
RATIOS: Final = ("Bs/Cw", "Rs/Cw", "Ts/Cw")

# Effective revolutions in the average from which the numbers are called valid.
SETTLED_REVOLUTIONS: Final = 8.0
# Tangential stiffness lives on orders up to 4, bending on orders up to 14 (95 % of their sensitivity): fewer orders
# than this cannot tell the four apart.
LEAST_ORDERS: Final = 16

# Share of the signal left over from which the ring is no description of it: 0.06 on the exact ring, 0.24 on the
# measured tire.
WORST_RESIDUAL: Final = 0.5

_MODEL_NOTE: Final = "linear ring: model error is not in the standard error"


class RingPaperEstimator:
    """Bs, Cw, Rs, Ts and their ratios to Cw from the running average's orders 1 to 60."""

    def __init__(self) -> None:
        """Start cold."""
        self.reset()

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "ring-paper"

    def reset(self) -> None:
        """Forget the warm start."""
        self._updates = 0
        self._warm: FloatArray | None = None
        self._warm_force_m = math.nan

    def update(self, revolution: Revolution, average: AngleAverage, conditions: Conditions) -> tuple[Estimate, ...]:
        """Return Bs, Cw, Rs, Ts, then Bs/Cw, Rs/Cw, Ts/Cw.

        Without load or pressure the four are invalid and the ratios stand, for all four are proportional to Q / p0.
        Provisional until the average has settled, and on a revolution with faults. Never raises on values.
        """
        orders = np.flatnonzero(np.isfinite(average.orders_mps2))
        orders = orders[orders > 0]
        half_angle = 0.5 * (average.trailing_edge_rad - average.leading_edge_rad)
        if len(orders) < LEAST_ORDERS:
            return _all_invalid(
                f"only {len(orders)} orders, {LEAST_ORDERS} are needed: sampling too slow for this speed"
            )
        if not 0.0 < half_angle < math.pi / 2.0:
            return _all_invalid("no contact edges yet")
        if not (_positive(average.omega_radps) and _positive(conditions.radius_m)):
            return _all_invalid("angular speed or belt radius is not known")

        missing = _missing(conditions)
        load_over_pressure = 1.0 if missing else float(conditions.load_n or 0.0) / float(conditions.pressure_pa or 1.0)
        force = load_over_pressure / (math.pi * conditions.radius_m * half_angle)
        # Angle 0 is the middle of the contact here, wherever the segmentation has put it.
        centre = 0.5 * (average.trailing_edge_rad + average.leading_edge_rad)
        n = orders.astype(np.float64)
        coefficients = (average.orders_mps2[orders] * np.exp(1j * n * centre)).real / average.omega_radps**2
        stds = average.orders_std_mps2[orders] / average.omega_radps**2
        fit = fit_ring_numbers(n, coefficients, stds, force_m=force, half_angle_rad=half_angle, warm=self._start(force))
        if fit is None:
            self._warm = None
            return _all_invalid("the orders are flat or not finite")
        if fit.residual > WORST_RESIDUAL:
            self._warm = None
            return _all_invalid(f"the ring does not describe these orders: {fit.residual:.0%} left over")
        self._warm, self._warm_force_m = fit.numbers, force

        # Both edges' definition may be off the same way, so their errors add without cancelling.
        angle_std = 0.5 * (average.leading_edge_std_rad + average.trailing_edge_std_rad)
        covariance = fit.covariance + np.outer(fit.angle_derivative, fit.angle_derivative) * _square(angle_std)
        doubt = _doubt(revolution, average)
        if missing:
            numbers = tuple(_invalid(name, missing) for name in NUMBERS)
        else:
            scale = math.hypot(
                conditions.load_std_n / float(conditions.load_n or 1.0),
                conditions.pressure_std_pa / float(conditions.pressure_pa or 1.0),
            )
            stds = np.sqrt(np.diagonal(covariance) + np.square(fit.numbers * scale))
            numbers = tuple(
                _estimate(name, fit.numbers[i], stds[i], bool(fit.free[i]), doubt) for i, name in enumerate(NUMBERS)
            )
        return numbers + _ratios(fit, covariance, doubt)

    def _start(self, force_m: float) -> FloatArray | None:
        """Return the last numbers, scaled to this force; None for a cold start, at updates 1, 2, 4, 8, ..."""
        self._updates += 1
        if self._warm is None or not self._updates & (self._updates - 1):
            return None
        result: FloatArray = self._warm * (force_m / self._warm_force_m)
        return result


def _ratios(fit: RingFit, covariance: FloatArray, doubt: str) -> tuple[Estimate, ...]:
    """Return Bs/Cw, Rs/Cw, Ts/Cw with errors to first order."""
    cw = fit.numbers[1]
    result = []
    for name, i in zip(RATIOS, (0, 2, 3), strict=True):
        if not fit.free[1]:
            result.append(_invalid(name, "not determined: the fit puts Cw at zero"))
            continue
        ratio = fit.numbers[i] / cw
        gradient = np.zeros(4)
        gradient[i], gradient[1] = 1.0 / cw, -ratio / cw
        std = math.sqrt(max(0.0, float(gradient @ covariance @ gradient)))
        result.append(_estimate(name, ratio, std, bool(fit.free[i]), doubt))
    return tuple(result)


def _estimate(name: str, value: float, std: float, free: bool, doubt: str) -> Estimate:
    if not free:
        return _invalid(name, "not determined: the fit puts it at zero")
    if doubt:
        return Estimate(name, float(value), float(std), Status.PROVISIONAL, doubt)
    if not std < value:
        return Estimate(name, float(value), float(std), Status.PROVISIONAL, "not determined: error exceeds value")
    return Estimate(name, float(value), float(std), Status.VALID, _MODEL_NOTE)


def _doubt(revolution: Revolution, average: AngleAverage) -> str:
    """Return why the estimates are provisional, or an empty string."""
    if revolution.faults:
        return "this revolution was not used: " + ", ".join(revolution.faults)
    if average.effective_count < SETTLED_REVOLUTIONS * (1.0 - 1e-9):
        return f"average of {average.effective_count:.0f} revolutions, settles at {SETTLED_REVOLUTIONS:.0f}"
    return ""


def _missing(conditions: Conditions) -> str:
    """Return what is missing for absolute numbers and how to supply it, or an empty string."""
    missing = []
    if not _positive(conditions.load_n):
        missing.append("load (set load_n of the wheel, or weight_kg of its axle, in the vehicle file)")
    if not _positive(conditions.pressure_pa):
        missing.append("pressure (set pressure_kpa of the tire in the vehicle file, or let the sensor report it)")
    return f"needs {' and '.join(missing)}; the ratios do not" if missing else ""


def _positive(value: float | None) -> bool:
    return value is not None and math.isfinite(value) and value > 0.0


def _square(value: float) -> float:
    return value * value if math.isfinite(value) else 0.0


def _invalid(name: str, reason: str) -> Estimate:
    return Estimate(name, math.nan, math.nan, Status.INVALID, reason)


def _all_invalid(reason: str) -> tuple[Estimate, ...]:
    return tuple(_invalid(name, reason) for name in (*NUMBERS, *RATIOS))
