"""Alarms: crossed thresholds of the configuration, silence, and faults of sensors and links, from the latest snapshot.

A threshold alarm that stands is over only when the value has returned beyond the limit by a margin, so that a value at
its limit raises one alarm and not many.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import StrEnum
from types import MappingProxyType
from typing import Final, Generic, NamedTuple, TypeVar

from gateway.core.config.vehicle import Thresholds
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import (
    Alarm,
    DiskRoom,
    LinkSnapshot,
    SilentPart,
    SinkSnapshot,
    SinkState,
    WheelSnapshot,
)
from gateway.core.reasons import Code, Reason
from gateway.core.session.frame_guard import SUSPICIOUS
from gateway.core.session.link_health import hub_name
from gateway.core.session.reasons import SessionCode
from gateway.core.session.silence import SilentHub, SilentVehicle
from gateway.core.session.wheel_identity import misplaced_sensor

_Of = TypeVar("_Of")
AlarmKey = tuple[str, str]
"""Position and name of an alarm."""

HubNames = dict[tuple[str, int], str]
"""Names that hubs have in alarms, by link and number: each keeps its first, whatever links come after it."""

NONE_STANDING: Final[Mapping[AlarmKey, Code]] = MappingProxyType({})
_SPEED: Final = "speed_mps"
# Share of the limit by which a value must return before its alarm is over.
_MARGIN: Final = 0.02
# A live output that is away for a shorter time is no alarm.
_SINK_AWAY_S: Final = 2.0
RECORDING: Final = "recording"
"""Position of alarms of the recording."""
# Time to react to a disk that fills up, and the time with which its alarm is over again.
_DISK_SHORT_S: Final = 600.0
_DISK_ENOUGH_S: Final = 900.0
_DISK_MIN_BYTES: Final = 50_000_000


class AlarmName(StrEnum):
    """Names of the alarms, as printed; those of sensor faults are the names of their flags."""

    BATTERY = "battery"
    DISK = "disk"
    ENVIRONMENT = "old environment"
    LINK = "link"
    LOAD = "load"
    LOSS = "loss"
    MISPLACED = "wrong sensor"
    PRESSURE = "pressure"
    PUBLISHING = "publishing"
    SATURATED = "saturated"
    SECURITY = "security"
    SILENT = "silent"
    SPEED = "speed"
    STOPPED = "stopped"
    TEMPERATURE = "temperature"
    WEAR = "wear"


SILENCES: Final = frozenset({AlarmName.SILENT, AlarmName.ENVIRONMENT})
"""Alarms whose reason has the value `silence_s`."""

THRESHOLDS: Final = frozenset(
    {AlarmName.LOAD, AlarmName.PRESSURE, AlarmName.SPEED, AlarmName.TEMPERATURE, AlarmName.WEAR}
)
"""Alarms of limits that the configuration states for wheels."""


def alarms(
    wheels: Sequence[WheelSnapshot],
    links: Sequence[LinkSnapshot],
    thresholds: Thresholds,
    sensor_ids: Mapping[str, str] | None = None,
    *,
    standing: Mapping[AlarmKey, Code] = NONE_STANDING,
) -> tuple[Alarm, ...]:
    """Return the present alarms of wheels and links, without those of silence.

    Args:
        wheels: latest state of the wheels.
        links: latest state of the links.
        thresholds: of the configuration.
        sensor_ids: configured sensors, hex text by position.
        standing: alarms that stood before, with the codes of their reasons.
    """
    wheel_alarms = [alarm for wheel in wheels for alarm in _wheel_alarms(wheel, thresholds, standing)]
    misplaced = _misplaced_sensors(wheels, sensor_ids or {})
    link_alarms = [alarm for link in links for alarm in _link_alarms(link, thresholds, standing)]
    return (*wheel_alarms, *misplaced, *link_alarms)


def silent_alarms(
    wheels: Iterable[WheelSnapshot],
    silent_hubs: Iterable[SilentHub],
    silent_vehicles: Iterable[SilentVehicle],
    names: HubNames,
    *,
    several_links: bool,
) -> tuple[Alarm, ...]:
    """Return the present alarms of silence.

    Args:
        wheels: with their silences.
        silent_hubs: hubs that send no frame.
        silent_vehicles: vehicle buses and receivers that are silent, and receivers without a position.
        names: of hubs; new ones are added.
        several_links: whether new names have the links too.
    """
    of_hubs = _hub_alarms(silent_hubs, names, several_links)
    return (*of_hubs, *_wheel_silences(wheels), *_vehicle_alarms(silent_vehicles))


def _hub_alarms(silent_hubs: Iterable[SilentHub], names: HubNames, several_links: bool) -> Iterator[Alarm]:
    """Yield the alarm of each silent hub; hubs of different links may have the same number."""
    for silent in silent_hubs:
        new_name = hub_name(silent.hub) + (f" on {silent.link}" if several_links else "")
        name = names.setdefault((silent.link, silent.hub), new_name)
        reason = Reason(SessionCode.HUB_SILENT, silence_s=silent.age_s, wheels=silent.positions)
        yield Alarm(name, AlarmName.SILENT, reason)


def _vehicle_alarms(silent_vehicles: Iterable[SilentVehicle]) -> Iterator[Alarm]:
    """Yield the alarm of each silent vehicle bus or receiver."""
    for silent in silent_vehicles:
        yield Alarm(silent.link, AlarmName.SILENT, silent.reason)


def _wheel_silences(wheels: Iterable[WheelSnapshot]) -> Iterator[Alarm]:
    """Yield the alarms of silent sensors, axes and environments; a link or a hub that is silent has its own."""
    for wheel in wheels:
        for silence in wheel.silences:
            if silence.is_certain and silence.part not in (SilentPart.LINK, SilentPart.HUB):
                is_old = silence.part is SilentPart.ENVIRONMENT
                yield Alarm(wheel.position, AlarmName.ENVIRONMENT if is_old else AlarmName.SILENT, silence.reason)


def sink_alarms(sinks: Iterable[SinkSnapshot]) -> Iterator[Alarm]:
    """Yield the alarm of each live output that drops items, or whose receiver has been away for some time."""
    for sink in sinks:
        if sink.is_dropping:
            reason = Reason(SessionCode.SINK_DROPS, dropped=sink.dropped, state=sink.note)
        elif sink.since_s >= _SINK_AWAY_S and sink.state is not SinkState.ENDED:
            reason = Reason(SessionCode.SINK_DOWN, waiting=sink.waiting, state=sink.note)
        else:
            continue
        yield Alarm(sink.sink, AlarmName.PUBLISHING, reason)


def disk_alarm(room: DiskRoom | None, standing: Mapping[AlarmKey, Code] = NONE_STANDING) -> Iterator[Alarm]:
    """Yield the alarm of a disk that will be full soon."""
    if room is None:
        return
    if room.refusal:
        yield Alarm(RECORDING, AlarmName.DISK, Reason(SessionCode.RECORDING_PART_REFUSED, error=room.refusal))
        return
    limit_s = _DISK_ENOUGH_S if (RECORDING, AlarmName.DISK) in standing else _DISK_SHORT_S
    if room.left_s is not None and room.left_s < limit_s:
        yield Alarm(
            RECORDING,
            AlarmName.DISK,
            Reason(SessionCode.DISK_SPACE, lasts="minutes", free_bytes=room.free_bytes, left_s=room.left_s),
        )
    elif room.left_s is None and room.free_bytes < _DISK_MIN_BYTES:
        yield Alarm(
            RECORDING, AlarmName.DISK, Reason(SessionCode.DISK_SPACE, lasts="little", free_bytes=room.free_bytes)
        )


def superseded(
    wheels: Iterable[WheelSnapshot],
    hubs_of_down_links: Iterable[SilentHub],
    vehicles_of_down_links: Iterable[SilentVehicle],
    names: HubNames,
    *,
    several_links: bool,
) -> frozenset[AlarmKey]:
    """Return the alarms that a wider silence hides: nothing new is known of them, so they are not over."""
    hubs = tuple(hubs_of_down_links)
    wide_alarms = (*_hub_alarms(hubs, names, several_links), *_vehicle_alarms(vehicles_of_down_links))
    hidden = {(alarm.position, alarm.name) for alarm in wide_alarms}
    hidden |= {(position, name) for hub in hubs for position in hub.positions for name in SILENCES}
    for wheel in wheels:
        silence = wheel.silence
        if silence is None:
            continue
        hidden |= {(wheel.position, AlarmName.SPEED), (wheel.position, AlarmName.LOAD)}
        if silence.part in (SilentPart.LINK, SilentPart.HUB, SilentPart.SENSOR) or not silence.is_certain:
            hidden |= {(wheel.position, name) for name in SILENCES}
    return frozenset(hidden)


def _misplaced_sensors(wheels: Sequence[WheelSnapshot], configured: Mapping[str, str]) -> Iterator[Alarm]:
    """Yield an alarm for each wheel whose sensor is another than the configured one."""
    for wheel in wheels:
        reason = misplaced_sensor(wheel.position, wheel.sensor_id, configured)
        if reason is not None:
            yield Alarm(wheel.position, AlarmName.MISPLACED, reason)


class _Limit(NamedTuple, Generic[_Of]):
    """A kind of threshold of wheels or links: an upper one, or a lower one where `is_lower` is set.

    Attributes:
        name: of its alarm.
        stated: returns the limit, None where none is stated.
        value: returns the present value, None where it is unknown.
        quantity: of value and limit, in the alarm's reason.
        is_lower: whether the alarm is below the limit.
    """

    name: AlarmName
    stated: Callable[[Thresholds], float | None]
    value: Callable[[_Of], float | None]
    quantity: str
    is_lower: bool = False

    def crossed(self, value: float, limit: float, stood: Code | None) -> Reason | None:
        """Return the reason of the alarm, None when there is none; `stood` is that of the alarm that stood before."""
        code = SessionCode.VALUE_BELOW_LIMIT if self.is_lower else SessionCode.VALUE_ABOVE_LIMIT
        reason = Reason(code, quantity=self.quantity, value=value, limit=limit)
        margin = _MARGIN * abs(limit) if stood is reason.code else 0.0
        excess = limit - value if self.is_lower else value - limit
        return reason if excess > -margin else None


def _speed_mps(wheel: WheelSnapshot) -> float | None:
    if wheel.silence is not None or wheel.last is None:
        return None
    speeds = (estimate for estimate in wheel.last.estimates if estimate.name == _SPEED)
    return next((estimate.value for estimate in speeds if estimate.status != Status.INVALID), None)


_WHEEL_LIMITS: Final = (
    _Limit[WheelSnapshot](
        AlarmName.PRESSURE,
        lambda limits: limits.pressure_min_pa,
        lambda wheel: wheel.pressure_pa,
        "pressure_pa",
        is_lower=True,
    ),
    _Limit[WheelSnapshot](
        AlarmName.PRESSURE,
        lambda limits: limits.pressure_max_pa,
        lambda wheel: wheel.pressure_pa,
        "pressure_pa",
    ),
    _Limit[WheelSnapshot](
        AlarmName.TEMPERATURE,
        lambda limits: limits.temperature_max_degc,
        lambda wheel: wheel.temperature_degc,
        "temperature_degc",
    ),
    _Limit[WheelSnapshot](
        AlarmName.LOAD,
        lambda limits: limits.load_max_n,
        lambda wheel: wheel.load_n if wheel.silence is None else None,
        "load_n",
    ),
    _Limit[WheelSnapshot](
        AlarmName.SPEED,
        lambda limits: limits.speed_max_mps,
        _speed_mps,
        "speed_mps",
    ),
    _Limit[WheelSnapshot](
        AlarmName.WEAR,
        lambda limits: limits.wear_max_m,
        lambda wheel: wheel.wear_mm.value * 1e-3 if wheel.wear_mm is not None else None,
        "wear_m",
    ),
)
_LINK_LIMITS: Final = (
    _Limit[LinkSnapshot](
        AlarmName.LOSS,
        lambda limits: limits.frame_loss_max,
        lambda link: link.recent_loss,
        "frame_loss",
    ),
    _Limit[LinkSnapshot](
        AlarmName.BATTERY,
        lambda limits: limits.battery_min_percent / 100.0 if limits.battery_min_percent is not None else None,
        lambda link: link.battery_percent / 100.0 if link.battery_percent is not None else None,
        "battery",
        is_lower=True,
    ),
)


def has_wheel_limits(limits: Thresholds) -> bool:
    """Return whether any limit of wheels is stated; without one no threshold alarm of a wheel can be raised."""
    return any(kind.stated(limits) is not None for kind in _WHEEL_LIMITS)


def present_values(
    wheels: Iterable[WheelSnapshot], links: Iterable[LinkSnapshot], limits: Thresholds
) -> dict[AlarmKey, Reason]:
    """Return the present value of each threshold, by the alarm that it would raise."""
    wheel_sources = ((wheel.position, wheel, _WHEEL_LIMITS) for wheel in wheels)
    link_sources = ((link.link, link, _LINK_LIMITS) for link in links)
    return {**_present(wheel_sources, limits), **_present(link_sources, limits)}


def _present(sources: Iterable[tuple[str, _Of, Iterable[_Limit[_Of]]]], limits: Thresholds) -> dict[AlarmKey, Reason]:
    return {
        (position, kind.name): Reason(SessionCode.VALUE_NOW, quantity=kind.quantity, value=value)
        for position, item, kinds in sources
        for kind, value, _ in _known(item, kinds, limits)
    }


def _known(item: _Of, kinds: Iterable[_Limit[_Of]], limits: Thresholds) -> Iterator[tuple[_Limit[_Of], float, float]]:
    """Yield the stated thresholds of a wheel or link whose values are known, with value and limit."""
    for kind in kinds:
        limit = kind.stated(limits)
        value = kind.value(item) if limit is not None else None
        if limit is not None and value is not None:
            yield kind, value, limit


def _crossed(
    position: str, item: _Of, kinds: Iterable[_Limit[_Of]], limits: Thresholds, standing: Mapping[AlarmKey, Code]
) -> Iterator[Alarm]:
    for kind, value, limit in _known(item, kinds, limits):
        reason = kind.crossed(value, limit, standing.get((position, kind.name)))
        if reason is not None:
            yield Alarm(position, kind.name, reason)


def threshold_alarms(
    wheel: WheelSnapshot, limits: Thresholds, standing: Mapping[AlarmKey, Code] = NONE_STANDING
) -> tuple[Alarm, ...]:
    """Return the alarms of the limits that the configuration states for wheels."""
    return tuple(_crossed(wheel.position, wheel, _WHEEL_LIMITS, limits, standing))


def _wheel_alarms(wheel: WheelSnapshot, limits: Thresholds, standing: Mapping[AlarmKey, Code]) -> Iterator[Alarm]:
    yield from threshold_alarms(wheel, limits, standing)
    for flag in wheel.flags:
        yield Alarm(wheel.position, flag.name, flag.reason)
    saturated = wheel.counters.samples_saturated
    if saturated:
        yield Alarm(wheel.position, AlarmName.SATURATED, Reason(SessionCode.SENSOR_RANGE_REACHED, count=saturated))


def _link_alarms(link: LinkSnapshot, limits: Thresholds, standing: Mapping[AlarmKey, Code]) -> Iterator[Alarm]:
    if not link.connected:
        yield Alarm(link.link, AlarmName.LINK, Reason(SessionCode.LINK_DOWN, state=link.note))
    yield from _crossed(link.link, link, _LINK_LIMITS, limits, standing)
    suspicious = tuple(
        Reason(SessionCode.FRAMES_VERDICT, verdict=str(verdict), count=count)
        for verdict in SUSPICIOUS
        if (count := link.judged.get(verdict))
    )
    if suspicious:
        yield Alarm(link.link, AlarmName.SECURITY, Reason(SessionCode.FRAMES_NOT_TRUSTED, counts=suspicious))
