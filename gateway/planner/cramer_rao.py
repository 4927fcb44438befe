"""The Cramer-Rao bound: smallest variance of any unbiased estimate of a tire's parameters from its radial waveform.

The waveform is that of the geometrically exact ring. Its derivatives by the logarithms of the parameters are central
differences. Noise that is not locked to the wheel is independent from order to order. White noise of density nd gives
every real coefficient the standard deviation nd / sqrt(T), T being the period of the revolution, and the mean half of
that variance. Coloured noise does the same with its density at each order's frequency.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.types import ComplexArray, FloatArray
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring
from gateway.ring.rolling_ring.sensor_waveform import waveform_orders

# Field of `RingParameters` for each parameter name; all derivatives are by logarithms.
_RING_FIELDS: Final = {
    "Bs": "bending_stiffness_nm2",
    "Cw": "tension_width_m",
    "Rs": "radial_stiffness_npm2",
    "Ts": "tangential_stiffness_npm2",
    "tread": "tread_stiffness_npm2",
    "extension": "extension_stiffness_n",
}
# Tread stiffness and the angle of the contact centre are not known either and are estimated along with the numbers.
DEFAULT_PARAMETERS: Final = (*RING_NUMBERS, "tread", "centre")

_STEP: Final = 2e-3
_MAX_ORDER: Final = 150


@dataclass(frozen=True, slots=True)
class WaveformSensitivity:
    """Derivatives of one tire's radial waveform and contact edges by its parameters.

    Attributes:
        names: of the k parameters.
        coefficients_mps2: (m,) coefficients c - i s of orders 0 to m - 1.
        derivatives_mps2: (k, m) their derivatives, by the logarithm of a parameter, `centre` by rad.
        edges_rad: (2,) leading and trailing edge.
        edge_derivatives_rad: (k, 2) likewise.
        omega_radps: angular speed.
    """

    names: tuple[str, ...]
    coefficients_mps2: ComplexArray
    derivatives_mps2: ComplexArray
    edges_rad: FloatArray
    edge_derivatives_rad: FloatArray
    omega_radps: float

    @property
    def period_s(self) -> float:
        """Duration of a revolution."""
        return 2.0 * math.pi / self.omega_radps


@dataclass(frozen=True, slots=True)
class Bound:
    """Lower bound of the covariance of unbiased estimates from one revolution; divide by M for M revolutions.

    Attributes:
        names: of the k parameters.
        covariance: (k, k), of logarithms: relative errors; `centre` in rad.
        half_angle_std_rad: of the contact's half angle.
        period_std_s: of the time from one contact centre to the next; NaN when `centre` is not estimated.
    """

    names: tuple[str, ...]
    covariance: FloatArray
    half_angle_std_rad: float
    period_std_s: float

    def std(self, name: str) -> float:
        """Return the standard error of one parameter, relative (`centre`: rad)."""
        index = self.names.index(name)
        return math.sqrt(self.covariance[index, index])

    def ratio_std(self, name: str, other: str) -> float:
        """Return the relative standard error of the ratio of two parameters."""
        i, j = self.names.index(name), self.names.index(other)
        return math.sqrt(self.covariance[i, i] + self.covariance[j, j] - 2.0 * self.covariance[i, j])


def waveform_sensitivity(
    ring: RingParameters,
    load_n: float,
    pressure_pa: float,
    omega_radps: float,
    *,
    parameters: Sequence[str] = DEFAULT_PARAMETERS,
    nodes: int = 1440,
    max_order: int = _MAX_ORDER,
    sensor_offset_m: float = 0.0,
) -> WaveformSensitivity:
    """Return the derivatives of the waveform by `parameters`.

    Args:
        ring: the tire.
        load_n: vertical load, the same at every step unless "load" is a parameter.
        pressure_pa: inflation pressure.
        omega_radps: angular speed.
        parameters: any of Bs, Cw, Rs, Ts, tread, extension, load, gain (of the sensor), offset (of the sensor from the
            belt's neutral layer, in units of 1 % of the radius) and centre (angle of the contact on the grid).
        nodes: number of grid points of the ring.
        max_order: highest order.
        sensor_offset_m: sensor below the neutral layer.

    Raises:
        ValueError: an unknown parameter.
        RingNotConvergedError: no equilibrium.
    """
    base = solve_rolling_ring(ring, load_n, pressure_pa, omega_radps, nodes=nodes, sensor_offset_m=sensor_offset_m)

    def solve(name: str, step: float) -> RingSolution:
        varied, load, offset = ring, load_n, sensor_offset_m
        if name == "load":
            load *= math.exp(step)
        elif name == "offset":
            offset += 0.01 * ring.radius_m * step
        elif name in _RING_FIELDS:
            varied = replace(ring, **{_RING_FIELDS[name]: getattr(ring, _RING_FIELDS[name]) * math.exp(step)})
        else:
            raise ValueError(f"'{name}' is not a parameter of the waveform")
        return solve_rolling_ring(
            varied, load, pressure_pa, omega_radps, nodes=nodes, sensor_offset_m=offset, start=base
        )

    square = omega_radps**2
    coefficients = square * waveform_orders(base.sensor.radial_m, max_order)
    order = np.arange(max_order + 1)
    derivatives = np.zeros((len(parameters), max_order + 1), dtype=np.complex128)
    edges = np.zeros((len(parameters), 2))
    for row, name in enumerate(parameters):
        if name == "gain":
            derivatives[row] = coefficients
        elif name == "centre":
            # s(theta - centre): every coefficient turns by -n centre.
            derivatives[row], edges[row] = -1j * order * coefficients, 1.0
        else:
            above, below = solve(name, _STEP), solve(name, -_STEP)
            change = above.sensor.radial_m - below.sensor.radial_m
            derivatives[row] = square * waveform_orders(change, max_order) / (2.0 * _STEP)
            edges[row] = (_edges(above) - _edges(below)) / (2.0 * _STEP)
    return WaveformSensitivity(tuple(parameters), coefficients, derivatives, _edges(base), edges, omega_radps)


def order_variance(
    period_s: float,
    density_mps2_rthz: float,
    *,
    road_rms_mps2: float = 0.0,
    road_bandwidth_hz: float = 500.0,
    max_order: int = _MAX_ORDER,
) -> FloatArray:
    """Return the variance of one real coefficient of one revolution, (max_order + 1,).

    Args:
        period_s: of the revolution.
        density_mps2_rthz: one-sided amplitude density of white sensor noise.
        road_rms_mps2: of road vibration, white noise through a two-pole Butterworth low-pass filter.
        road_bandwidth_hz: corner frequency of the filter.
        max_order: highest order.
    """
    frequency = np.arange(max_order + 1) / period_s
    # The noise bandwidth of a two-pole Butterworth filter is pi / (2 sqrt 2) times its corner frequency.
    road = road_rms_mps2**2 / (road_bandwidth_hz * math.pi / (2.0 * math.sqrt(2.0)))
    density = density_mps2_rthz**2 + road / (1.0 + (frequency / road_bandwidth_hz) ** 4)
    variance: FloatArray = density / period_s
    variance[0] *= 0.5
    return variance


def cramer_rao(
    sensitivity: WaveformSensitivity, variance: FloatArray, *, prior_std: dict[str, float] | None = None
) -> Bound:
    """Return the bound of one revolution.

    Args:
        sensitivity: of the waveform.
        variance: (m,) of one real coefficient of each order; orders of `sensitivity` from m on are not used.
        prior_std: prior standard errors of parameters (relative, `centre` in rad).

    Raises:
        numpy.linalg.LinAlgError: the waveform does not distinguish the parameters.
    """
    order_count = min(len(variance), sensitivity.derivatives_mps2.shape[1])
    weighted = sensitivity.derivatives_mps2[:, :order_count] / np.sqrt(variance[:order_count])
    information = (weighted @ weighted.conj().T).real
    for name, std in (prior_std or {}).items():
        index = sensitivity.names.index(name)
        information[index, index] += std**-2
    scale = np.sqrt(np.diagonal(information))
    covariance = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    half = 0.5 * (sensitivity.edge_derivatives_rad[:, 1] - sensitivity.edge_derivatives_rad[:, 0])
    centre_std = math.nan
    if "centre" in sensitivity.names:
        index = sensitivity.names.index("centre")
        centre_std = math.sqrt(covariance[index, index])
    return Bound(
        names=sensitivity.names,
        covariance=covariance,
        half_angle_std_rad=math.sqrt(half @ covariance @ half),
        # Two contacts bound a revolution, and each is located by one revolution of signal around it.
        period_std_s=math.sqrt(2.0) * centre_std / sensitivity.omega_radps,
    )


def relative_bounds(sensitivity: WaveformSensitivity, bound: Bound) -> dict[str, float]:
    """Return the bound of each quantity after one revolution as a share of its value; of wear, of the ring's thickness.

    The radius, and load or width, are known.
    """
    half_rad = 0.5 * float(sensitivity.edges_rad[1] - sensitivity.edges_rad[0])
    result = {name: bound.std(name) for name in RING_NUMBERS}
    result |= {f"{name}/Cw": bound.ratio_std(name, "Cw") for name in RING_NUMBERS if name != "Cw"}
    result["half_angle_rad"] = result["contact_length_m"] = bound.half_angle_std_rad / half_rad
    # b known in place of the load gives it with the error of Cw; thickness goes with the cube root of Bs.
    result["load_by_width_n"] = result["Cw"]
    result["wear_mm"] = result["Bs"] / 3.0
    result["speed_mps"] = bound.period_std_s / sensitivity.period_s
    return result


def _edges(solution: RingSolution) -> FloatArray:
    return np.array([solution.leading_edge_rad, solution.trailing_edge_rad])
