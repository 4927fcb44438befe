"""Relations between the axes of one sensor on a rolling belt: which axis is which, and whether one is late.

A sensor e below the neutral layer, pitched by a small angle, reads -e Omega^2 d(kappa R)/dtheta along the belt, plus
the radial axis times the tilt, plus gravity (`gateway.core.revolutions.sensor_mounting`). Nothing else has the orders
of that axis, so an axis that follows the relation at another angle than the radial one is late by it, and one that
another axis follows far better is not the one along the belt.

The lateral deformation changes its slope at the contact edges, where the curvature changes. So the lateral axis is, in
close approximation, a sum of the slope of the radial one at either edge, of the radial one by the roll, and of order 1.
"""

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.revolutions.sensor_mounting import HUB_ORDER, BeltKinematics
from gateway.core.types import ComplexArray, FloatArray

_CIRCUMFERENTIAL, _LATERAL, _RADIAL = range(3)
# Orders that the relations use, but for that of the hub's motion.
_HIGHEST_ORDER: Final = 30
_LEAST_ORDERS: Final = 10
# Lags that are tried: 2.5 ms are 0.5 rad at 240 km/h.
_LAGS_RAD: Final[FloatArray] = np.linspace(-0.75, 0.75, 301)
# Share of the square of an axis that its relation may leave to tell of a lag. On rings and belts of random tires the
# circumferential relation leaves 0.002 at most, the lateral one 0.05, and 0.1 to 0.9 where there is hardly a ply steer.
_ALONG_LIMIT: Final = 0.02
_LATERAL_LIMIT: Final = 0.1
# Factor by which the lag must lower what the relation leaves: 1.0 and 1.15 where nothing is late, 3 and 2.5 at 0.3 ms.
_MIN_IMPROVEMENT: Final = 2.0
# Least lag that counts, and as a share of the half contact angle: where nothing is late the circumferential axis has
# none, the lateral one up to 0.06 of it.
_LEAST_LAG_RAD: Final = 0.012
_LEAST_LAG_SHARE: Final = 0.1
# Factor by which the lateral axis must follow the relation of the circumferential one better than that does itself: 500
# and more where both are swapped, at most 0.03 where they are not, 9 where the wheel turns unevenly by 1 %.
_SWAPPED_FACTOR: Final = 30.0


class Lag(NamedTuple):
    """Lag of an axis behind the radial one, significant or not, and its standard error by what the relation leaves."""

    late_s: float
    std_s: float


class AxisRelations(NamedTuple):
    """What the relations say.

    Attributes:
        circumferential_late_rad: lag of the circumferential axis behind the radial one; 0 where none is significant.
        lateral_late_rad: likewise of the lateral axis.
        is_swapped: whether the circumferential axis is the lateral one, and the other way round.
        roll_rad: roll by the shape of the lateral axis; NaN where that is not known.
        swapped_offset_m: of the sensor below the neutral layer, where both are swapped by the one along the belt;
            NaN likewise.
        tilt: of the radial axis into the circumferential one, by the shape of the latter; NaN likewise.
        along_zero_mps2: zero-g offset of the latter, what its mean has beyond the tilt; NaN likewise.
        lags: of the circumferential and the lateral axis that are not significant by themselves, to compare with those
            of other wheels; None where the relation does not hold.
    """

    circumferential_late_rad: float = 0.0
    lateral_late_rad: float = 0.0
    is_swapped: bool = False
    roll_rad: float = math.nan
    swapped_offset_m: float = math.nan
    tilt: float = math.nan
    along_zero_mps2: float = math.nan
    lags: tuple[Lag | None, Lag | None] = (None, None)


class _Fit(NamedTuple):
    """Best lag of an axis, its error, the square it leaves, that without a lag, that of the axis, and the factors."""

    lag_rad: float
    std_rad: float
    least: float
    without: float
    whole: float
    factors: FloatArray

    def late_rad(self, least_rad: float, most_left: float) -> float:
        """Return the lag where it is significant, else 0; `most_left` is the share that the relation may leave."""
        is_late = (
            abs(self.lag_rad) > max(least_rad, _LEAST_LAG_RAD)
            and self.least < most_left * self.whole
            and self.without > _MIN_IMPROVEMENT * self.least
        )
        return self.lag_rad if is_late else 0.0

    def lag(self, late_rad: float, most_left: float, omega_radps: float) -> Lag | None:
        """Return the lag of a relation that holds and does not say by itself that the axis is late."""
        if late_rad or not self.least < most_left * self.whole:
            return None
        return Lag(self.lag_rad / omega_radps, self.std_rad / omega_radps)


def axis_relations(
    axes_mps2: FloatArray,
    belt: BeltKinematics,
    edges_rad: tuple[float, float],
    square_radps2: float,
    reaction_mps2: float,
    order_max: int,
) -> AxisRelations:
    """Return what the relations say of averaged axes.

    Args:
        axes_mps2: (3, n) average over revolutions, as measured on the angle grid; NaN rows for absent axes.
        belt: kinematics of the belt.
        edges_rad: of the contact.
        square_radps2: mean square of the angular speed of these revolutions.
        reaction_mps2: their mean angular acceleration times the belt radius.
        order_max: highest order that the sampling carries.
    """
    count = min(_HIGHEST_ORDER, order_max)
    n = axes_mps2.shape[1]
    if count < _LEAST_ORDERS or not np.isfinite(axes_mps2[_RADIAL]).all():
        return AxisRelations()
    spectra = np.fft.rfft(axes_mps2, axis=1)[:, : count + 1] * (2.0 / n)
    has_circumferential, has_lateral = np.isfinite(spectra[:2, 0].real).tolist()
    half_rad = 0.5 * (edges_rad[1] - edges_rad[0])
    circumferential_rad = lateral_rad = 0.0
    is_swapped, roll_rad, tilt, zero_mps2, swapped_offset_m = False, math.nan, math.nan, math.nan, math.nan
    circumferential_lag = lateral_lag = None
    omega_radps = math.sqrt(square_radps2)
    if has_circumferential:
        orders = np.delete(np.arange(1, count + 1), HUB_ORDER - 1)
        predicted = STANDARD_GRAVITY_MPS2 * belt.known_spectra[0] + reaction_mps2 * belt.known_spectra[1]
        factors = np.array([square_radps2 * belt.along[orders], spectra[_RADIAL, orders]])
        fit = _fit(spectra[_CIRCUMFERENTIAL, orders], factors, orders, predicted[orders])
        circumferential_rad = fit.late_rad(0.0, _ALONG_LIMIT)
        circumferential_lag = fit.lag(circumferential_rad, _ALONG_LIMIT, omega_radps)
        if fit.least < _ALONG_LIMIT * fit.whole and not circumferential_rad:
            tilt = float(fit.factors[1])
            # Order 0 of a spectrum is twice the mean; that by the depth has none.
            doubled_zero = spectra[_CIRCUMFERENTIAL, 0] - predicted[0] - tilt * spectra[_RADIAL, 0]
            zero_mps2 = 0.5 * float(doubled_zero.real)
        if has_lateral:
            residual, total, swapped_offset_m = _remainder(spectra[_LATERAL, orders], factors, predicted[orders])
            is_swapped = residual < _ALONG_LIMIT * total and fit.least * total > _SWAPPED_FACTOR * residual * fit.whole
    if has_lateral and not is_swapped:
        orders = np.arange(1, count + 1)
        lateral = _fit(spectra[_LATERAL, orders], _lateral_factors(axes_mps2[_RADIAL], belt, edges_rad, count), orders)
        lateral_rad = lateral.late_rad(_LEAST_LAG_SHARE * half_rad, _LATERAL_LIMIT)
        lateral_lag = lateral.lag(lateral_rad, _LATERAL_LIMIT, omega_radps)
        if lateral.least < _LATERAL_LIMIT * lateral.whole:
            roll_rad = math.atan(float(lateral.factors[2]))
    if is_swapped:
        return AxisRelations(0.0, lateral_rad, is_swapped, roll_rad, swapped_offset_m)
    lags = circumferential_lag, lateral_lag
    return AxisRelations(circumferential_rad, lateral_rad, is_swapped, roll_rad, math.nan, tilt, zero_mps2, lags)


def _lateral_factors(
    radial_mps2: FloatArray, belt: BeltKinematics, edges_rad: tuple[float, float], count: int
) -> ComplexArray:
    """Return orders 1 to `count` of what the lateral axis is a sum of, (5, count)."""
    n = len(radial_mps2)
    weightless = radial_mps2 - STANDARD_GRAVITY_MPS2 * np.cos(belt.inclination_rad)
    spectrum = np.fft.rfft(weightless)
    spectrum[count + 1 :] = 0.0
    slope = np.fft.irfft(1j * np.arange(len(spectrum)) * spectrum, n)
    is_leading = angle_grid(n) < 0.5 * (edges_rad[0] + edges_rad[1])
    parts = np.stack([np.where(is_leading, slope, 0.0), np.where(is_leading, 0.0, slope), weightless])
    factors = np.zeros((5, count), dtype=np.complex128)
    factors[:3] = np.fft.rfft(parts, axis=1)[:, 1 : count + 1] * (2.0 / n)
    factors[3, 0], factors[4, 0] = 1.0, 1j
    return factors


def _fit(
    spectrum: ComplexArray, factors: ComplexArray, orders: NDArray[np.intp], predicted: ComplexArray | None = None
) -> _Fit:
    """Return the best fit of a spectrum, (m,), by factors, (j, m), over all lags; `predicted` is not fitted."""
    basis, triangle = _basis(factors)
    # The square of shifted - predicted and its products with the basis are sums of the spectrum by factors of a lag.
    columns = np.concatenate([spectrum * basis.conj().T, [spectrum * (0.0 if predicted is None else predicted.conj())]])
    # Real parts alone: half of the work of a complex product.
    products = _shifts(tuple(orders.tolist())) @ np.concatenate([columns.real, columns.imag], axis=1).T
    total = float(np.vdot(spectrum, spectrum).real)
    explained, square = products[:, :-1], total
    if predicted is not None:
        explained = explained - (predicted @ basis.conj()).real
        square = total + float(np.vdot(predicted, predicted).real)
    squares = np.maximum(square - 2.0 * products[:, -1] - np.sum(explained * explained, axis=1), 0.0)
    index = int(squares.argmin())
    solution = np.linalg.lstsq(triangle, explained[index], rcond=None)[0]
    lag_rad, std_rad = _lowest(squares, index, 2 * len(orders) - len(solution) - 1)
    return _Fit(lag_rad, std_rad, float(squares[index]), float(squares[len(_LAGS_RAD) // 2]), total, solution)


def _lowest(squares: FloatArray, index: int, freedoms: int) -> tuple[float, float]:
    """Return where the parabola through the least square and its neighbours is lowest, and the standard error."""
    step_rad = float(_LAGS_RAD[1] - _LAGS_RAD[0])
    before, minimum, after = squares[np.clip([index - 1, index, index + 1], 0, len(squares) - 1)].tolist()
    curvature = before - 2.0 * minimum + after
    if not curvature > 0.0:
        return float(_LAGS_RAD[index]), math.inf
    offset = min(max(0.5 * (before - after) / curvature, -0.5), 0.5)
    return float(_LAGS_RAD[index]) + offset * step_rad, step_rad * math.sqrt(2.0 * minimum / (freedoms * curvature))


def _remainder(spectrum: ComplexArray, factors: ComplexArray, predicted: ComplexArray) -> tuple[float, float, float]:
    """Return the square that a fit without a lag leaves of a spectrum, that of the spectrum, and the first factor."""
    basis, triangle = _basis(factors)
    target = spectrum - predicted
    explained = (target @ basis.conj()).real
    remainder = max(float(np.vdot(target, target).real - explained @ explained), 0.0)
    first = float(np.linalg.lstsq(triangle, explained, rcond=None)[0][0])
    return remainder, float(np.vdot(spectrum, spectrum).real), first


def _basis(factors: ComplexArray) -> tuple[ComplexArray, FloatArray]:
    """Return orthonormal columns, (m, j), real part by real factors, and the triangle from these to the factors."""
    count = factors.shape[1]
    stacked, triangle = np.linalg.qr(np.concatenate([factors.real, factors.imag], axis=1).T)
    return stacked[:count] + 1j * stacked[count:], triangle


@lru_cache(maxsize=64)
def _shifts(orders: tuple[int, ...]) -> FloatArray:
    """Return the factors that undo each lag, real parts, then minus the imaginary ones, (lags, 2 m)."""
    angles = np.multiply.outer(_LAGS_RAD, np.array(orders, dtype=np.float64))
    return np.concatenate([np.cos(angles), -np.sin(angles)], axis=1)
