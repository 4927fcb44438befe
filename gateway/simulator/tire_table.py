"""A tire's waveform over load, pressure, speed and slip angle: solved at a few points, interpolated between them."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.types import FloatArray
from gateway.ring.polynomial_weights import polynomial_weights
from gateway.ring.ring_series import signal_orders, signal_waveform
from gateway.ring.rolling_ring import RingSolution
from gateway.ring.rolling_ring.sensor_waveform import angle_derivatives
from gateway.simulator.tire_model import TireModel

# Step of load for the tire's vertical stiffness.
_LOAD_STEP = 0.02
# Of Eq. 27, whose series falls with the third power of the order.
_LINEAR_ORDERS = 200
# Shares of the load's swing by run-out at which the tire is solved: extrema of a polynomial that is nowhere far off.
# The stiffness rises with the deflection, so the swing is somewhat larger than by the stiffness at the mean load.
_SWING: Final = 1.05 * np.array([-1.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5), 1.0])


@dataclass(frozen=True, slots=True)
class SolvedPoint:
    """A tire solved under one set of conditions, on the table's angles.

    Attributes:
        ring: the solution.
        planar: (angles, columns) of the ring's waveform, radial shape first.
        lateral: (angles, slips) lateral shapes.
        edges_rad: (2,) leading and trailing contact angle.
    """

    ring: RingSolution
    planar: FloatArray
    lateral: FloatArray
    edges_rad: FloatArray


def with_runout(
    solve: Callable[[float], SolvedPoint], load_n: float, height_m: float, offset_rad: float
) -> SolvedPoint:
    """Return a tire whose radius is larger by height cos(psi) at material angle psi from its high spot.

    The axle stays at its height, so the tire is deflected by more where the high spot meets the road; the sensor meets
    the road with the same deflection each time, between those under the loads of `_SWING`. Off the contact it rides on
    the eccentric circle's radius.

    Args:
        solve: the round tire under a load.
        load_n: mean load.
        height_m: of the high spot.
        offset_rad: material angle from the sensor to the high spot.
    """
    middle = solve(load_n)
    pressed = solve(load_n * (1.0 + _LOAD_STEP))
    stiffness_npm = _LOAD_STEP * load_n / (middle.ring.axle_height_m - pressed.ring.axle_height_m)
    swing_n = stiffness_npm * height_m
    points = [solve(load_n + swing_n * share) if share else middle for share in _SWING.tolist()]
    theta = np.linspace(-math.pi, math.pi, len(middle.planar))
    lower_m = np.array([middle.ring.axle_height_m - point.ring.axle_height_m for point in points])
    weights = _clamped_weights(lower_m, height_m * np.cos(theta + offset_rad))
    at_edges = _clamped_weights(lower_m, height_m * np.cos(middle.edges_rad + offset_rad))
    planar = np.einsum("tp,ptc->tc", weights, np.stack([point.planar for point in points]))
    planar[:, 0] *= 1.0 + height_m / middle.ring.ring.radius_m * math.cos(offset_rad)
    return SolvedPoint(
        middle.ring,
        planar,
        np.einsum("tp,pts->ts", weights, np.stack([point.lateral for point in points])),
        np.einsum("ep,pe->e", at_edges, np.stack([point.edges_rad for point in points])),
    )


WaveformTable = NDArray[np.float32]
"""(TABLE_ANGLES + 1, COLUMNS) over theta = -pi + 2 pi i / TABLE_ANGLES; the last row is the first. Single precision
is 1e-7 of the signal, far below any sensor's noise, and half the memory to go through."""

TABLE_ANGLES = 8192
COLUMNS = 7
"""Radial, circumferential shape; radial, circumferential gravity; radial, circumferential spin; lateral shape."""
LATERAL = COLUMNS - 1


class Range(NamedTuple):
    """Smallest and largest value of a quantity."""

    low: float
    high: float


NO_SLIP = Range(0.0, 0.0)


class TireTable:
    """Waveforms of one tire over ranges of load, pressure, angular speed and slip; polynomial in each that varies."""

    def __init__(
        self,
        tire: TireModel,
        load_n: Range,
        pressure_pa: Range,
        omega_radps: Range,
        slip_angle_rad: Range = NO_SLIP,
    ) -> None:
        """Solve the tire at every point of the grid.

        Raises:
            ValueError: a condition is out of range.
            RingNotConvergedError: the ring has no equilibrium somewhere in the ranges.
            BrushNotConvergedError: nor has its tread under slip.
        """
        self.tire = tire
        if not tire.depends_on_speed:
            # Without damping the shape is the same at every speed; the middle one only fixes the belt's tension.
            omega_radps = Range(*(0.5 * (omega_radps.low + omega_radps.high),) * 2)
        self._axes = tuple(_nodes(Range(*extent)) for extent in (load_n, pressure_pa, omega_radps))
        self._slips = _slip_nodes(slip_angle_rad)
        shape = tuple(len(axis) for axis in self._axes)
        points = math.prod(shape)
        self._planar = np.empty((points, (TABLE_ANGLES + 1) * LATERAL), np.float32)
        # Slip bends the belt laterally only, so the planar columns need no table for it.
        self._lateral = np.empty((points * len(self._slips), TABLE_ANGLES + 1), np.float32)
        self._edges = np.empty((points, 2))
        start: RingSolution | None = None
        for row, indices in enumerate(np.ndindex(*shape)):
            load, pressure, omega = (float(axis[i]) for axis, i in zip(self._axes, indices, strict=True))
            point = self._point(load, pressure, omega, start)
            start = point.ring
            self._planar[row] = point.planar.reshape(-1)
            self._lateral[row * len(self._slips) : (row + 1) * len(self._slips)] = point.lateral.T
            self._edges[row] = point.edges_rad

    def _point(self, load_n: float, pressure_pa: float, omega_radps: float, start: RingSolution | None) -> SolvedPoint:
        """Return the tire under one set of conditions, run-out included."""

        def solve(load_n: float) -> SolvedPoint:
            ring = self.tire.solve(load_n, pressure_pa, omega_radps, start)
            lateral = [self.tire.solve_lateral(ring, float(slip)).lateral_m for slip in self._slips]
            edges = np.array([ring.leading_edge_rad, ring.trailing_edge_rad])
            planar = self._fine(ring)
            half_angle_rad = self.tire.linear_half_angle_rad
            if half_angle_rad is not None:
                edges = np.array([-half_angle_rad, half_angle_rad])
                planar[:, :2] = self._linear(load_n, pressure_pa, half_angle_rad)
            return SolvedPoint(ring, planar, _interpolated(np.stack(lateral, axis=1)), edges)

        if not self.tire.runout_m:
            return solve(load_n)
        return with_runout(solve, load_n, self.tire.runout_m, self.tire.runout_rad)

    def _linear(self, load_n: float, pressure_pa: float, half_angle_rad: float) -> FloatArray:
        """Return radial and circumferential shape (angles, 2) of Eq. 27 of the ring paper, which has no latter."""
        ring = self.tire.ring_at(pressure_pa)
        coefficients_m = signal_orders(
            np.arange(1, _LINEAR_ORDERS + 1),
            ring.numbers(pressure_pa),
            load_n=load_n,
            pressure_pa=pressure_pa,
            radius_m=ring.radius_m,
            half_angle_rad=half_angle_rad,
        )
        theta = np.linspace(-math.pi, math.pi, TABLE_ANGLES + 1)
        radial = signal_waveform(theta, 1.0, ring.radius_m, coefficients_m)
        return np.stack([radial, np.zeros_like(radial)], axis=1)

    def _fine(self, solution: RingSolution) -> FloatArray:
        """Return a solution's planar columns on the table's angles."""
        sensor, radius = solution.sensor, solution.ring.radius_m
        radial, along = sensor.radial_m, sensor.circumferential_m
        edges_rad = solution.leading_edge_rad, solution.trailing_edge_rad
        for pattern in (self.tire.waves, self.tire.pitch):
            if pattern is None:
                continue
            wave = radius * pattern.radial(solution.theta_rad, *edges_rad)
            slope = angle_derivatives(wave.astype(np.complex128))[0].real
            radial = radial + wave
            along = along - self.tire.sensor_offset_m / radius * slope
        columns = (radial, along, *sensor[2:])
        return _interpolated(np.stack(columns, axis=1))

    @property
    def depends_on_speed(self) -> bool:
        """Whether the waveform changes with speed within the range."""
        return len(self._axes[2]) > 1

    def waveform(
        self, load_n: float, pressure_pa: float, omega_radps: float, slip_angle_rad: float = 0.0
    ) -> WaveformTable:
        """Return the waveform under given conditions."""
        weights = self._weights((load_n, pressure_pa, omega_radps))
        lateral_weights = np.outer(weights, _clamped_weights(self._slips, slip_angle_rad)).reshape(-1)
        wave: WaveformTable = np.empty((TABLE_ANGLES + 1, COLUMNS), np.float32)
        wave[:, :LATERAL] = _mixed(weights, self._planar).reshape(-1, LATERAL)
        wave[:, LATERAL] = _mixed(lateral_weights, self._lateral)
        return wave

    def by_load(
        self, pressure_pa: float, omega_radps: float, slip_angle_rad: float = 0.0
    ) -> tuple[FloatArray, list[WaveformTable]]:
        """Return the loads that are solved, and the waveform under each."""
        loads = self._axes[0]
        return loads, [self.waveform(float(load), pressure_pa, omega_radps, slip_angle_rad) for load in loads]

    def edges_rad(self, load_n: float, pressure_pa: float, omega_radps: float) -> tuple[float, float]:
        """Return the true (leading, trailing) contact angle, negative and positive."""
        leading, trailing = self._weights((load_n, pressure_pa, omega_radps)) @ self._edges
        return float(leading), float(trailing)

    def _weights(self, conditions: tuple[float, float, float]) -> FloatArray:
        """Return the weight of every solved point."""
        weights = np.ones(1)
        for axis, value in zip(self._axes, conditions, strict=True):
            weights = np.outer(weights, _clamped_weights(axis, value)).reshape(-1)
        return weights


@lru_cache(maxsize=64)
def tire_table(
    tire: TireModel, load_n: Range, pressure_pa: Range, omega_radps: Range, slip_angle_rad: Range
) -> TireTable:
    """Return the table of a tire, solved once per process."""
    return TireTable(tire, load_n, pressure_pa, omega_radps, slip_angle_rad)


def look_up(table: WaveformTable, angle_rad: FloatArray) -> WaveformTable:
    """Return (n, COLUMNS) of a waveform at any material angles, by linear interpolation between its rows."""
    turns = angle_rad * (1.0 / (2.0 * math.pi)) + 0.5
    position = (turns - np.floor(turns)) * TABLE_ANGLES
    row = position.astype(np.int64)
    # An angle that rounds up to a full turn lies on the last row, which has no successor.
    np.minimum(row, TABLE_ANGLES - 1, out=row)
    before = table.take(row, axis=0)
    waveform: WaveformTable = before + (position - row).astype(np.float32)[:, None] * (
        table.take(row + 1, axis=0) - before
    )
    return waveform


def _mixed(weights: FloatArray, tables: WaveformTable) -> WaveformTable:
    """Return the weighted sum of rows."""
    # Not a matrix product: BLAS would start all its threads for it, at four times the CPU time.
    mixed: WaveformTable = np.einsum("i,ij->j", weights.astype(np.float32), tables)
    return mixed


def _nodes(extent: Range) -> FloatArray:
    """Return the points to solve at: one for a constant, Chebyshev points (ends included) otherwise."""
    if extent.high - extent.low <= 1e-9 * max(1.0, abs(extent.high)):
        return np.array([0.5 * (extent.low + extent.high)])
    # Contact edges shift with load and pressure: the wider the range, the more points.
    ratio = extent.high / max(extent.low, 0.25 * extent.high)
    return _chebyshev(extent, 3 if ratio < 1.1 else 4 if ratio < 1.5 else 6)


def _slip_nodes(extent: Range) -> FloatArray:
    """Return the slip angles to solve at. The shape is nearly linear while the tread sticks, curved where it slides."""
    width = extent.high - extent.low
    if width <= 1e-9:
        return np.array([0.5 * (extent.low + extent.high)])
    return _chebyshev(extent, 3 if width < math.radians(0.5) else 5 if width < math.radians(2.5) else 9)


def _chebyshev(extent: Range, count: int) -> FloatArray:
    angles = np.pi * np.arange(count) / (count - 1)
    return 0.5 * (extent.low + extent.high) - 0.5 * (extent.high - extent.low) * np.cos(angles)


def _clamped_weights(nodes: FloatArray, values: FloatArray | float) -> FloatArray:
    """Return the weights of the nodes' values at `values`, held at the ends of the range, (..., nodes)."""
    return polynomial_weights(nodes, np.clip(values, nodes[0], nodes[-1]))


def load_weights(loads_n: FloatArray, at_n: FloatArray) -> NDArray[np.float32]:
    """Return (n, nodes) weights of the waveforms of `TireTable.by_load` at n loads, held at the ends of the range."""
    return _clamped_weights(loads_n, at_n).astype(np.float32)


def _interpolated(coarse: FloatArray) -> FloatArray:
    """Return periodic columns on the table's angles, by trigonometric interpolation."""
    spectrum = np.fft.rfft(coarse, axis=0)
    spectrum[-1] *= 0.5  # the highest order of an even grid stands for two
    fine = np.fft.irfft(spectrum, n=TABLE_ANGLES, axis=0) * (TABLE_ANGLES / len(coarse))
    return np.concatenate([fine, fine[:1]])
