"""Results of trends: numbers with errors and validity, series for figures, outliers."""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from gateway.core.estimates.estimator import Status
from gateway.core.quantity import Quantity as Declared
from gateway.core.quantity import Watch
from gateway.core.reasons import Reason
from gateway.core.shown_units import ShownUnits
from gateway.core.types import BoolArray, FloatArray

UNKNOWN_VEHICLE: Final = "unknown"
"""Name of the vehicle of recordings whose configuration names none, or that have no configuration."""


class Quantity(StrEnum):
    """Numbers of a trend that are no plain rate of a series. Reference: docs/reference/dataset.md."""

    WEAR_RATE = "wear_rate"
    WEAR_NOW = "wear_now"
    PRESSURE_LOSS = "pressure_loss"
    PRESSURE_NOW = "pressure_now"
    LOAD = "load"
    LOAD_RATE = "load_rate"
    LOAD_SCATTER = "load_scatter"


def rate_of(watch: Watch) -> str:
    """Return the name of the rate of a series."""
    return f"{watch.number}_rate"


def by_temperature(watch: Watch) -> str:
    """Return the name of the change of a series with temperature."""
    return f"{watch.number}_temperature"


def asymmetry_of(quantity: Declared) -> str:
    """Return the name of the number that compares a quantity of left and right wheels."""
    return f"{quantity.compared}_asymmetry"


@dataclass(frozen=True, slots=True)
class TrendNumber:
    """A number of a trend.

    Attributes:
        quantity: what it is: a `Quantity`, or the name of a rate.
        value: in `unit`; NaN when not determined.
        std: one standard error, from the scatter between recordings.
        unit: of both.
        status: valid, provisional (use with care), or invalid (not determined).
        reasons: why, or notes.
        count: recordings used.
        freedom: degrees of freedom of the standard error.
        low: lower end of the 95 % interval.
        high: upper end.
    """

    quantity: str
    value: float = math.nan
    std: float = math.nan
    unit: str = ""
    status: Status = Status.INVALID
    reasons: tuple[Reason, ...] = ()
    count: int = 0
    freedom: int = 0
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True, slots=True)
class TrendSeries:
    """One quantity of a tire over its recordings, for figures.

    Attributes:
        name: of the quantity in the dataset.
        unit: of values.
        against: "months" or "km": the abscissa of the line.
        abscissa: (n,).
        values: (n,).
        stds: (n,) stated standard errors, NaN where unknown.
        expected: (n,) fitted trend.
        is_outlier: (n,).
        steps: indices at which a new level begins.
    """

    name: str
    unit: str
    against: str
    abscissa: FloatArray
    values: FloatArray
    stds: FloatArray
    expected: FloatArray
    is_outlier: BoolArray
    steps: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class TrendOutlier:
    """A recording that does not fit the trend of its tire.

    Attributes:
        vehicle: name.
        position: of the wheel.
        sensor_id: of the tire.
        recording: name of the file.
        path: of the file.
        time_ns: start of the recording.
        name: of the quantity in the dataset.
        value: in `unit`.
        expected: by the trend.
        unit: of both.
        deviation: difference over the scatter.
    """

    vehicle: str
    position: str
    sensor_id: str
    recording: str
    path: str
    time_ns: int
    name: str
    value: float
    expected: float
    unit: str
    deviation: float


@dataclass(frozen=True, slots=True)
class TireTrend:
    """The trends of one tire at one wheel.

    Attributes:
        vehicle: name.
        position: of the wheel.
        sensor_id: of the sensor in the tire; empty when unknown.
        part: 1, or the number of the tire where steps of the wear show that there were several with one sensor.
        first_ns: start of the first recording.
        last_ns: start of the last.
        recordings: number.
        distance_km: driven between them by the odometer, or recorded.
        has_odometer: whether the distance is from an odometer.
        numbers: in the order of Quantity.
        findings: what needs attention, the gravest first.
        series: for figures.
        is_identified: False where the recordings may be of different tires; no number is then valid.
    """

    vehicle: str
    position: str
    sensor_id: str
    part: int
    first_ns: int
    last_ns: int
    recordings: int
    distance_km: float
    has_odometer: bool
    numbers: tuple[TrendNumber, ...]
    findings: tuple[Reason, ...] = ()
    series: tuple[TrendSeries, ...] = ()
    is_identified: bool = True


@dataclass(frozen=True, slots=True)
class PairTrend:
    """Asymmetry of the left and the right wheel of an axle.

    Attributes:
        vehicle: name.
        left: position.
        right: position.
        numbers: left minus right.
    """

    vehicle: str
    left: str
    right: str
    numbers: tuple[TrendNumber, ...]


@dataclass(frozen=True, slots=True)
class FleetTrends:
    """Trends of a whole dataset.

    Attributes:
        tires: by vehicle, wheel and time.
        pairs: wheels of one axle.
        outliers: in the order of tires and time.
        tested: values that were tested for being outliers.
        recordings: in the dataset, with a row or more.
        failures: recordings without results.
        notes: on the whole.
        units: that screens and pages show.
    """

    tires: tuple[TireTrend, ...]
    pairs: tuple[PairTrend, ...]
    outliers: tuple[TrendOutlier, ...]
    tested: int
    recordings: int
    failures: int
    notes: tuple[Reason, ...] = field(default=())
    units: ShownUnits = ShownUnits.SI
