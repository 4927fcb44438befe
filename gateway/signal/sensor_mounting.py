"""Mounting of a sensor in the tire: offset below the neutral layer, pitch tilt and roll tilt.

Offset and pitch come from the circumferential axis. On an inextensible belt that rolls steadily, a sensor e below the
neutral layer reads s = V^2 kappa (1 - e kappa) inward and -e Omega^2 d(kappa R)/dtheta along the belt. A pitch tilt
mixes the radial axis into the circumferential one. Gravity along the belt and the reaction to angular acceleration are
known. Given kappa, all of this is linear in e, the tilt and the zero-g offset, and kappa depends on e to second order
only.

Roll comes from the means of the lateral and radial axes (`RollCalibration`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.signal.angle_resampling import angle_grid
from gateway.types import ComplexArray, FloatArray

# Highest order used: above it there is noise but no signal of a tire's slope.
HIGHEST_ORDER: Final = 60
# First orders of the bands whose disagreement shows what the equations do not describe.
_BANDS: Final = (0, 2, 4, 6, 9, 13, 18, 24, 31, 39, 48)

# Prior of the constant in the mean of the lateral axis: zero-g offset after the calibration in the hello (0.1 g) and
# gravity times camber (1 m/s^2 is 6 deg).
OFFSET_STD_MPS2: Final = 1.0
# Deviation of the mean of one revolution: cornering, crossfall, noise.
REVOLUTION_STD_MPS2: Final = 0.5
# Accuracy of mounting by hand. It stays the standard error when the means are lost (AC coupling).
MOUNTING_STD_RAD: Final = math.radians(1.0)
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
    """

    along: ComplexArray
    inclination_rad: FloatArray
    mean_square: float
    signal_order_1: float
    gravity_order_1: float


@dataclass(frozen=True, slots=True)
class MountingRows:
    """Linear equations of (e in m, tan of the pitch, zero-g offset in m/s^2), summed by bands of orders.

    Attributes:
        normal: (k, 3, 3) normal matrix of each band; the third row and column are zero without the mean.
        right: (k, 3) right-hand side.
        square: sum of squares of the left-hand side.
        count: number of equations.
    """

    normal: FloatArray
    right: FloatArray
    square: float
    count: float

    def and_then(self, other: MountingRows, keep: float) -> MountingRows:
        """Return these equations, weighted with `keep`, combined with others for the same unknowns."""
        return MountingRows(
            keep * self.normal + other.normal,
            keep * self.right + other.right,
            keep * self.square + other.square,
            keep * self.count + other.count,
        )

    def solve(self) -> tuple[FloatArray, FloatArray]:
        """Return the unknowns and their standard errors, (3,) each; NaN for unknowns without equations.

        The errors are the larger of two: those of white residuals, and those from the disagreement of the bands
        (cluster-robust covariance). The second does not shrink with the number of revolutions where the residual
        repeats, as that of a tread does.
        """
        solution, stds = np.full((2, 3), math.nan)
        total, right = self.normal.sum(axis=0), self.right.sum(axis=0)
        known = np.diag(total) > 0.0
        size = int(known.sum())
        scale = 1.0 / np.sqrt(np.diag(total)[known])
        scaling = np.outer(scale, scale)
        try:
            inverse = np.linalg.inv(total[np.ix_(known, known)] * scaling) * scaling
        except np.linalg.LinAlgError:
            return solution, stds
        solution[known] = inverse @ right[known]
        white = max(self.square - float(solution[known] @ right[known]), 0.0) / max(self.count - size, 1.0)
        left = self.right[:, known] - self.normal[:, known][:, :, known] @ solution[known]
        bands = len(self.normal)
        by_band = inverse @ left.T
        clustered = np.sum(np.square(by_band), axis=1) * (bands / max(bands - size, 1.0))
        stds[known] = np.sqrt(np.maximum(np.diag(inverse) * white, clustered))
        return solution, stds


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
        read = signal * (1.0 - offset * float(np.square(curvature).mean()))
        curvature = 2.0 * read / (1.0 + np.sqrt(np.maximum(1.0 - 4.0 * offset * read, 0.0)))
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
    turn = np.cumsum(curvature) - 0.5 * curvature
    inclination = (turn - float(np.interp(0.0, theta, turn))) * step
    cosine, sine = np.cos(inclination), np.sin(inclination)
    spectrum = np.fft.rfft(curvature)[: HIGHEST_ORDER + 1] * (2.0 / n)
    # One Newton step suffices: order 1 is wrong only by a small residual of gravity.
    closing = float(cosine.sum()) / float(sine @ np.sin(theta))
    closed = curvature + closing * np.cos(theta)
    signal = closed * (1.0 - offset * closed)
    return BeltKinematics(
        along=-1j * np.arange(HIGHEST_ORDER + 1.0) * spectrum,
        inclination_rad=inclination,
        mean_square=float(np.square(curvature).mean()),
        signal_order_1=2.0 * float(signal @ np.cos(theta)) / float(signal.sum()),
        gravity_order_1=2.0 / n * float(cosine @ np.cos(theta)),
    )


def mounting_rows(
    circumferential_mps2: FloatArray,
    radial_mps2: FloatArray,
    belt: BeltKinematics,
    omega_radps: float,
    omega_dot_radps2: float,
    radius_m: float,
    order_max: int,
    *,
    with_mean: bool = True,
) -> MountingRows:
    """Return the equations of one revolution.

    Args:
        circumferential_mps2: (n,) as measured, on the angle grid.
        radial_mps2: (n,) as measured.
        belt: kinematics of the belt, from an average.
        omega_radps: mean angular speed.
        omega_dot_radps2: angular acceleration.
        radius_m: belt radius.
        order_max: highest order in the sampled band.
        with_mean: False omits order 0, for AC-coupled sensors.
    """
    n = len(radial_mps2)
    angle = belt.inclination_rad
    known = STANDARD_GRAVITY_MPS2 * np.sin(angle) + omega_dot_radps2 * radius_m * (1.0 - np.cos(angle))
    count = min(HIGHEST_ORDER, order_max) + 1
    measured = np.fft.rfft(np.stack([circumferential_mps2 - known, radial_mps2]), axis=1)[:, :count] * (2.0 / n)
    rows = np.zeros((4, count), np.complex128)
    rows[:2] = measured
    rows[2] = omega_radps**2 * belt.along[:count]
    rows[3, 0] = 2.0
    # The mean is one equation; every other order is two, of the same weight.
    rows[:, 0] *= math.sqrt(0.5) if with_mean else 0.0
    begins = [begin for begin in _BANDS if begin < count]
    products = np.add.reduceat((rows[:, np.newaxis] * rows.conj()).real, begins, axis=2)
    products = np.concatenate([products, np.zeros((4, 4, len(_BANDS) - len(begins)))], axis=2).transpose(2, 0, 1)
    order = [2, 1, 3]
    return MountingRows(
        products[:, order][:, :, order],
        products[:, order, 0],
        float(products[:, 0, 0].sum()),
        2 * count - 1 - (not with_mean),
    )


class RollCalibration:
    """Roll tilt of a sensor: fit of mean(lateral) = tan(roll) mean(radial) + offset, with a prior on the offset.

    Over a closed belt the lateral displacement adds nothing to the mean, and the radial mean is R Omega^2. At a single
    speed the tilt is as accurate as the offset is known (1 m/s^2 at 65 km/h is 0.06 deg). Revolutions at different
    speeds separate the two. Old revolutions are forgotten exponentially, so the fit follows temperature.
    """

    def __init__(self, offset_std_mps2: float = OFFSET_STD_MPS2, horizon_revolutions: float = 500.0) -> None:
        """Start at no tilt and no offset.

        Args:
            offset_std_mps2: prior standard error of the constant in the lateral mean.
            horizon_revolutions: length of the memory in revolutions.
        """
        self._prior = np.diag([math.tan(_ROLL_PRIOR_STD_RAD) ** -2, offset_std_mps2**-2])
        self._keep = 1.0 - 1.0 / horizon_revolutions
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._information = np.zeros((2, 2))
        self._weighted = np.zeros(2)
        self.count = 0
        self._roll_rad, self._roll_std_rad, self._offset_mps2 = 0.0, MOUNTING_STD_RAD, 0.0

    def update(self, mean_lateral_mps2: float, mean_radial_mps2: float) -> None:
        """Add the means of one revolution as measured; ignored if the radial mean is not positive (AC coupling)."""
        if not (math.isfinite(mean_lateral_mps2) and mean_radial_mps2 > 0.0):
            return
        row = np.array([mean_radial_mps2, 1.0]) / REVOLUTION_STD_MPS2
        self._information = self._keep * self._information + np.outer(row, row)
        self._weighted = self._keep * self._weighted + row * (mean_lateral_mps2 / REVOLUTION_STD_MPS2)
        self.count += 1
        (aa, ab), (_, bb) = self._information + self._prior
        determinant = aa * bb - ab * ab
        a, b = self._weighted
        self._roll_rad = math.atan((bb * a - ab * b) / determinant)
        self._roll_std_rad = math.sqrt(bb / determinant)
        self._offset_mps2 = float((aa * b - ab * a) / determinant)

    @property
    def roll_rad(self) -> float:
        """Best estimate of the tilt; 0 before the first revolution."""
        return self._roll_rad

    @property
    def roll_std_rad(self) -> float:
        """Standard error of the tilt."""
        return self._roll_std_rad

    @property
    def offset_mps2(self) -> float:
        """Best estimate of the constant in the lateral mean."""
        return self._offset_mps2
