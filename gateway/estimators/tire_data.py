"""Data of a tire that a configuration may give: thickness, reference numbers, calibrations and laminate."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from gateway.estimators.belt_laminate import BeltLaminate
from gateway.estimators.side_force_calibration import SideForceCalibration
from gateway.estimators.slip_calibration import SlipCalibration
from gateway.reasons import Code, Reason

# Relative loss of the ring's bending stiffness per kelvin, and its standard error over compounds: the rubber softens,
# the cords do not (docs/reference/estimates.md).
SOFTENING_PER_K: Final = 0.006
SOFTENING_STD_PER_K: Final = 0.003
# Relative error of the power law of the load at a point that it was not fitted to, on the exact ring.
LOAD_LAW_STD: Final = 0.01


@dataclass(frozen=True, slots=True)
class ReferenceNumbers:
    """The four dimensionless numbers of the new tire; None where they were not measured.

    Attributes:
        Bs: bending stiffness number.
        Cw: contact width number.
        Rs: radial stiffness number.
        Ts: tangential stiffness number.
        Bs_std: one standard error.
        Cw_std: one standard error.
        Rs_std: one standard error.
        Ts_std: one standard error.
        pressure_pa: inflation (gauge) pressure at which they hold; None when not known.
        temperature_degc: inner-liner temperature that they were measured at; None when not known.
        estimator: that they were measured with. Every estimator has its own bias, so only numbers of the same estimator
            may be compared.
    """

    Bs: float | None = None
    Cw: float | None = None
    Rs: float | None = None
    Ts: float | None = None
    Bs_std: float = 0.0
    Cw_std: float = 0.0
    Rs_std: float = 0.0
    Ts_std: float = 0.0
    pressure_pa: float | None = None
    temperature_degc: float | None = None
    estimator: str = "weak-form"


@dataclass(frozen=True, slots=True)
class LoadCalibration:
    """Load from contact half angle and pressure: ln(Q / load_n) = n x + c x^2 + m ln(p / pressure_pa).

    x = ln(half / half_angle_rad).

    Attributes:
        load_n: load at the reference half angle and pressure.
        half_angle_rad: reference half angle.
        pressure_pa: reference pressure.
        angle_exponent: n.
        angle_curvature: c.
        pressure_exponent: m.
        relative_std: one standard error of a load it gives, relative.
        half_angle_range_rad: smallest and largest half angle it was fitted on.
        pressure_range_pa: likewise pressure.
    """

    load_n: float
    half_angle_rad: float
    pressure_pa: float
    angle_exponent: float
    angle_curvature: float
    pressure_exponent: float
    relative_std: float
    half_angle_range_rad: tuple[float, float]
    pressure_range_pa: tuple[float, float]

    def load_at(self, half_angle_rad: float, pressure_pa: float) -> float:
        """Return the load in N of a positive half angle and pressure."""
        angle, pressure = math.log(half_angle_rad / self.half_angle_rad), math.log(pressure_pa / self.pressure_pa)
        exponent = (self.angle_exponent + self.angle_curvature * angle) * angle + self.pressure_exponent * pressure
        return self.load_n * math.exp(exponent)

    def slope_at(self, half_angle_rad: float) -> float:
        """Return the relative change of the load per relative change of the half angle."""
        return self.angle_exponent + 2.0 * self.angle_curvature * math.log(half_angle_rad / self.half_angle_rad)

    def outside(self, half_angle_rad: float, pressure_pa: float) -> tuple[Reason, ...]:
        """Return what lies outside the range it was fitted on by more than a tenth."""
        reasons = []
        low, high = self.half_angle_range_rad
        if not 0.9 * low <= half_angle_rad <= 1.1 * high:
            reasons.append(
                Reason(Code.HALF_ANGLE_OUTSIDE_CALIBRATION, half_angle_rad=half_angle_rad, low_rad=low, high_rad=high)
            )
        low, high = self.pressure_range_pa
        if not 0.9 * low <= pressure_pa <= 1.1 * high:
            reasons.append(Reason(Code.PRESSURE_OUTSIDE_CALIBRATION, pressure_pa=pressure_pa, low_pa=low, high_pa=high))
        return tuple(reasons)


@dataclass(frozen=True, slots=True)
class TireData:
    """Data of one tire.

    Attributes:
        ring_thickness_m: belt and tread of the new tire, None when unknown.
        ring_thickness_std_m: its standard error.
        reference: numbers of the new tire.
        load_calibration: None when the tire is not calibrated.
        slip_calibration: None when the tire is not calibrated at known slip angles.
        laminate: plies of the belt, None when they are not stated.
        side_force_calibration: None when the tire is not calibrated at known side forces.
    """

    ring_thickness_m: float | None = None
    ring_thickness_std_m: float = 0.0
    reference: ReferenceNumbers = field(default_factory=ReferenceNumbers)
    load_calibration: LoadCalibration | None = None
    slip_calibration: SlipCalibration | None = None
    laminate: BeltLaminate | None = None
    side_force_calibration: SideForceCalibration | None = None
