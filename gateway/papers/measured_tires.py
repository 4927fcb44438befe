"""Measured wheels as data of the papers' figures: average, orders and numbers under stated conditions."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.compare.order_statistics import OrderAccumulator, OrderStatistics
from gateway.core.estimates.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions
from gateway.core.estimates.registry import make_estimator
from gateway.core.estimates.revolution_block import extended
from gateway.core.estimates.weighted_mean import WeightedMean, mean_estimate
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.revolutions.synchronous_average import RunningAverage
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.types import FloatArray
from gateway.forces.lateral_deformation import remove_roll
from gateway.forces.lateral_shape import DEFINITIONS, has_lateral, lateral_record
from gateway.forces.ply_steer import ROLL_NAME
from gateway.papers.ring_data import ESTIMATORS
from gateway.ring.ring_series import pressure_number

AHEAD: Final = "ahead"
"""Definition whose slope is not in the contact: the one with the trends of the ply steer paper's Figs. 14 and 15."""
SLOPES: Final = {definition: f"ply_steer_{definition}_rad" for definition in (*DEFINITIONS, AHEAD)}
"""Quantity of each definition of the ply steer angle."""
SIDE_FORCE: Final = "side_force_n"
"""Quantity of the side force."""

# The average is that of the whole recording.
_HORIZON_REVOLUTIONS: Final = 10_000.0
_UNKNOWN: Final = (math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class GridConditions:
    """Conditions of a recording as a table states them; None where the recording is to say it.

    Attributes:
        load_n: vertical load.
        pressure_pa: gauge pressure.
        wear_mm: wear of the tread.
        speed_kmh: speed.
    """

    load_n: float | None = None
    pressure_pa: float | None = None
    wear_mm: float | None = None
    speed_kmh: float | None = None


@dataclass(frozen=True, slots=True)
class Waveforms:
    """Signal of a wheel, which a dataset does not have.

    Attributes:
        average: of all usable revolutions.
        orders: spectra over several revolutions, None of fewer.
        lateral_m: (2 k,) mean coefficients of the lateral axis over Omega^2, None without such an axis.
    """

    average: AngleAverage
    orders: OrderStatistics | None
    lateral_m: FloatArray | None


@dataclass(frozen=True, slots=True)
class MeasuredTire:
    """One wheel under one condition; NaN for what is not known.

    Attributes:
        name: recording and wheel.
        load_n: vertical load.
        pressure_pa: gauge pressure.
        wear_mm: wear of the tread.
        speed_kmh: mean speed.
        stated_speed_kmh: as the table of conditions states it.
        radius_m: belt radius.
        edges_rad: leading and trailing edge of the contact.
        numbers: (4,) Bs, Cw, Rs, Ts and their standard errors by estimator; NaN where invalid.
        slopes_rad: ply steer angle and its standard error by definition.
        side_force_n: and its standard error; NaN without a calibration.
        waveforms: None of a dataset.
        fitted_half_angle_rad: stated contact half angle, which Eq. 28 takes; None where it takes the measured one.
    """

    name: str
    load_n: float
    pressure_pa: float
    wear_mm: float
    speed_kmh: float
    stated_speed_kmh: float
    radius_m: float
    edges_rad: tuple[float, float]
    numbers: Mapping[str, tuple[FloatArray, FloatArray]]
    slopes_rad: Mapping[str, tuple[float, float]]
    side_force_n: tuple[float, float] = _UNKNOWN
    waveforms: Waveforms | None = None
    fitted_half_angle_rad: float | None = None

    @property
    def half_angle_rad(self) -> float:
        """Contact half angle."""
        return 0.5 * (self.edges_rad[1] - self.edges_rad[0])

    @property
    def pressure_number(self) -> float:
        """Pn = Q / (2 p0 theta_r R^2) (Eq. 33)."""
        if not (self.pressure_pa > 0.0 and self.half_angle_rad > 0.0):
            return math.nan
        return pressure_number(self.load_n, self.pressure_pa, self.radius_m, self.half_angle_rad)


class MeasuredWheel:
    """Collects the revolutions of one wheel."""

    def __init__(self, name: str, stated: GridConditions) -> None:
        """Start empty.

        Args:
            name: of recording and wheel.
            stated: conditions that replace those of the recording.
        """
        self._name, self._overrides = name, stated
        self._running = RunningAverage(horizon_revolutions=_HORIZON_REVOLUTIONS)
        self._orders: OrderAccumulator | None = None
        self._last: tuple[Revolution, AngleAverage, TireConditions] | None = None
        self._speed = WeightedMean()
        self._means = {quantity: WeightedMean() for quantity in (*SLOPES.values(), SIDE_FORCE)}
        self._lateral: list[FloatArray] = []
        self._roll_rad = 0.0

    def add(self, revolution: Revolution, conditions: TireConditions, estimates: Sequence[Estimate]) -> None:
        """Take a revolution; one with a fault is left out."""
        if revolution.faults:
            return
        if self._orders is None:
            self._orders = OrderAccumulator(revolution.omega_radps)
        average = extended(self._running, revolution)
        self._orders.add(
            revolution.index,
            revolution.axes_mps2,
            revolution.omega_radps,
            revolution.order_max,
            follows=revolution.follows,
        )
        self._last = revolution, average, conditions
        self._speed.add(3.6 * revolution.omega_radps * conditions.radius_m, math.nan)
        for estimate in estimates:
            if estimate.name in self._means and estimate.status is Status.VALID:
                self._means[estimate.name].add(estimate.value, estimate.std)
            if estimate.name == ROLL_NAME and estimate.status is not Status.INVALID:
                self._roll_rad = estimate.value
        if has_lateral(revolution):
            # Lateral and radial axis as they are: only the latest roll is a good one.
            self._lateral.append(np.stack([lateral_record(revolution, a).lateral_m for a in (0.0, -0.5 * math.pi)]))

    def tire(self) -> MeasuredTire | None:
        """Return the wheel, None without a usable revolution."""
        if self._last is None:
            return None
        revolution, average, conditions = self._last
        overrides = self._overrides
        if overrides.load_n is not None:
            conditions = replace(conditions, load_n=overrides.load_n, load_std_n=0.0)
        if overrides.pressure_pa is not None:
            conditions = replace(conditions, pressure_pa=overrides.pressure_pa, pressure_std_pa=0.0)
        wear_mm = overrides.wear_mm
        if wear_mm is None and conditions.tire.wear_m is not None:
            wear_mm = 1e3 * conditions.tire.wear_m
        lateral = np.mean(self._lateral, axis=0) if self._lateral else None
        return MeasuredTire(
            name=self._name,
            load_n=_number(conditions.load_n),
            pressure_pa=_number(conditions.pressure_pa),
            wear_mm=_number(wear_mm),
            speed_kmh=_number(self._speed.value),
            stated_speed_kmh=_number(overrides.speed_kmh),
            radius_m=conditions.radius_m,
            edges_rad=(average.leading_edge_rad, average.trailing_edge_rad),
            numbers={name: _numbers(name, revolution, average, conditions) for name in ESTIMATORS},
            slopes_rad={definition: _mean(name, self._means[name]) for definition, name in SLOPES.items()},
            side_force_n=_mean(SIDE_FORCE, self._means[SIDE_FORCE]),
            waveforms=Waveforms(
                average,
                self._orders.statistics() if self._orders is not None else None,
                remove_roll(lateral[0], lateral[1], self._roll_rad) if lateral is not None else None,
            ),
            fitted_half_angle_rad=conditions.tire.half_angle_rad,
        )


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _mean(name: str, mean: WeightedMean) -> tuple[float, float]:
    if not mean.count:
        return _UNKNOWN
    estimate = mean_estimate(mean, quantity_of(name).correlated_revolutions)
    return estimate.value, estimate.std


def _numbers(
    estimator: str, revolution: Revolution, average: AngleAverage, conditions: TireConditions
) -> tuple[FloatArray, FloatArray]:
    """Return the four numbers of an average and their errors; NaN where invalid."""
    numbers = {
        estimate.name: (estimate.value, estimate.std)
        for estimate in make_estimator(estimator).update(revolution, average, conditions)
        if estimate.status is not Status.INVALID
    }
    values, stds = np.array([numbers.get(number, _UNKNOWN) for number in RING_NUMBERS], np.float64).T
    return values, stds
