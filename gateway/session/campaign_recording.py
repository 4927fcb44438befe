"""One recording of a campaign: through the pipeline without estimators, and down to groups."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.batch import FrameBatch
from gateway.closure.collecting import RevolutionStore
from gateway.closure.group_making import Declared, make_groups
from gateway.closure.observation import Group
from gateway.config.vehicle import VehicleConfig, parse_vehicle
from gateway.errors import ConfigError
from gateway.pipeline.results import RevolutionResult
from gateway.reasons import Reason
from gateway.recording.reader import RecordingReader
from gateway.security.guard_setup import open_guard
from gateway.session.batch import estimate_items
from gateway.session.campaign_clock import UNKNOWN, HubClockError
from gateway.session.provenance import GIVEN, RECORDED, assumed, stated
from gateway.session.wheel_identity import SensorsHeard, address, configured
from gateway.views import wording

# With several wheels and none chosen, so many more revolutions are looked at to name the wheels.
_LOOK_ON: Final = 200
# Links whose arrival times are made up from the samples' own.
_WITHOUT_HOST_TIME: Final = ("import:", "dump:")


@dataclass(frozen=True, slots=True)
class ReadOrder:
    """What is to be read.

    Attributes:
        path: the recording.
        index: in the campaign.
        name: for labels.
        vehicle: instead of the recorded configuration, None for that.
        wheel: position, None when there is to be one only.
        folds: blocks of a group.
        reverse: the tire rolled the other way round.
        key_file: keys of signed frames.
    """

    path: Path
    index: int
    name: str
    vehicle: VehicleConfig | None
    wheel: str | None
    folds: int
    reverse: bool = False
    key_file: Path | None = None


@dataclass(frozen=True, slots=True)
class RecordingRead:
    """What one recording gave.

    Attributes:
        wheels: positions that were seen; all of them, unless there are several and none was chosen.
        groups: of the chosen or only wheel; times are the host's.
        first_s: host time of the first revolution used.
        last_s: of the last.
        host_times: whether these are real.
        rejected: reason -> revolutions.
        clock_error: of the wheel's hub.
        assumed: what nobody stated.
        stated: what somebody stated or measured, and who.
        damage: what could not be read.
        sensor_id: serial number of the wheel's sensor, None when several took turns.
        notes: what the user must know of it.
    """

    wheels: tuple[str, ...]
    groups: tuple[Group, ...] = ()
    first_s: float = 0.0
    last_s: float = 0.0
    host_times: bool = False
    rejected: dict[str, int] | None = None
    clock_error: tuple[float, float] = UNKNOWN
    assumed: tuple[str, ...] = ()
    stated: tuple[str, ...] = ()
    damage: Reason | None = None
    sensor_id: int | None = None
    notes: tuple[str, ...] = ()


class _SeveralWheelsError(Exception):
    """There is no point in reading on."""


class _Taker:
    """Takes results and keeps those of one wheel."""

    def __init__(self, order: ReadOrder) -> None:
        self.wheels: dict[str, int] = {}
        self.store = RevolutionStore(order.reverse)
        self.last: RevolutionResult | None = None
        self._wheel = order.wheel
        self._more = _LOOK_ON

    def __call__(self, result: RevolutionResult) -> None:
        self.wheels[result.position] = self.wheels.get(result.position, 0) + 1
        if self._wheel is None and len(self.wheels) > 1:
            self._more -= 1
            if self._more < 0:
                raise _SeveralWheelsError
        if result.position == (self._wheel or next(iter(self.wheels))):
            self.store.take(result.revolution, result.conditions, result.host_ns)
            self.last = result


def read_recording(order: ReadOrder, on_position: Callable[[int], None] | None = None) -> RecordingRead:
    """Read one recording.

    Args:
        order: what is to be read.
        on_position: called with the bytes of the file read so far.

    Raises:
        TreadlinkError: the file, its configuration or the keys cannot be read.
    """
    reader = RecordingReader(order.path)
    vehicle = order.vehicle
    if vehicle is None and reader.vehicle_toml:
        vehicle = parse_vehicle(reader.vehicle_toml, str(order.path))
    taker, clock = _Taker(order), HubClockError()
    links: set[str] = set()
    sensors = SensorsHeard()

    def on_bytes(_: int) -> None:
        if on_position is not None:
            on_position(reader.position)

    def on_batch(link: str, batch: FrameBatch, arrivals_ns: NDArray[np.int64]) -> None:
        links.add(link)
        clock.take(link, batch, arrivals_ns)
        sensors.take(batch)

    guard = open_guard(vehicle, order.key_file, remembers=False)
    try:
        estimate_items(reader, vehicle, taker, estimators=(), on_bytes=on_bytes, guard=guard, on_batch=on_batch)
    except _SeveralWheelsError:
        return RecordingRead(tuple(taker.wheels))
    if on_position is not None:
        on_position(reader.info.size_bytes)
    wheels = tuple(taker.wheels)
    told = tuple(guard.findings()) if guard is not None else ()
    if taker.last is None or (order.wheel is None and len(wheels) > 1):
        return RecordingRead(wheels, damage=reader.damage, notes=(*told, *sensors.strangers(vehicle, wheels)))
    position = taker.last.position
    seen = sensors.at(vehicle, position)
    strangers = tuple(sensors.strangers(vehicle, [position]))
    wheel = configured(vehicle, position)
    if order.vehicle is not None and wheel is not None and strangers and wheel.sensor_number not in seen:
        raise ConfigError(
            f"'{order.path}' is not of the configuration given: {'; '.join(strangers)}",
            "Give the configuration of this wheel, or correct the sensor_id in it."
            + (" Without --config the recording's own is used." if reader.vehicle_toml else ""),
        )
    table = taker.store.table()
    declared = Declared(
        name=order.name,
        recording=order.index,
        radius_m=taker.last.conditions.radius_m,
        offset_m=wheel.mounting.offset_m if wheel is not None else 0.0,
        roll_rad=wheel.mounting.roll_rad if wheel is not None else 0.0,
        pitch_rad=wheel.mounting.pitch_rad if wheel is not None else 0.0,
        reverse=order.reverse,
        ac_coupled=taker.store.ac_coupled,
    )
    groups = make_groups(table, declared, order.folds, taker.store.reject) if len(table) else []
    host_s = table["host_s"]
    real = bool(links) and not any(link.startswith(_WITHOUT_HOST_TIME) for link in links)
    where = address(vehicle, position)
    return RecordingRead(
        wheels=wheels,
        groups=tuple(groups),
        first_s=float(host_s.min()) if len(table) else 0.0,
        last_s=float(host_s.max()) if len(table) else 0.0,
        host_times=real,
        rejected={_text(reason): count for reason, count in taker.store.rejected.items()},
        clock_error=clock.error(where[0]) if real and where is not None else UNKNOWN,
        assumed=assumed(vehicle, wheel, groups),
        stated=stated(
            vehicle,
            wheel,
            groups,
            RECORDED if order.vehicle is None else GIVEN,
            pressure_measured=sensors.measures_pressure(vehicle, position),
        ),
        damage=reader.damage,
        sensor_id=next(iter(seen)) if len(seen) == 1 else None,
        notes=(*(told or strangers), *taker.store.notes()),
    )


def _text(reason: str | Reason) -> str:
    return wording.text(reason) if isinstance(reason, Reason) else reason
