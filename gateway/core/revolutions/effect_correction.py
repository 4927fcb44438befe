"""Correction table: contribution of known effects to a revolution, by speed, subtracted before averaging.

A diagnosis finds the effects and makes the table; the pipeline only looks it up.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.angle_resampling import GRID_SIZE
from gateway.core.revolutions.reasons import RevolutionCode
from gateway.core.types import ComplexArray, FloatArray

OFFSET_TOLERANCE_M: Final = 5e-5
"""Difference of declared mounting offsets within which effects belong to a wheel."""
RADIUS_TOLERANCE: Final = 5e-3
"""Relative difference of belt radii, likewise."""


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """A fitted parameter of an effect, for display; `value` and `std` are in `unit`."""

    name: str
    value: float
    std: float
    unit: str = ""


@dataclass(frozen=True, slots=True)
class CorrectedEffect:
    """An effect whose contribution a table contains."""

    name: str
    parameters: tuple[EffectParameter, ...] = ()


@dataclass(frozen=True, slots=True)
class CorrectedSignal:
    """The signal that effects are to be subtracted from, as far as it is stated.

    Attributes:
        sensor_id: serial number, None when unknown.
        vehicle: name of the vehicle or test rig, empty when unknown.
        tire: its size, empty when unknown.
        radii_m: belt radii in use, of each recording; empty when none is stated.
        offsets_m: declared mounting offsets, likewise.
    """

    sensor_id: int | None = None
    vehicle: str = ""
    tire: str = ""
    radii_m: tuple[float, ...] = ()
    offsets_m: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class CorrectionTable:
    """Contribution of a set of effects to the axes of one wheel's sensor. A table equals only itself.

    Attributes:
        position: position of the wheel.
        omega_radps: (k,) angular speeds, ascending.
        orders_mps2: (k, 3, m) coefficients c - i s of orders 0 to m - 1 of the contribution to the circumferential,
            lateral and radial axis (positive inward) as measured, theta = 0 at the contact centre as the pipeline
            finds it; m from 2 to 512.
        effects: the effects that contribute.
        radius_m: belt radius used in the diagnosis.
        omega_range_radps: lowest and highest angular speed for which the table is valid.
        load_range_n: likewise; None when the load was not stated: valid for any load.
        pressure_range_pa: likewise.
        sensor_offset_m: sensor below the neutral layer as declared in the diagnosis; with another offset the same
            effects would be counted twice or not at all.
        sensor_id: serial number of the sensor, None when unknown: valid for any sensor.
        sources: recordings in which the effects were found.
        vehicle: name of the vehicle or test rig, empty when unknown.
        tire: its size, empty when unknown.
    """

    position: str
    omega_radps: FloatArray
    orders_mps2: ComplexArray
    effects: tuple[CorrectedEffect, ...]
    radius_m: float
    omega_range_radps: tuple[float, float]
    load_range_n: tuple[float, float] | None = None
    pressure_range_pa: tuple[float, float] | None = None
    sensor_offset_m: float = 0.0
    sensor_id: int | None = None
    sources: tuple[str, ...] = ()
    vehicle: str = ""
    tire: str = ""

    def __post_init__(self) -> None:
        """Refuse tables that cannot be looked up.

        Raises:
            ValueError: shapes that do not fit, speeds that do not ascend, numbers that are not finite.
        """
        omega, orders = self.omega_radps, self.orders_mps2
        if omega.ndim != 1 or not len(omega) or orders.ndim != 3 or orders.shape[:2] != (len(omega), 3):
            raise ValueError(f"a table of {omega.shape} speeds cannot have orders of shape {orders.shape}")
        if not 2 <= orders.shape[2] <= GRID_SIZE // 2:
            raise ValueError(f"a table has orders up to 1 at least and {GRID_SIZE // 2 - 1} at most")
        if not (np.isfinite(omega).all() and np.isfinite(orders).all() and omega[0] > 0.0):
            raise ValueError("a table's numbers must be finite, and its speeds positive")
        if (np.diff(omega) <= 0.0).any():
            raise ValueError("a table's speeds must ascend")

    def refusal(self, omega_radps: float, load_n: float | None, pressure_pa: float | None) -> Reason | None:
        """Return why the table does not hold under these conditions; None when it does.

        Unknown conditions are taken to be within range.
        """
        low, high = self.omega_range_radps
        if not low <= omega_radps <= high:
            speed, slowest, fastest = (omega * self.radius_m for omega in (omega_radps, low, high))
            return _outside("speed_mps", speed, slowest, fastest)
        if load_n is not None and self.load_range_n is not None:
            low, high = self.load_range_n
            if not low <= load_n <= high:
                return _outside("load_n", load_n, low, high)
        if pressure_pa is not None and self.pressure_range_pa is not None:
            low, high = self.pressure_range_pa
            if not low <= pressure_pa <= high:
                return _outside("pressure_pa", pressure_pa, low, high)
        return None

    def differences(self, signal: CorrectedSignal) -> tuple[Reason, ...]:
        """Return what differs between a signal and the recordings of the table, as far as both state it."""
        reasons: list[Reason] = []
        recorded, expected = signal.sensor_id, self.sensor_id
        if recorded is not None and expected is not None and recorded != expected:
            reasons.append(
                Reason(CoreCode.EFFECTS_OF_OTHER_SENSOR, found_on=f"{expected:08x}", sensor=f"{recorded:08x}")
            )
        if "" not in (signal.vehicle, self.vehicle) and signal.vehicle != self.vehicle:
            reasons.append(_mismatch("vehicle", self.vehicle, signal.vehicle))
        if "" not in (signal.tire, self.tire) and signal.tire != self.tire:
            reasons.append(_mismatch("tire", self.tire, signal.tire))
        radii_m = [value for value in signal.radii_m if abs(value / self.radius_m - 1.0) > RADIUS_TOLERANCE]
        if radii_m:
            reasons.append(Reason(CoreCode.EFFECTS_OF_OTHER_RADIUS, found_m=self.radius_m, radius_m=max(radii_m)))
        offsets_m = [value for value in signal.offsets_m if abs(value - self.sensor_offset_m) > OFFSET_TOLERANCE_M]
        if offsets_m:
            reasons.append(
                Reason(CoreCode.EFFECTS_OF_OTHER_OFFSET, found_m=self.sensor_offset_m, offset_m=max(offsets_m))
            )
        return tuple(reasons)

    def contribution_mps2(self, omega_radps: float, *, ac_coupled: bool = False) -> FloatArray:
        """Return the contribution at a speed on the angle grid, (3, GRID_SIZE).

        It is linear in the square of the speed between the table's speeds and constant beyond them.

        Args:
            omega_radps: angular speed.
            ac_coupled: True omits order 0, which such a sensor does not pass.
        """
        square, speed_squared = np.square(self.omega_radps), omega_radps * omega_radps
        above = int(np.clip(np.searchsorted(square, speed_squared), 1, max(1, len(square) - 1)))
        below = above - 1
        if above >= len(square):
            orders = self.orders_mps2[0]
        else:
            share = min(1.0, max(0.0, float((speed_squared - square[below]) / (square[above] - square[below]))))
            orders = (1.0 - share) * self.orders_mps2[below] + share * self.orders_mps2[above]
        count = orders.shape[-1]
        spectrum = np.zeros((3, GRID_SIZE // 2 + 1), dtype=np.complex128)
        signs = np.where(np.arange(count) % 2, -1.0, 1.0)
        spectrum[:, :count] = orders * (signs * (GRID_SIZE / 2.0))
        spectrum[:, 0] *= 0.0 if ac_coupled else 2.0
        waveform: FloatArray = np.fft.irfft(spectrum, n=GRID_SIZE, axis=-1)
        return waveform


def _outside(quantity: str, value: float, low: float, high: float) -> Reason:
    return Reason(RevolutionCode.EFFECTS_OUTSIDE_RANGE, quantity=quantity, value=value, low=low, high=high)


def _mismatch(kind: str, found_on: str, name: str) -> Reason:
    return Reason(RevolutionCode.EFFECTS_OF_OTHER, kind=kind, found_on=found_on, name=name)
