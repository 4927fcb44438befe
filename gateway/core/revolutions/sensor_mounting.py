"""Mounting of a sensor in the tire: offset below the neutral layer, pitch tilt and roll tilt.

Offset and pitch come from the circumferential axis. On an inextensible belt that rolls steadily, a sensor e below the
neutral layer reads s = V^2 kappa (1 - e kappa) inward and -e Omega^2 d(kappa R)/dtheta along the belt. A pitch tilt
mixes the radial axis into the circumferential one. Gravity along the belt and the reaction to angular acceleration are
known. Given kappa, all of this is linear in e, the tilt and the zero-g offset, and kappa depends on e to second order
only.

Roll comes from the means of the lateral and radial axes (`RollCalibration`).
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.compiled import core
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.quantity import LARGEST_ZERO_MPS2
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.types import BoolArray, ComplexArray, FloatArray, IntArray

# Highest order used: above it there is noise but no signal of a tire's slope.
HIGHEST_ORDER: Final = 60
# First orders of the bands whose disagreement shows what the equations do not describe.
_BANDS: Final = (0, 2, 4, 6, 9, 13, 18, 24, 31, 39, 48)
# Products of e, tilt and left-hand side by band, three products with the zero-g offset, and the number of equations.
MOUNTING_SIZE: Final = 6 * len(_BANDS) + 4
HUB_ORDER: Final = 2
"""Order of the circumferential and the radial axis that has motion of the hub at the wheel's frequency."""
HUB_SIZE: Final = 7
# Least number of orders that tell a yaw.
_YAW_ORDERS: Final = 16
# What a belt that stretches, shear in the contact, and a hub that moves unevenly make of a yaw: up to 7 deg where there
# is hardly a lateral signal.
_YAW_MODEL_RAD: Final = math.radians(2.5)

# Prior of the constant in the mean of the lateral axis: zero-g offset after the calibration in the hello (0.1 g) and
# gravity times camber (1 m/s^2 is 6 deg).
OFFSET_STD_MPS2: Final = 1.0
# Deviation of the mean of one revolution by itself: an uneven road, steering, noise.
REVOLUTION_STD_MPS2: Final = 0.5
BANK_MPS2: Final = 0.35
"""Gravity by bank and camber in the mean of the lateral axis, 2 deg."""
# Revolutions over which road and curve last.
_GROUP_REVOLUTIONS: Final = 25
# Accuracy of mounting by hand. It stays the standard error when the means are lost (AC coupling).
MOUNTING_STD_RAD: Final = math.radians(1.0)
# Standard errors beyond which a measured constant contradicts its prior.
_CONTRADICTION: Final = 3.0
# Least relative variance of the radial mean, which is a spread of the speed of 0.5 %.
_LEAST_SPREAD: Final = 1e-4
# Lateral acceleration of a usual curve, which the lateral mean contains, and the number of latest revolutions whose
# means, where they are further off than by a curve, are those of another roll.
_CURVE_MPS2: Final = 4.0
_LATEST_REVOLUTIONS: Final = 8
# Wide prior of the roll tilt; keeps the estimate finite in the first revolutions.
_ROLL_PRIOR_STD_RAD: Final = math.radians(10.0)


@dataclass(frozen=True, slots=True)
class BeltKinematics:
    """Kinematics of a sensor on a belt of known shape.

    Attributes:
        along: (HIGHEST_ORDER + 1,) coefficients of -d(kappa R)/dtheta: the circumferential signal over Omega^2 of a
            sensor 1 m below the neutral layer.
        inclination_rad: (n,) angle of the tangent from the horizontal.
        mean_square: mean square of kappa R.
        signal_order_1: cosine order 1 of the signal of the closed belt, about the contact centre and over the mean. It
            follows from closure and does not depend on the measured order 1.
        gravity_order_1: cosine order 1 of cos(inclination).
        known_spectra: (2, HIGHEST_ORDER + 1) Fourier sums times 2 / n of sin(inclination) and 1 - cos(inclination):
            gravity along the belt over g, and the reaction to angular acceleration over R times it.
    """

    along: ComplexArray
    inclination_rad: FloatArray
    mean_square: float
    signal_order_1: float
    gravity_order_1: float
    known_spectra: ComplexArray


@dataclass(frozen=True, slots=True)
class MountingRows:
    """Linear equations of (e in m, tan of the pitch, zero-g offset in m/s^2), summed by bands of orders.

    Attributes:
        sums: (k, MOUNTING_SIZE) of k sets of equations. Products of the factors of e and tilt with each other and with
            the left-hand side, by band; products with the factor of the zero-g offset, which has an equation in order 0
            only; and the number of equations. Sets are combined by adding them.
        hub: (k, HUB_SIZE) order 2 of the left-hand side and of the factors of e and tilt, real and imaginary parts, and
            the number of sets. Order 2 is no part of the equations: it has motion of the hub at the wheel's frequency.
    """

    sums: FloatArray
    hub: FloatArray

    def solve(self) -> tuple[FloatArray, FloatArray]:
        """Return the unknowns of each set and their standard errors, (k, 3) each; NaN for unknowns without equations.

        The errors are the larger of two: those of white residuals, and those from the disagreement of the bands
        (cluster-robust covariance). The second does not shrink with the number of revolutions where the residual
        repeats, as that of a tread does.
        """
        return solutions(self.sums)

    def _solved(self) -> tuple[FloatArray, FloatArray]:
        bands = len(_BANDS)
        products = self._products
        tilt_zero, zero_zero, zero_right, count = self.sums[:, 6 * bands :].T
        solution, right, inverse, determined = self._solution()
        size = determined.sum(axis=1)
        with np.errstate(invalid="ignore"):
            square = products[:, 5].sum(axis=1)
            white = np.maximum(square - np.sum(solution * right, axis=1), 0.0) / np.maximum(count - size, 1.0)
            offset, tilt, zero = solution.T[:, :, np.newaxis]
            # What the solution leaves of the right-hand sides, by band; order 0 alone has a zero-g offset.
            remainder = np.empty((len(determined), 3, bands))
            remainder[:, :2] = products[:, 3:5] - products[:, :2] * offset[:, np.newaxis]
            remainder[:, :2] -= products[:, 1:3] * tilt[:, np.newaxis]
            remainder[:, 1, 0] -= tilt_zero * zero[:, 0]
            remainder[:, 2] = 0.0
            remainder[:, 2, 0] = zero_right - tilt_zero * tilt[:, 0] - zero_zero * zero[:, 0]
            clustered = (
                np.square(inverse @ remainder).sum(axis=2) * (bands / np.maximum(bands - size, 1))[:, np.newaxis]
            )
            variance = np.maximum(np.diagonal(inverse, axis1=1, axis2=2) * white[:, np.newaxis], clustered)
            stds = np.sqrt(variance)
        solution[~determined] = stds[~determined] = math.nan
        return solution, stds

    def squared_residuals(self) -> FloatArray:
        """Return the sum of squares that the solution of each set leaves, (k,) m^2/s^4."""
        solution, right, *_ = self._solution()
        explained = np.sum(np.nan_to_num(solution) * right, axis=1)
        result: FloatArray = np.maximum(self._products[:, 5].sum(axis=1) - explained, 0.0)
        return result

    @property
    def _products(self) -> FloatArray:
        """(k, 6, bands) products of the factors of e and tilt with each other and with the left-hand side."""
        bands = len(_BANDS)
        return self.sums[:, : 6 * bands].reshape(-1, 6, bands)

    def _solution(self) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Return unknowns (k, 3), right-hand sides, inverses of the normal matrices, and which unknowns have equations.

        Unknowns without equations are 0.
        """
        tilt_zero, zero_zero, zero_right, _ = self.sums[:, -4:].T
        offset_offset, offset_tilt, tilt_tilt, offset_right, tilt_right, _ = self._products.sum(axis=2).T
        diagonal = np.array([offset_offset, tilt_tilt, zero_zero])
        determined = diagonal > 0.0
        # Without equations all products with an unknown are 0, so any scale of it gives 0.
        scale = 1.0 / np.sqrt(np.where(determined, diagonal, 1.0))
        # Inverse of the scaled normal matrix: order 0 has no factor of e, so one correlation is zero.
        with_tilt = offset_tilt * scale[0] * scale[1]
        with_zero = tilt_zero * scale[1] * scale[2]
        tilt_square, zero_square = with_tilt * with_tilt, with_zero * with_zero
        determinant = 1.0 - tilt_square - zero_square
        inverse = np.empty((3, 3, len(with_tilt)))
        inverse[0, 0] = 1.0 - zero_square
        inverse[0, 1] = inverse[1, 0] = -with_tilt
        inverse[0, 2] = inverse[2, 0] = with_tilt * with_zero
        inverse[1, 1] = 1.0
        inverse[1, 2] = inverse[2, 1] = -with_zero
        inverse[2, 2] = 1.0 - tilt_square
        inverse *= scale[:, np.newaxis] * (scale / np.where(determinant > 0.0, determinant, math.nan))
        right = np.array([offset_right, tilt_right, zero_right]).T
        matrices = np.ascontiguousarray(inverse.transpose(2, 0, 1))
        solution: FloatArray = (matrices @ right[:, :, np.newaxis])[:, :, 0]
        return solution, right, matrices, determined.T


def _solutions_by_numpy(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what `MountingRows.solve` does of sums (k, MOUNTING_SIZE)."""
    return MountingRows(sums, np.empty((len(sums), HUB_SIZE)))._solved()


def _solutions_by_core(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """As `_solutions_by_numpy`."""
    assert core is not None
    solutions, stds = np.empty((2, len(sums), 3))
    core.mounting_solutions(np.ascontiguousarray(sums), solutions, stds)
    return solutions, stds


solutions = _solutions_by_numpy if core is None else _solutions_by_core


def relative_curvature(radial_mps2: FloatArray, offset: float) -> FloatArray:
    """Return kappa R, (n,), of mean 1, from a waveform without gravity that includes its steady value.

    Args:
        radial_mps2: (n,) on the angle grid; its mean must be positive.
        offset: e / R.
    """
    signal = radial_mps2 / radial_mps2.mean()
    curvature = signal
    for _ in range(3 if offset else 0):
        # mean(s) = V^2/R (1 - offset mean(k^2)): the root that tends to the signal as the offset tends to 0.
        reading = signal * (1.0 - offset * float(np.square(curvature).mean()))
        curvature = 2.0 * reading / (1.0 + np.sqrt(np.maximum(1.0 - 4.0 * offset * reading, 0.0)))
    result: FloatArray = curvature / curvature.mean()
    return result


def belt_kinematics(radial_mps2: FloatArray, offset: float, centre_rad: float) -> BeltKinematics:
    """Return the kinematics of the belt, from a waveform without gravity that includes its steady value.

    Args:
        radial_mps2: (n,) on the angle grid; its mean must be positive.
        offset: e / R.
        centre_rad: angle of the contact's centre, where the belt lies flat.
    """
    curvature = relative_curvature(radial_mps2, offset)
    n = len(curvature)
    step = 2.0 * math.pi / n
    theta = angle_grid(n) - centre_rad
    cumulative = np.cumsum(curvature) - 0.5 * curvature
    inclination = (cumulative - float(np.interp(0.0, theta, cumulative))) * step
    cosine, sine = np.cos(inclination), np.sin(inclination)
    spectra = np.fft.rfft(np.stack([curvature, sine, 1.0 - cosine]), axis=1)[:, : HIGHEST_ORDER + 1] * (2.0 / n)
    # One Newton step suffices: order 1 is wrong only by a small residual of gravity.
    even = np.cos(theta)
    closing = float(cosine.sum()) / float(sine @ np.sin(theta))
    closed = curvature + closing * even
    signal = closed * (1.0 - offset * closed)
    return BeltKinematics(
        along=-1j * np.arange(HIGHEST_ORDER + 1.0) * spectra[0],
        inclination_rad=inclination,
        mean_square=float(np.square(curvature).mean()),
        signal_order_1=2.0 * float(signal @ even) / float(signal.sum()),
        gravity_order_1=2.0 / n * float(cosine @ even),
        known_spectra=spectra[1:],
    )


def mounting_rows(
    spectra_mps2: ComplexArray,
    belt: BeltKinematics,
    omega_radps: FloatArray,
    omega_dot_radps2: FloatArray,
    radius_m: float,
    order_max: IntArray,
    *,
    with_mean: bool = True,
) -> MountingRows:
    """Return the equations of k revolutions, one set each.

    Args:
        spectra_mps2: (k, 2, 61) of the circumferential and the radial axis as measured, in the angle domain: Fourier
            sums times 2 / n.
        belt: kinematics of the belt, from an average.
        omega_radps: (k,) mean angular speed.
        omega_dot_radps2: (k,) angular acceleration.
        radius_m: belt radius.
        order_max: (k,) highest order in the sampled band.
        with_mean: False omits order 0, for AC-coupled sensors.
    """
    return rows_of(spectra_mps2, belt, omega_radps, omega_dot_radps2, radius_m, order_max, with_mean)


def _rows_by_numpy(
    spectra_mps2: ComplexArray,
    belt: BeltKinematics,
    omega_radps: FloatArray,
    omega_dot_radps2: FloatArray,
    radius_m: float,
    order_max: IntArray,
    with_mean: bool,
) -> MountingRows:
    """Return the equations, as `mounting_rows`."""
    reaction = (omega_dot_radps2 * radius_m)[:, np.newaxis] * belt.known_spectra[1]
    remainder = spectra_mps2[:, 0] - STANDARD_GRAVITY_MPS2 * belt.known_spectra[0] - reaction
    by_tilt = spectra_mps2[:, 1].copy()
    by_offset = np.square(omega_radps)[:, np.newaxis] * belt.along
    # The mean is one equation; every other order is two, of the same weight.
    count = np.minimum(HIGHEST_ORDER, order_max) + 1
    weights = (np.arange(HIGHEST_ORDER + 1) < count[:, np.newaxis]).astype(np.float64)
    weights[:, 0] = math.sqrt(0.5) if with_mean else 0.0
    hub = np.empty((len(remainder), HUB_SIZE))
    for index, factor in enumerate((remainder, by_offset, by_tilt)):
        hub[:, index], hub[:, index + 3] = factor[:, HUB_ORDER].real, factor[:, HUB_ORDER].imag
    hub[:, -1] = 1.0
    weights[:, HUB_ORDER] = 0.0
    remainder *= weights
    by_tilt *= weights
    by_offset = by_offset * weights
    pairs = (
        (by_offset, by_offset),
        (by_offset, by_tilt),
        (by_tilt, by_tilt),
        (by_offset, remainder),
        (by_tilt, remainder),
    )
    products = np.empty((len(remainder), 6, HIGHEST_ORDER + 1))
    for row, (first, second) in enumerate((*pairs, (remainder, remainder))):
        products[:, row] = first.real * second.real
        products[:, row] += first.imag * second.imag
    sums = np.empty((len(remainder), MOUNTING_SIZE))
    sums[:, :-4] = np.add.reduceat(products, _BANDS, axis=2).reshape(len(remainder), -1)
    zero_factor = 2.0 * weights[:, 0]
    sums[:, -4] = by_tilt[:, 0].real * zero_factor
    sums[:, -3] = zero_factor**2
    sums[:, -2] = remainder[:, 0].real * zero_factor
    sums[:, -1] = 2 * count - 1 - (not with_mean) - 2 * (count > HUB_ORDER)
    return MountingRows(sums, hub)


def _rows_by_core(
    spectra_mps2: ComplexArray,
    belt: BeltKinematics,
    omega_radps: FloatArray,
    omega_dot_radps2: FloatArray,
    radius_m: float,
    order_max: IntArray,
    with_mean: bool,
) -> MountingRows:
    """As `_rows_by_numpy`."""
    assert core is not None
    count = len(spectra_mps2)
    sums, hub = np.empty((count, MOUNTING_SIZE)), np.empty((count, HUB_SIZE))
    spectra, along_spectra, predicted = (
        np.ascontiguousarray(spectrum).view(np.float64) for spectrum in (spectra_mps2, belt.along, belt.known_spectra)
    )
    highest = order_max.astype(np.float64)
    rates = np.ascontiguousarray(omega_radps), np.ascontiguousarray(omega_dot_radps2)
    core.mounting_rows(
        spectra, along_spectra, predicted, *rates, radius_m, highest, with_mean, STANDARD_GRAVITY_MPS2, sums, hub
    )
    return MountingRows(sums, hub)


rows_of = _rows_by_numpy if core is None else _rows_by_core


def offset_by_yaw_m(axes_mps2: FloatArray, belt: BeltKinematics, square_radps2: float, order_max: int) -> float:
    """Return how much a yaw of the sensor, as a sine, changes the mounting offset that the equations give.

    A yaw mixes the lateral axis into the circumferential one: its part with the shape of an offset.

    Args:
        axes_mps2: (3, n) average over revolutions on the angle grid, circumferential, lateral and radial.
        belt: kinematics of the belt.
        square_radps2: mean square of the angular speed of these revolutions.
        order_max: highest order that the sampling carries.

    Returns:
        The change in m; 0 without a lateral axis.
    """
    if not np.isfinite(axes_mps2[1:]).all():
        return 0.0
    orders = np.delete(np.arange(1, min(HIGHEST_ORDER, order_max) + 1), HUB_ORDER - 1)
    lateral, radial = np.fft.rfft(axes_mps2[1:], axis=1)[:, orders] * (2.0 / axes_mps2.shape[1])
    factors = np.array([square_radps2 * belt.along[orders], radial])
    normal = (factors @ factors.conj().T).real
    right = (factors @ lateral.conj()).real
    determinant = normal[0, 0] * normal[1, 1] - normal[0, 1] ** 2
    if not determinant > 1e-9 * normal[0, 0] * normal[1, 1]:
        return 0.0
    return float(normal[1, 1] * right[0] - normal[0, 1] * right[1]) / float(determinant)


def yaw_by_shape(
    axes_mps2: FloatArray, belt: BeltKinematics, square_radps2: float, reaction_mps2: float, order_max: int
) -> tuple[float, float]:
    """Return the yaw of the sensor by which the lateral axis is in the circumferential one, and its standard error.

    With c along the belt, of known shape, a sensor that is turned by the yaw a about its radial axis reads c / cos(a) -
    l tan(a) where its lateral axis reads l. Depth, pitch and the size of gravity are fitted with it. The error is that
    of white residuals or of the disagreement of the bands, as that of `MountingRows`, with what the equations do not
    describe; NaN where they do not tell.

    Args:
        axes_mps2: (3, n) average over revolutions on the angle grid, circumferential, lateral and radial.
        belt: kinematics of the belt.
        square_radps2: mean square of the angular speed of these revolutions.
        reaction_mps2: their mean angular acceleration times the belt radius.
        order_max: highest order that the sampling carries.
    """
    count = min(HIGHEST_ORDER, order_max)
    if count < _YAW_ORDERS or not np.isfinite(axes_mps2).all():
        return math.nan, math.nan
    orders = np.delete(np.arange(1, count + 1), HUB_ORDER - 1)
    spectra = np.fft.rfft(axes_mps2, axis=1)[:, orders] * (2.0 / axes_mps2.shape[1])
    predicted = STANDARD_GRAVITY_MPS2 * belt.known_spectra[0] + reaction_mps2 * belt.known_spectra[1]
    rows = np.stack([spectra[0], spectra[1], square_radps2 * belt.along[orders], spectra[2], predicted[orders]])
    circumferential, lateral, *fitted = np.concatenate([rows.real, rows.imag], axis=1)
    basis, triangle = np.linalg.qr(np.array(fitted).T)
    if not np.abs(np.diagonal(triangle)).min() > 0.0:
        return math.nan, math.nan
    circumferential, lateral = (axis - basis @ (basis.T @ axis) for axis in (circumferential, lateral))
    lateral_square = float(lateral @ lateral)
    if not lateral_square > 0.0:
        return math.nan, math.nan
    tangent = -float(lateral @ circumferential) / lateral_square
    remainder = circumferential + tangent * lateral
    band_sums = np.bincount(np.searchsorted(_BANDS, np.tile(orders, 2), side="right"), weights=lateral * remainder)
    band_count = max(int(np.count_nonzero(band_sums)), 5)
    clustered = float(np.square(band_sums).sum()) * band_count / (band_count - 4) / lateral_square**2
    white = float(remainder @ remainder) / (len(remainder) - 4) / lateral_square
    return math.atan(tangent), math.hypot(math.sqrt(max(clustered, white)), _YAW_MODEL_RAD)


def hub_motion_mps2(hub: FloatArray, offset_m: FloatArray, tilt: FloatArray) -> FloatArray:
    """Return the order 2 of the circumferential axis that neither the belt nor the mounting explains, (k,) m/s^2.

    A hub that moves by a cos(Omega t) along any direction adds a / 2 to orders 0 and 2 of both axes in the plane of the
    wheel, and so does what else turns unevenly. On a belt that rolls steadily it is below 1.5e-4 R Omega^2.

    Args:
        hub: (k, HUB_SIZE) sums of `MountingRows.hub`.
        offset_m: (k,) sensor below the neutral layer.
        tilt: (k,) tangent of the pitch.
    """
    remainder = hub[:, 0:6:3] - offset_m[:, np.newaxis] * hub[:, 1:6:3] - tilt[:, np.newaxis] * hub[:, 2:6:3]
    result: FloatArray = np.hypot(remainder[:, 0], remainder[:, 1]) / np.maximum(hub[:, 6], 1.0)
    return result


# Normal matrix ((aa, ab), (ab, bb)) of tilt and offset, and its right-hand side (a, b).
_Sums = tuple[float, float, float, float, float]
_NO_SUMS: Final = (0.0, 0.0, 0.0, 0.0, 0.0)


class RollCalibration:
    """Roll tilt of a sensor: fit of mean(lateral) = tan(roll) mean(radial) + offset, with a prior on the offset.

    Over a closed belt the lateral displacement adds nothing to the mean, and the radial mean is R Omega^2. At a single
    speed the tilt is as accurate as the offset is known (1 m/s^2 at 65 km/h is 0.06 deg). Revolutions at different
    speeds separate the two, as far as road and curves allow: these last, so that groups of revolutions have a constant
    in common, as large as bank or as what the group is off by. Old revolutions are forgotten exponentially, so the fit
    follows temperature. What the latest are off by, beyond a curve, is in the error of the tilt: the sensor has moved.

    Attributes:
        roll_rad: best estimate of the tilt, 0 before the first revolution; `roll_std_rad` its standard error.
        offset_mps2: of the constant in the lateral mean; `offset_std_mps2` its error, that of the prior at one speed.
        count: revolutions.
    """

    def __init__(self, offset_std_mps2: float = OFFSET_STD_MPS2, horizon_revolutions: float = 500.0) -> None:
        """Start at no tilt and no offset.

        Args:
            offset_std_mps2: prior standard error of the constant in the lateral mean.
            horizon_revolutions: length of the memory in revolutions.
        """
        self._roll_weight = math.tan(_ROLL_PRIOR_STD_RAD) ** -2
        self._offset_std_mps2 = offset_std_mps2
        self._retention = 1.0 - 1.0 / horizon_revolutions
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        # Of the groups before, weighted, and of the latest group; squares of what its revolutions are off.
        self._sums, self._group, self._residual_squares = _NO_SUMS, _NO_SUMS, 0.0
        self.count = 0
        self.roll_rad, self.roll_std_rad, self.offset_mps2 = 0.0, MOUNTING_STD_RAD, 0.0
        self.offset_std_mps2 = self._offset_std_mps2
        # Mean residual of the latest revolutions over the radial mean.
        self._latest_rad = 0.0

    def expect_offset(self, std_mps2: float) -> None:
        """Change the prior standard error of the constant, from the next revolution on."""
        self._offset_std_mps2 = std_mps2

    def update(self, mean_lateral_mps2: float, mean_radial_mps2: float, std_mps2: float = 0.0) -> None:
        """Add the means of one revolution as measured; ignored if the radial mean is not positive (AC coupling).

        Args:
            mean_lateral_mps2: without the lateral acceleration of a curve, as far as that is known.
            mean_radial_mps2: of the radial axis.
            std_mps2: standard error of that acceleration.
        """
        if not (math.isfinite(mean_lateral_mps2) and mean_radial_mps2 > 0.0):
            return
        if self.count % _GROUP_REVOLUTIONS == 0:
            self._sums, self._group, self._residual_squares = self._all_sums(), _NO_SUMS, 0.0
        retention, x, y = self._retention, mean_radial_mps2, mean_lateral_mps2
        aa, ab, bb, a, b = self._sums
        self._sums = retention * aa, retention * ab, retention * bb, retention * a, retention * b
        aa, ab, bb, a, b = self._group
        self._group = aa + x * x, ab + x, bb + 1.0, a + x * y, b + y
        residual_mps2 = min(abs(self._residual_mps2(x, y)), _CURVE_MPS2) if self.count else 0.0
        self._residual_squares += residual_mps2**2 + std_mps2**2
        self.count += 1
        aa, ab, bb, a, b = self._all_sums()
        std = self._offset_std_mps2
        # Revolutions at different speeds give the constant without a prior. Where it contradicts the prior, its own
        # size takes the prior's place.
        spread = aa * bb - ab * ab
        if spread > _LEAST_SPREAD * aa * bb:
            free_offset = (aa * b - ab * a) / spread
            contradicts = abs(free_offset) > _CONTRADICTION * math.hypot(math.sqrt(aa / spread), std)
            # One that no sensor has is none: a few means do not belong to their speeds.
            if contradicts and abs(free_offset) <= LARGEST_ZERO_MPS2:
                std = abs(free_offset)
        aa += self._roll_weight
        bb += std**-2
        determinant = aa * bb - ab * ab
        self.roll_rad = math.atan((bb * a - ab * b) / determinant)
        self.offset_mps2 = (aa * b - ab * a) / determinant
        self._latest_rad += (self._residual_mps2(x, y) / x - self._latest_rad) / min(self.count, _LATEST_REVOLUTIONS)
        shift_rad = max(abs(self._latest_rad) - _CURVE_MPS2 / x, 0.0)
        # What no sensor has of the constant is of the tilt.
        excess_offset_rad = max(abs(self.offset_mps2) - LARGEST_ZERO_MPS2, 0.0) / x
        self.roll_std_rad = math.hypot(math.sqrt(bb / determinant), shift_rad, excess_offset_rad)
        self.offset_std_mps2 = math.sqrt(aa / determinant)

    def _residual_mps2(self, radial_mps2: float, lateral_mps2: float) -> float:
        """Return what a lateral mean is off the fit."""
        return lateral_mps2 - self.offset_mps2 - math.tan(self.roll_rad) * radial_mps2

    def _all_sums(self) -> _Sums:
        """Return the sums with those of the latest group, whose revolutions have a constant of the road in common."""
        aa, ab, bb, a, b = self._group
        if not bb:
            return self._sums
        residual_square = self._residual_squares / bb
        weight, variance = 1.0 / (REVOLUTION_STD_MPS2**2 + residual_square), BANK_MPS2**2 + residual_square
        common = weight * variance / (1.0 + weight * variance * bb)
        taa, tab, tbb, ta, tb = self._sums
        return (
            taa + weight * (aa - common * ab * ab),
            tab + weight * (ab - common * ab * bb),
            tbb + weight * (bb - common * bb * bb),
            ta + weight * (a - common * ab * b),
            tb + weight * (b - common * bb * b),
        )
