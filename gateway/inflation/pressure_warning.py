"""Warning of low pressure and of a failed measurement, as UN R141 wants them of a tire pressure monitoring system.

UN R141, 01 series of amendments (ECE/TRANS/WP.29/2021/10/Rev.1): a warning within 10 min after a tire has lost 20 % of
its warm pressure or is at 150 kPa, whichever is higher (5.2, puncture); within 60 min of driving where up to four tires
lost it slowly (5.3, diffusion); within 10 min after a malfunction (5.4). A loss is that at one temperature.
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from gateway.core.config.vehicle import VehicleConfig
from gateway.core.constants import STANDARD_ATMOSPHERE_PA, ZERO_CELSIUS_K
from gateway.core.estimates.results import Alarm, WheelSnapshot, WheelState
from gateway.core.reasons import Reason, Value
from gateway.core.trust.sensor_health import PRESSURE_FROZEN
from gateway.inflation.placard import Placard, PlacardTable
from gateway.inflation.reasons import InflationCode

LOW: Final = "low pressure"
NOT_MONITORED: Final = "pressure not monitored"

_REFERENCE_DEGC: Final = 20.0
_DEFICIT_SHARE: Final = 0.2
_LEAST_PA: Final = 150e3
# A tire whose own pressure is about the least one is not low.
_LEAST_OF_WARM: Final = 0.9
# Error of a sensor that states none, as of a workshop's gauge.
_GAUGE_PA: Final = 3e3
# A reading may be wrong: the pressure is low for so long, and no longer low above this share of the limit.
_CONFIRMED_S: Final = 10.0
_HYSTERESIS: Final = 1.02
# Half of the time that the rule leaves.
_MISSING_S: Final = 300.0
# Driving time over which a fast loss is recognised: that within which a puncture must be warned of. A liner that warms
# before the air in the tire feigns a fall of up to a twentieth.
_WINDOW_S: Final = 600.0
_SPACING_S: Final = 5.0
_FAST_FALL_SHARE: Final = 0.08
# A wheel without results for longer stood still.
_STANDING_S: Final = 5.0


@dataclass(slots=True)
class _WatchedTire:
    """Readings of one tire. Times are of driving, apart from those of single readings."""

    placard: Placard
    gauge_pa: float
    coldest_degc: float = math.inf
    latest_degc: float = -math.inf
    last_s: float | None = None
    driven_s: float = 0.0
    current_at_s: float = 0.0
    low_since_s: float | None = None
    at_one_temperature_pa: deque[tuple[float, float, bool]] = field(default_factory=deque)
    low: Reason | None = None
    not_monitored: Reason | None = None

    def take(self, wheel: WheelSnapshot, at_s: float, *, is_current: bool, is_driving: bool) -> None:
        elapsed_s = 0.0 if self.last_s is None else at_s - self.last_s
        self.last_s = at_s
        if is_driving and 0.0 < elapsed_s < _STANDING_S:
            self.driven_s += elapsed_s
        pressure_pa = wheel.pressure_pa if is_current and "pressure_pa" not in wheel.stated else None
        is_frozen = any(flag.name == PRESSURE_FROZEN for flag in wheel.flags)
        if pressure_pa is None or is_frozen:
            missing_s = self.driven_s - self.current_at_s
            if is_frozen or missing_s >= _MISSING_S:
                cause = "frozen" if is_frozen else "missing"
                self.not_monitored = Reason(InflationCode.PRESSURE_NOT_MONITORED, cause=cause, driven_s=missing_s)
            return
        self.not_monitored, self.current_at_s = None, self.driven_s
        degc = wheel.temperature_degc
        if degc is not None and degc != self.latest_degc:
            # One reading may be wrong, and held: of two that follow each other the warmer counts.
            self.coldest_degc = min(max(degc, self.latest_degc), self.coldest_degc)
            self.latest_degc = degc
        self._judge(wheel, degc, pressure_pa, at_s)

    def _judge(self, wheel: WheelSnapshot, degc: float | None, pressure_pa: float, at_s: float) -> None:
        warm_pa = self.placard.warm_pa(wheel.load_n, degc, self.coldest_degc)
        limit_pa = max((1.0 - _DEFICIT_SHARE) * warm_pa, min(_LEAST_PA, _LEAST_OF_WARM * warm_pa)) + self.gauge_pa
        kelvin = ZERO_CELSIUS_K + (_REFERENCE_DEGC if degc is None else degc)
        cold_pa = (pressure_pa + STANDARD_ATMOSPHERE_PA) * (ZERO_CELSIUS_K + _REFERENCE_DEGC) / kelvin
        history = self.at_one_temperature_pa
        while history and self.driven_s - history[0][1] > _WINDOW_S:
            history.popleft()
        if not history or self.driven_s - history[-1][1] >= _SPACING_S:
            history.append((cold_pa, self.driven_s, degc is None))
        if pressure_pa > (limit_pa if self.low is None else _HYSTERESIS * limit_pa):
            self.low_since_s = self.low = None
            return
        if self.low_since_s is None:
            self.low_since_s = at_s
        if at_s - self.low_since_s < _CONFIRMED_S:
            return
        # Likewise the lower pressure; one without a temperature is not corrected, and compares with its like.
        pairs = pairwise(entry for entry in history if entry[2] is (degc is None))
        highest_pa, highest_at_s, _ = max(map(min, pairs), default=(cold_pa, self.driven_s, False))
        is_fast = highest_pa - cold_pa > _FAST_FALL_SHARE * highest_pa
        course: dict[str, Value] = {
            "course": "fast" if is_fast else "slow",
            "fall_pa": highest_pa - cold_pa,
            "span_s": self.driven_s - (highest_at_s if is_fast else history[0][1]),
        }
        if self.low is not None and self.low["course"] == "fast" and not is_fast:
            # A puncture stays one after the time over which its fall is seen.
            course = {name: self.low[name] for name in course}
        self.low = Reason(
            InflationCode.PRESSURE_BELOW_PLACARD,
            pressure_pa=pressure_pa,
            share=1.0 - pressure_pa / warm_pa,
            warm_pa=warm_pa,
            placard_pa=self.placard.cold_pa(wheel.load_n),
            at="unknown" if degc is None else "warm",
            temperature_degc=0.0 if degc is None else degc,
            **course,
        )


class PressureWarning:
    """Warns of the tires of a vehicle that state a placard.

    Attributes:
        names: of its alarms.
    """

    names: Final = frozenset({LOW, NOT_MONITORED})

    def __init__(self, placards: Mapping[str, tuple[Placard, float]]) -> None:
        """Start without a reading, with the placard of each position and the standard error of its sensor in Pa."""
        self._tires = {
            position: _WatchedTire(placard, 2.0 * std_pa or _GAUGE_PA)
            for position, (placard, std_pa) in placards.items()
        }
        self._rolling_at_s = -math.inf

    def take(self, wheel: WheelSnapshot, at_s: float, *, is_current: bool) -> None:
        """Take the state of a wheel at a time; one without a placard is not watched.

        A wheel that sends nothing drives while another one rolls.
        """
        is_driving = wheel.state is WheelState.ROLLING
        if is_driving:
            self._rolling_at_s = at_s
        elif wheel.state in (WheelState.NO_DATA, WheelState.SILENT):
            is_driving = at_s - self._rolling_at_s < _STANDING_S
        tire = self._tires.get(wheel.position)
        if tire is not None:
            tire.take(wheel, at_s, is_current=is_current, is_driving=is_driving)

    def alarms(self) -> Iterator[Alarm]:
        """Yield the present alarms."""
        for position, tire in self._tires.items():
            if tire.low is not None:
                yield Alarm(position, LOW, tire.low)
            if tire.not_monitored is not None:
                yield Alarm(position, NOT_MONITORED, tire.not_monitored)


def pressure_warning(vehicle: VehicleConfig) -> PressureWarning | None:
    """Return the warning for a vehicle, None where no tire states a placard."""
    tires = {wheel.position: vehicle.tire_of(wheel) for wheel in vehicle.wheel}
    placards = {
        position: (table.data(), tire.pressure_std_pa)
        for position, tire in tires.items()
        if (table := tire.added(PlacardTable)) is not None
    }
    return PressureWarning(placards) if placards else None
