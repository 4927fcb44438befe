"""Order coefficients of each revolution of one wheel, and waveforms of the first ones at each speed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.core.estimates.estimator import Estimate, Revolution, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.reasons import Reason
from gateway.core.types import ComplexArray, FloatArray
from gateway.core.wheels.reasons import WheelCode
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.reasons import DiagnosisCode

MOST_REVOLUTIONS: Final = 20_000
"""Revolutions of one recording; at 3 kB each they take 60 MB."""

TOO_MANY: Final = Reason(DiagnosisCode.REVOLUTION_UNUSED, why="recording_limit", limit=MOST_REVOLUTIONS)
NOT_MEASURED: Final = Reason(DiagnosisCode.REVOLUTION_UNUSED, why="not_measured")

SIGNS: Final[FloatArray] = np.where(np.arange(ORDERS) % 2, -1.0, 1.0)
"""Of each order in the transform of a grid that begins at -pi, (ORDERS,)."""

# Share of the Nyquist order up to which the pipeline's interpolation is right within 0.5 %.
_USABLE_BAND: Final = 0.56
# Seconds of waveforms kept for each speed, and for a recording.
_SPEED_QUOTA_S: Final = 30.0
_RECORDING_QUOTA_S: Final = 240.0
_SPEED_STEP: Final = 0.03
_AXES: Final = ("circumferential", "lateral")
# An axis that varies by less than this in a revolution is not measuring.
_DEAD_MPS2: Final = 1e-6
_CUT_OFF: Final = frozenset({EstimateCode.RADIAL_SATURATED, WheelCode.RADIAL_CLIPPED})
_UNKNOWN: Final = Estimate("", 0.0, math.inf, Status.PROVISIONAL)


def waveform_orders(waveform_mps2: FloatArray) -> ComplexArray:
    """Return coefficients c - i s of orders 0 to 110, (..., ORDERS), of a waveform (..., n); order 0 is the mean.

    The grid is theta = -pi + 2 pi k / n, n > 220.
    """
    n = waveform_mps2.shape[-1]
    orders: ComplexArray = np.fft.rfft(waveform_mps2, axis=-1)[..., :ORDERS] * (SIGNS * (2.0 / n))
    orders[..., 0] *= 0.5
    return orders


def carried_order(samples_per_revolution: float) -> int:
    """Return the highest order up to 110 that a number of samples per revolution reproduces within half a percent."""
    return max(0, min(ORDERS - 1, math.floor(_USABLE_BAND * samples_per_revolution / 2.0)))


class RevolutionStore:
    """Collector of one wheel's revolutions in the form that a campaign needs, with bounded memory.

    Attributes:
        rejected: number of rejected revolutions by reason.
    """

    def __init__(self, reverse: bool = False) -> None:
        """Start empty.

        Args:
            reverse: the wheel rolls the other way round than the sensor was glued for; its circumferential axis is
                turned, so that it points along the rolling direction as the model's does.
        """
        self.rejected: dict[Reason, int] = {}
        self._sign = np.array([-1.0 if reverse else 1.0, 1.0, 1.0])[:, None]
        self._rows: list[tuple[float, ...]] = []
        self._orders: list[NDArray[np.complex64]] = []
        self._waveforms: dict[int, NDArray[np.float32]] = {}
        self._stored_s: dict[int, float] = {}
        self.ac_coupled = False
        self._dead: dict[str, int] = {}

    def __len__(self) -> int:
        """Number of revolutions kept."""
        return len(self._rows)

    def take(
        self, revolution: Revolution, conditions: TireConditions, host_ns: int, estimates: Iterable[Estimate] = ()
    ) -> None:
        """Keep a revolution with the rates of its wheel among its estimates, or count the reason for its rejection."""
        faults = [fault for fault in revolution.faults if fault.code not in _CUT_OFF]
        if faults:
            self.reject(faults[0])
            return
        if revolution.missing_fraction:
            # What stands in its gaps is of other revolutions.
            self.reject(Reason(EstimateCode.SAMPLES_LOST))
            return
        if not (np.isfinite(revolution.axes_mps2[2]).all() and revolution.rate_hz > 0.0):
            self.reject(NOT_MEASURED)
            return
        if len(self._rows) >= MOST_REVOLUTIONS:
            self.reject(TOO_MANY)
            return
        axes = revolution.axes_mps2 * self._sign
        for axis, name in enumerate(_AXES):
            if np.ptp(axes[axis]) < _DEAD_MPS2:
                axes[axis] = math.nan
                self._dead[name] = self._dead.get(name, 0) + 1
        row = len(self._rows)
        self._keep_waveform(row, revolution, axes)
        self._orders.append(waveform_orders(axes).astype(np.complex64))
        self.ac_coupled = revolution.ac_coupled
        self._rows.append(
            (
                revolution.index,
                host_ns * 1e-9,
                revolution.period_s,
                revolution.omega_radps,
                revolution.omega_dot_radps2,
                revolution.rate_hz,
                0.5 * (revolution.trailing_edge_rad - revolution.leading_edge_rad),
                math.nan if conditions.load_n is None else conditions.load_n,
                math.nan if conditions.pressure_pa is None else conditions.pressure_pa,
                math.nan if conditions.temperature_degc is None else conditions.temperature_degc,
                bool(revolution.faults),
                *_rates(estimates),
            )
        )

    def reject(self, reason: Reason, count: int = 1) -> None:
        """Count rejected revolutions."""
        self.rejected[reason] = self.rejected.get(reason, 0) + count

    def leave_out(self, axes: Sequence[int]) -> None:
        """Take axes as absent in all revolutions kept."""
        rows = list(axes)
        for orders in self._orders:
            orders[rows] = math.nan
        for waveform in self._waveforms.values():
            waveform[rows] = math.nan

    def notes(self) -> list[Reason]:
        """Return a reason for each axis that is not measuring."""
        return [Reason(DiagnosisCode.AXIS_CONSTANT, axis=name, count=count) for name, count in self._dead.items()]

    def _keep_waveform(self, row: int, revolution: Revolution, axes: FloatArray) -> None:
        speed = round(math.log(revolution.omega_radps) / _SPEED_STEP)
        stored_s = self._stored_s.get(speed, 0.0)
        if stored_s >= _SPEED_QUOTA_S or sum(self._stored_s.values()) >= _RECORDING_QUOTA_S:
            return
        self._stored_s[speed] = stored_s + revolution.period_s
        self._waveforms[row] = axes.astype(np.float32)

    def table(self) -> RevolutionTable:
        """Return the table of kept revolutions."""
        columns = np.array(self._rows, dtype=np.float64).reshape(len(self._rows), len(COLUMNS))
        orders = np.stack(self._orders) if self._orders else np.empty((0, 3, ORDERS), np.complex64)
        return RevolutionTable(columns, orders, self._waveforms)


COLUMNS: Final = (
    "index", "host_s", "period_s", "omega_radps", "omega_dot_radps2", "rate_hz", "half_angle_rad", "load_n",
    "pressure_pa", "temperature_degc", "cut_off", "turn_radps", "turn_shared_radps", "turn_scatter_radps",
    "turn_valid", "camber_radps", "camber_shared_radps", "camber_scatter_radps", "camber_valid",
)  # fmt: skip


def _rates(estimates: Iterable[Estimate]) -> tuple[float, ...]:
    """Return turn and camber rate, the errors that revolutions share and do not, and whether it is valid.

    0 with an infinite error where unknown.
    """
    by_name = {estimate.name: estimate for estimate in estimates if estimate.status is not Status.INVALID}
    rates = [by_name.get("turn_rate_radps", _UNKNOWN), by_name.get("camber_rate_radps", _UNKNOWN)]
    parts = ((rate.value, rate.constant_std, rate.scatter_std, rate.status is Status.VALID) for rate in rates)
    return tuple(float(part) for rate in parts for part in rate)


class RevolutionTable:
    """Revolutions of one wheel, one a row.

    Attributes:
        orders_mps2: (n, 3, ORDERS) complex64; NaN for absent axes.
        waveforms_mps2: (3, grid) float32 of some of the rows.
    """

    def __init__(
        self, columns: FloatArray, orders_mps2: NDArray[np.complex64], waveforms_mps2: dict[int, NDArray[np.float32]]
    ) -> None:
        """Take the columns in the order of COLUMNS, (n, columns)."""
        self._columns = columns
        self.orders_mps2 = orders_mps2
        self.waveforms_mps2 = waveforms_mps2

    def __len__(self) -> int:
        """Number of revolutions."""
        return len(self._columns)

    def __getitem__(self, name: str) -> FloatArray:
        """Return a column, (n,)."""
        column: FloatArray = self._columns[:, COLUMNS.index(name)]
        return column
