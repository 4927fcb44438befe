"""Data of a tire that a configuration may give: thickness, reference numbers, calibration, and what features add."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, TypeVar

from gateway.core.estimates.calibrated_range import outside_calibration
from gateway.core.reasons import Reason

# Relative loss of the ring's bending stiffness per kelvin, and its standard error over compounds, of a tire for which
# it is not measured: the rubber softens, the cords do not (docs/reference/estimates.md).
SOFTENING_PER_K: Final = 0.006
SOFTENING_STD_PER_K: Final = 0.003
# Usual difference from a temperature that is not known, one standard deviation, and the temperature that is assumed.
UNKNOWN_DIFFERENCE_K: Final = 15.0
ASSUMED_DEGC: Final = 25.0
# Error of the difference of two temperatures of the belt, which are measured at the inner liner.
DIFFERENCE_STD_K: Final = 2.0
# Height of the high spot of a good tire on a good rim, where it is not stated.
RUN_OUT_M: Final = 1e-4
# Relative error of the power law of the load at a point that it was not fitted to, on the exact ring.
LOAD_LAW_STD: Final = 0.01


_Kind = TypeVar("_Kind")


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
        softening_per_k: relative loss of the ring's bending stiffness per kelvin.
        softening_std_per_k: one standard error.
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
    softening_per_k: float = SOFTENING_PER_K
    softening_std_per_k: float = SOFTENING_STD_PER_K

    def softening(self, present_degc: float | None, then_degc: float | None) -> Softening:
        """Return the change of bending stiffness from one temperature to the present one; None is not known."""
        warmer_k = (ASSUMED_DEGC if present_degc is None else present_degc) - (
            ASSUMED_DEGC if then_degc is None else then_degc
        )
        is_known = present_degc is not None and then_degc is not None
        # Both errors of the difference: where it is measured, and where it is only assumed.
        difference_std_k = DIFFERENCE_STD_K if is_known else UNKNOWN_DIFFERENCE_K
        by_rate = self.softening_std_per_k * (warmer_k if is_known else math.hypot(warmer_k, UNKNOWN_DIFFERENCE_K))
        return Softening(
            -self.softening_per_k * warmer_k, math.hypot(by_rate, self.softening_per_k * difference_std_k), is_known
        )


@dataclass(frozen=True, slots=True)
class Softening:
    """Change of the ring's bending stiffness with temperature.

    Attributes:
        logarithm: natural logarithm of the present stiffness over that of the other temperature.
        std: one standard error of it.
        is_known: False where a temperature is not known and its usual difference is part of the error.
    """

    logarithm: float
    std: float
    is_known: bool


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
        temperature_degc: inner-liner temperature at which it was fitted; None when not known.
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
    temperature_degc: float | None = None

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
        return tuple(
            outside_calibration(half_angle_rad, self.half_angle_range_rad, pressure_pa, self.pressure_range_pa)
        )


@dataclass(frozen=True, slots=True)
class TireData:
    """Data of one tire.

    Attributes:
        ring_thickness_m: belt and tread of the new tire, None when unknown.
        ring_thickness_std_m: its standard error.
        wear_m: wear of the tread since the tire was new, as stated; None when it is not.
        wear_std_m: one standard error of it.
        cavity_length_m: mean circumference of the gas in the tire; None when not known.
        cavity_length_std_m: one standard error of it.
        runout_m: height of the high spot of radial run-out, that of a good tire where it is not stated.
        half_angle_rad: contact half angle as stated, None when it is not.
        half_angle_std_rad: one standard error of it.
        is_linear_ring: whether the signal is that of the linear ring, computed by Eq. 27 of the ring paper as printed.
            Its order 1 is not gravity alone, and the model of `ring-paper` is exact.
        ply_steer_definition: of the ply steer angle that is listed first, empty for the usual one.
        reference: numbers of the new tire.
        load_calibration: None when the tire is not calibrated.
        added: data that features add, one of each type.
    """

    ring_thickness_m: float | None = None
    ring_thickness_std_m: float = 0.0
    wear_m: float | None = None
    wear_std_m: float = 0.0
    cavity_length_m: float | None = None
    cavity_length_std_m: float = 0.0
    runout_m: float = RUN_OUT_M
    half_angle_rad: float | None = None
    half_angle_std_rad: float = 0.0
    is_linear_ring: bool = False
    ply_steer_definition: str = ""
    reference: ReferenceNumbers = field(default_factory=ReferenceNumbers)
    load_calibration: LoadCalibration | None = None
    added: tuple[object, ...] = ()

    def of(self, kind: type[_Kind]) -> _Kind | None:
        """Return the data of a type that a feature adds, None where they are not stated."""
        return next((data for data in self.added if isinstance(data, kind)), None)
