"""Series that trends follow: declared quantities, and what else a recording says of a tire and its sensor."""

import math
from typing import Final, NamedTuple

from gateway.core.quantity import Basis, Statement, Trend, Watch
from gateway.core.quantity_catalogue import declared
from gateway.fleet.reasons import FleetCode


class Series(NamedTuple):
    """A series: its name in the table of recordings, its label, and how trends follow it."""

    name: str
    label: str
    watch: Watch


_OF_RECORDINGS: Final = (
    # Refills that are not seen make steps down of nearly this in a leak. A rise is a refill.
    Series(
        "pressure_at_20_degc",
        "pressure at 20 °C",
        Watch(
            number="pressure",
            unit="kPa",
            notable=5.0,
            trend=Trend.APART,
            worse=-1.0,
            is_drawn=True,
            follows=frozenset(),
            explains=frozenset({Basis.PRESSURE}),
        ),
    ),
    # Less noise, losses or clipping is no fault. Roads differ by up to a factor of two in what they excite.
    Series(
        "noise_mps2",
        "ln noise",
        Watch(
            number="noise",
            unit="%",
            notable=100.0 * math.log(2.0),
            trend=Trend.SENSOR,
            is_logarithm=True,
            worse=1.0,
            is_drawn=True,
            drift=(FleetCode.TREND_SENSOR_NOISE, "factor"),
        ),
    ),
    Series(
        "samples_lost",
        "samples lost",
        Watch(
            number="loss",
            unit="%",
            notable=0.5,
            trend=Trend.SENSOR,
            worse=1.0,
            drift=(FleetCode.TREND_SENSOR_LOSSES, "share"),
        ),
    ),
    Series(
        "samples_saturated",
        "samples at the end of the range",
        Watch(
            number="clipping",
            unit="%",
            notable=0.1,
            trend=Trend.SENSOR,
            worse=1.0,
            drift=(FleetCode.TREND_SENSOR_CLIPS, "share"),
        ),
    ),
    Series(
        "mounting_offset_m",
        "distance from the neutral layer",
        Watch(
            number="offset",
            unit="mm",
            factor=1e3,
            notable=1.0,
            trend=Trend.SENSOR,
            shifted_by=frozenset({Statement.RADIUS}),
            explains=frozenset({Basis.OFFSET}),
            drift=(FleetCode.TREND_SENSOR_MOVES, "change_m"),
        ),
    ),
)
SERIES: Final = {
    series.name: series
    for series in (
        *_OF_RECORDINGS,
        *(
            Series(quantity.column, quantity.label or quantity.name, quantity.watch)
            for quantity in declared()
            if quantity.watch is not None
        ),
    )
}
"""Every series by its name."""


def label_of(name: str) -> str:
    """Return the label of a series; its name where there is no such series."""
    return SERIES[name].label if name in SERIES else name


def followed_by(trend: Trend) -> list[Series]:
    """Return the series of which trends are made in a way."""
    return [series for series in SERIES.values() if series.watch.trend is trend]
