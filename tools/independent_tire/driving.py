"""Specific force of a sensor on a wheel that drives a course: its positions in space, differentiated twice.

Nothing here knows Coriolis terms, orders or an angular acceleration. A place of the belt is a point that moves in
space; the force is the second derivative of its position and the reaction to gravity, along axes that move with it.
"""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import make_interp_spline

from independent_tire.elements import COORDINATES, Array
from independent_tire.sensor import GRAVITY_MPS2
from independent_tire.sideways import Sides, bend_sideways
from independent_tire.steady import SteadyBelt

# Positions for each sample, and the central second difference of eighth order.
OVERSAMPLED: Final = 2
_DIFFERENCE: Final = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
MARGIN: Final = len(_DIFFERENCE) // 2
_FINE: Final = 4096
_PERIODS: Final = 8


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Motion of a vehicle's middle at (n,) equal steps.

    Attributes:
        step_s: of time.
        speed_mps: along the path.
        heading_rad: of the path, positive to the left.
        slip_rad: of the wheel: it heads to the left of its path where positive.
        camber_rad: of the wheel on its road, positive where the left side is up.
        grade_rad: of the path, positive uphill.
        bank_rad: of the road, positive where its left side is up.
        lift_m: of the hub above its path; None for none.
        spin_share: by which the wheel turns faster than it rolls; None for none.
    """

    step_s: float
    speed_mps: Array
    heading_rad: Array
    slip_rad: Array
    camber_rad: Array
    grade_rad: Array
    bank_rad: Array
    lift_m: Array | None = None
    spin_share: Array | None = None

    def straight(self) -> Self:
        """Return the course with the same tire on a level, straight road."""
        none = np.zeros_like(self.speed_mps)
        return type(self)(self.step_s, self.speed_mps, none, self.slip_rad, none, none, none)


class DrivenTire:
    """A steadily rolling belt, bent sideways by slip angles in between those it was solved for."""

    def __init__(self, steady: SteadyBelt, sides: Sides, slips_rad: Array, offset_m: float) -> None:
        """Solve it; `slips_rad` are four or more that grow, the sensor is `offset_m` below the belt's middle line."""
        self.steady = steady
        nodes = steady.coordinates.reshape(-1, COORDINATES) @ np.array([[1, 0], [1j, 0], [0, 1], [0, 1j]])
        slope = nodes[:, 1]
        belt = _integral(steady.belt.radius_m * slope) + nodes[:, 0].mean()
        along = slope / np.abs(slope)
        shapes = [bend_sideways(steady, sides, float(slip)) for slip in slips_rad]
        self.forces_n = np.array([shape.side_force_n for shape in shapes])
        sideways = [_integral(_integral(shape.lateral_m)).real + shape.y_m.mean() for shape in shapes]
        angles = 2.0 * np.pi * np.arange(-_PERIODS, _FINE + _PERIODS + 1) / _FINE - np.pi
        curves = [_fine(curve) for curve in (belt + 1j * offset_m * along, along)]
        stacked = np.stack([part for curve in curves for part in (curve.real, curve.imag)])
        self._planar = make_interp_spline(angles, stacked.T, k=5)
        bent = np.stack([_fine(curve.astype(np.complex128)).real for curve in sideways], axis=1)
        self._sideways = make_interp_spline(angles, bent, k=5)
        # Cubic between the slip angles.
        self._weights = make_interp_spline(slips_rad, np.eye(len(slips_rad)), k=3)

    def at(self, angle_rad: Array, slip_rad: Array) -> tuple[Array, Array]:
        """Return the place and the direction of travel in the wheel, (3, n) each: forward, left, up."""
        angle = np.mod(angle_rad + np.pi, 2.0 * np.pi) - np.pi
        back, up, travel_back, travel_up = self._planar(angle).T
        leftward = np.sum(self._sideways(angle) * self._weights(slip_rad), axis=1)
        return np.stack([-back, leftward, up]), np.stack([-travel_back, np.zeros_like(up), travel_up])

    def felt(self, course: Course, left_m: float, *, paced_by: Course | None = None) -> tuple[Array, Array, Array]:
        """Return what a sensor reads, (m, 3) circumferential, lateral and radial in m/s^2, and angle and yaw rate.

        Args:
            course: with `MARGIN` steps more than the samples at both ends.
            left_m: of the wheel from the vehicle's middle.
            paced_by: course whose angle of rotation the wheel has; None for its own.
        """
        step = course.step_s
        hub = _hub(course, left_m)
        pace = hub if paced_by is None else _hub(paced_by, left_m)
        speed = np.linalg.norm(np.gradient(pace, step, axis=1, edge_order=2), axis=0)
        if course.spin_share is not None:
            speed = speed * (1.0 + course.spin_share)
        rolling = self.steady.belt.radius_m * self.steady.road_share
        angle = cumulative_trapezoid(speed / rolling, dx=step, initial=0.0) - 0.7 * np.pi
        position_in_wheel, travel = self.at(angle, course.slip_rad)
        yaw = course.heading_rad + (course.slip_rad if paced_by is None else 0.0)
        axes = _axes(yaw, course.grade_rad, course.camber_rad + course.bank_rad)
        position = hub + np.einsum("ijn,jn->in", axes, position_in_wheel)
        width = len(position[0]) - 2 * MARGIN
        acceleration = sum(factor * position[:, index : index + width] for index, factor in enumerate(_DIFFERENCE)) / (
            step**2
        )
        acceleration[2] += GRAVITY_MPS2
        inner = slice(MARGIN, -MARGIN)
        travel, axes = travel[:, inner], axes[:, :, inner]
        inward = np.stack([travel[2], travel[1], -travel[0]])
        in_wheel = np.einsum("ijn,in->jn", axes, acceleration)
        felt = np.stack([np.sum(in_wheel * travel, axis=0), in_wheel[1], np.sum(in_wheel * inward, axis=0)], axis=1)
        rate = np.gradient(yaw, step)[inner]
        return felt[::OVERSAMPLED], angle[inner][::OVERSAMPLED], rate[::OVERSAMPLED]


def _hub(course: Course, left_m: float) -> Array:
    """Return the places of a hub, (3, n)."""
    level = np.cos(course.grade_rad)
    cosine, sine = np.cos(course.heading_rad), np.sin(course.heading_rad)
    velocity = course.speed_mps * np.stack([cosine * level, sine * level, np.sin(course.grade_rad)])
    places: Array = cumulative_trapezoid(velocity, dx=course.step_s, axis=1, initial=0.0)
    places[0] -= left_m * sine
    places[1] += left_m * cosine
    if course.lift_m is not None:
        places[2] += course.lift_m
    return places


def _axes(yaw: Array, grade: Array, roll: Array) -> Array:
    """Return the wheel's forward, left and upward axes in space, (3, 3, n): columns."""
    cy, sy, cg, sg, cr, sr = np.cos(yaw), np.sin(yaw), np.cos(grade), np.sin(grade), np.cos(roll), np.sin(roll)
    forward = [cy * cg, sy * cg, sg]
    level = [-sy, cy, np.zeros_like(yaw)]
    normal = [-cy * sg, -sy * sg, cg]
    leftward = [cr * a + sr * b for a, b in zip(level, normal, strict=True)]
    up = [cr * b - sr * a for a, b in zip(level, normal, strict=True)]
    return np.array([forward, leftward, up]).transpose(1, 0, 2)


def _integral(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the periodic integral by the angle of a curve (N,), without its mean."""
    order = np.fft.fftfreq(len(values), 1.0 / len(values))
    order[0] = 1.0
    spectrum = np.fft.fft(values) / (1j * order)
    spectrum[0] = spectrum[len(values) // 2] = 0.0
    integral: NDArray[np.complex128] = np.fft.ifft(spectrum)
    return integral


def _fine(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return a periodic curve (N,) on the fine grid, with some of the next periods at its ends."""
    half = len(values) // 2
    spectrum = np.fft.fft(values)
    wide = np.zeros(_FINE, dtype=np.complex128)
    wide[:half], wide[-half + 1 :] = spectrum[:half], spectrum[-half + 1 :]
    fine = np.fft.ifft(wide) * _FINE / len(values)
    return np.concatenate([fine[-_PERIODS:], fine, fine[: _PERIODS + 1]])
