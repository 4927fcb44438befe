"""Interface of estimators: the revolution and conditions that they take, the estimates that they return."""

import math
from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from typing import Final, NamedTuple, Protocol, Self

from gateway.core.estimates.doubt_rules import EVERY_RULE, DoubtRule
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.sensor_claims import SensorClaims, Tilt
from gateway.core.estimates.tire_data import TireData
from gateway.core.reasons import Reason
from gateway.core.revolutions.synchronous_average import (
    AngleAverage as AngleAverage,  # part of the interface
)
from gateway.core.types import ComplexArray, FloatArray

SETTLED_REVOLUTIONS: Final = 8.0
"""Effective revolutions in an average from which its estimates are valid."""
DETERMINED: Final = 3.0
"""Standard errors from zero at which a number is determined."""


class Status(StrEnum):
    """Validity of an estimate."""

    VALID = "valid"
    PROVISIONAL = "provisional"
    INVALID = "invalid"


class Estimate(NamedTuple):
    """A number with its unit, uncertainty and validity; a named tuple, since every revolution has some thirty.

    Attributes:
        name: of the quantity, with its unit where it has one: `speed_mps`, `Bs`.
        value: in the unit of the name; NaN when invalid.
        std: one standard error (combined standard uncertainty, JCGM 100), same unit; NaN when not known.
        status: valid, provisional or invalid.
        reasons: why it is not valid, or notes on a valid one.
        scatter_std: the part of `std` that differs between independent revolutions, so that averaging makes it smaller;
            0 where the estimator does not know it apart.
    """

    name: str
    value: float
    std: float
    status: Status
    reasons: tuple[Reason, ...] = ()
    scatter_std: float = 0.0

    @property
    def constant_std(self) -> float:
        """The other part of `std`, which revolutions share: std^2 = constant_std^2 + scatter_std^2."""
        return math.sqrt(max(self.std**2 - self.scatter_std**2, 0.0))

    @classmethod
    def invalid(cls, name: str, *reasons: Reason) -> Self:
        """Return an estimate without a value, and why there is none."""
        return cls(name, math.nan, math.nan, Status.INVALID, reasons)


EstimateRow = tuple[str, float, float, Status, tuple[Reason, ...], float]
"""The fields of an estimate in their order."""

estimate_of: Final[Callable[[EstimateRow], Estimate]] = partial(tuple.__new__, Estimate)
"""Makes an estimate of all of its fields, without a call of Python: every revolution has some forty."""


SOURCE_COLUMNS: Final = {"load_n": "load_source", "pressure_pa": "pressure_source"}
"""What says where a condition comes from, in rows and published objects."""


def source_in(stated: Container[str], name: str) -> str:
    """Return where a condition that is known comes from."""
    return "stated" if name in stated else "measured"


@dataclass(frozen=True, slots=True)
class TireConditions:
    """State of the tire during a revolution, apart from the acceleration of its sensor.

    Attributes:
        radius_m: belt radius (2 pi radius_m is the rolling circumference).
        load_n: vertical load as stated; None when it is not.
        pressure_pa: inflation (gauge) pressure, measured or stated, or None.
        temperature_degc: inner-liner temperature, or None.
        load_std_n: one standard error of the load.
        pressure_std_pa: one standard error of the pressure.
        radius_std_m: one standard error of the belt radius.
        sensor_offset_m: distance of the sensor below (inside) the belt's neutral layer.
        sensor_offset_std_m: one standard error of it.
        steady_std_mps2: one standard error of the steady value of the radial axis, beyond a common gain.
        gain_std: relative standard error of the gain of the sensor's axes.
        hub_mps2: standard error of order 2 by motion of the hub, as far as the circumferential axis shows it.
        roll_std_rad: standard error of a roll from means at one speed, as the shape of the lateral axis shows it.
        tilt: how the sensor sits askew, as its axes show it.
        claims: what is stated about the sensor; `sensor_offset_m` is what is in use.
        tire: the new tire's reference numbers, thickness, calibrations and laminate.
        given: estimates that earlier estimators made of this revolution, by name of the estimator, then of the
            estimate. Estimators run in the order of the registry. Empty outside `Estimator.update`.
        rules: of doubt that apply.
        pressure_measured: whether `pressure_pa` is a reading of a sensor; otherwise it is stated.
    """

    radius_m: float
    load_n: float | None = None
    pressure_pa: float | None = None
    temperature_degc: float | None = None
    load_std_n: float = 0.0
    pressure_std_pa: float = 0.0
    radius_std_m: float = 0.0
    sensor_offset_m: float = 0.0
    sensor_offset_std_m: float = 0.0
    steady_std_mps2: float = 0.0
    gain_std: float = 0.0
    hub_mps2: float = 0.0
    roll_std_rad: float = 0.0
    tilt: Tilt = field(default_factory=Tilt)
    claims: SensorClaims = field(default_factory=SensorClaims)
    tire: TireData = field(default_factory=TireData)
    given: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    rules: frozenset[DoubtRule] = EVERY_RULE
    pressure_measured: bool = False

    @property
    def stated(self) -> frozenset[str]:
        """Those of `load_n` and `pressure_pa` that are stated: an estimated load is an estimate, not a condition."""
        unmeasured = {"load_n": self.load_n, "pressure_pa": None if self.pressure_measured else self.pressure_pa}
        return frozenset(name for name, value in unmeasured.items() if value is not None)

    @property
    def sources(self) -> dict[str, str]:
        """Names and values of the columns that say where load and pressure come from, of those that are known."""
        names = (name for name in SOURCE_COLUMNS if getattr(self, name) is not None)
        return {SOURCE_COLUMNS[name]: source_in(self.stated, name) for name in names}

    @property
    def lateral_gain_std(self) -> float:
        """Relative standard error of the gain of the lateral axis."""
        return math.hypot(self.gain_std, self.claims.lateral_gain_std)


@dataclass(frozen=True, slots=True)
class Revolution:
    """One completed revolution, from one contact centre to the next, in the angle domain.

    The angle grid is theta = -pi + 2 pi k / n, 0 at the contact centre: theta in [0, pi) comes from the first half of
    the revolution, theta in [-pi, 0) from its second half. The sensor enters the contact at negative and leaves it at
    positive theta.

    Attributes:
        index: running number of the wheel's revolutions.
        start_s: hub time of the first contact centre, s since the hub's start.
        period_s: duration.
        omega_radps: mean angular speed, 2 pi turns / period_s.
        omega_dot_radps2: angular acceleration over the revolution.
        radial_mps2: (n,) radial specific force, positive inward, gravity and the revolution's angular
            acceleration removed, so that a steady free-rolling ring gives the same curve every time.
        axes_mps2: (3, n) circumferential, lateral, radial as measured in the angle domain; NaN rows for absent axes.
        orders_mps2: (61,) complex coefficients c - i s of `radial_mps2`, orders 0 to 60: radial = c_0 + sum c_n cos n
            theta + s_n sin n theta; NaN above the highest order that the sampling rate carries.
        order_max: highest order that the sampling rate carries.
        leading_edge_rad: angle of the leading contact edge, negative.
        trailing_edge_rad: angle of the trailing contact edge, positive.
        leading_edge_std_rad: one standard error.
        trailing_edge_std_rad: one standard error.
        noise_mps2: estimated standard deviation of the noise of one angle-domain sample of `radial_mps2`.
        missing_fraction: share of the revolution's samples that were lost on the link. Without a fault, the angles that
            they leave are filled with the shape of the revolutions before: averages weight it by the rest.
        saturated: True when any radial sample was at the end of the sensor's range.
        ac_coupled: True when the sensor does not pass the steady value.
        faults: why this revolution must not be used for estimates; empty when it may be used.
        period_std_s: one standard error of `period_s` from the timing of its two contacts; NaN when not known.
        rate_hz: sampling rate as measured against the hub's clock; NaN when not known.
        uncorrected: why the known effects of an effects file were not subtracted from `axes_mps2` and what is made of
            them; None when they were, or when there is no such file.
        turns: between the two contacts; more than 1 where contacts between them were not seen.
        corner: of the AC coupling over the wheel's frequency, undone in the axes; 0 for none, or where none is stated.
        assumed_steady: True when the angular acceleration could not be measured, without a revolution before, and is 0.
        follows: True when it begins with the contact that ended the revolution before.
        rate_std: relative standard error of the sampling rate by a hub's clock or sample numbers that are not steady.
        full_scale_mps2: end of the range of the radial axis; NaN when not known.
    """

    index: int
    start_s: float
    period_s: float
    omega_radps: float
    omega_dot_radps2: float
    radial_mps2: FloatArray
    axes_mps2: FloatArray
    orders_mps2: ComplexArray
    order_max: int
    leading_edge_rad: float
    trailing_edge_rad: float
    leading_edge_std_rad: float
    trailing_edge_std_rad: float
    noise_mps2: float
    missing_fraction: float
    saturated: bool
    ac_coupled: bool
    faults: tuple[Reason, ...] = ()
    period_std_s: float = float("nan")
    rate_hz: float = float("nan")
    uncorrected: Reason | None = None
    turns: int = 1
    corner: float = 0.0
    assumed_steady: bool = False
    follows: bool = False
    rate_std: float = 0.0
    full_scale_mps2: float = float("nan")


def sign_not_determined(value: float, std: float) -> Reason:
    """Return the reason of a value whose sign its standard error does not tell."""
    errors = abs(value) / std if std > 0.0 else math.nan
    return (
        Reason(EstimateCode.SIGN_NOT_DETERMINED, why="near_zero", errors=errors)
        if math.isfinite(errors)
        else Reason(EstimateCode.SIGN_NOT_DETERMINED, why="no_error")
    )


OF_LOSS: Final = frozenset(
    {EstimateCode.SAMPLES_LOST, EstimateCode.CONTACT_NOT_SEEN, EstimateCode.CONTACT_INTERPOLATED}
)
"""Faults of a revolution by loss on the link, which says nothing against the tire or the sensor."""


# Share of lost samples up to which nothing of a revolution rests on what stands in its gaps: single samples, no frames.
_EVIDENCE_MISSING: Final = 0.01


def is_evidence(revolution: Revolution) -> bool:
    """Return whether a revolution says anything for or against what is stated of sensor, tire and configuration.

    One with a fault does not, nor one with gaps, however well they are filled: what stands there is of revolutions at
    other speeds, and it is alike in all of them, so that no number of such revolutions averages its error out.
    """
    return not revolution.faults and revolution.missing_fraction <= _EVIDENCE_MISSING


def not_used(faults: Iterable[Reason]) -> Reason:
    """Return the reason of an estimate that a revolution with these faults did not change."""
    return Reason(EstimateCode.REVOLUTION_NOT_USED, faults=tuple(faults))


class Estimator(Protocol):
    """Turns revolutions into estimates; one instance per wheel, deterministic, keeps its own warm start.

    That of a plug-in also has `quantities`, a tuple of `gateway.core.quantity.Quantity`: those that it gives.
    """

    @property
    def name(self) -> str:
        """Name in the registry."""
        ...

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return this revolution's estimates; on bad data they are invalid with a reason, nothing is raised."""
        ...

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        ...
