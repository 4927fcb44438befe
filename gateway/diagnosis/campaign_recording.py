"""One recording of a campaign, read through the pipeline without estimators and reduced to groups."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.block_decoder import FrameBatch, SampleGroup
from firmware_protocol.messages import Axis, Hello, MessageType
from gateway.core.config.vehicle import ASSUMED_RADIUS_MM, Mounting, Tire, VehicleConfig, Wheel, shown_units_of
from gateway.core.constants import AXIS_NAMES
from gateway.core.errors import ConfigError
from gateway.core.estimates.results import AlarmRecord, RevolutionResult
from gateway.core.reasons import CoreCode, Notice, Reason
from gateway.core.recording.reader import RecordingReader
from gateway.core.revolutions.bridged_gaps import BridgedGaps
from gateway.core.session.alarms import SILENCES, THRESHOLDS, AlarmName
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass, open_recording
from gateway.core.session.wheel_identity import SensorsHeard, configured, configured_tire, wheel_address
from gateway.core.shown_units import ShownUnits
from gateway.core.text.wording import notice_text
from gateway.core.trust.reasons import TrustCode
from gateway.core.types import FloatArray
from gateway.core.wheels.revolution import SensorReading
from gateway.diagnosis import criteria
from gateway.diagnosis.campaign_clock import UNKNOWN, HubClockError
from gateway.diagnosis.data.campaign_data import Group, Remark, Repeats
from gateway.diagnosis.data.group_statistics import Declared, make_groups
from gateway.diagnosis.data.revolution_orders import RevolutionStore, RevolutionTable
from gateway.diagnosis.data.wheel_rates import without_rates
from gateway.diagnosis.provenance import Quantity, is_assumed, provenance_of
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.repeated_samples import RepeatedSamples

# With several wheels and none chosen, revolutions read on to learn the names of all wheels.
_NAMING_REVOLUTIONS: Final = 200
# Standard error below which a measured offset of the sensor is used where none is stated.
_OFFSET_KNOWN_M: Final = 5e-4
# Faults of a sensor that are listed whenever they stood.
_SENSOR_FAULTS: Final = frozenset(
    {
        TrustCode.SENSOR_DEAD,
        TrustCode.SENSOR_FLIPPED,
        TrustCode.SENSOR_LOOSE,
        TrustCode.SENSOR_STUCK,
        TrustCode.SENSOR_TILTED,
        TrustCode.PRESSURE_FROZEN,
    }
)
# Alarms that make every shape doubtful. What is stuck or dead does not turn, or is left out by axis.
_DOUBTS: Final = frozenset({TrustCode.SENSOR_LOOSE, TrustCode.SENSOR_TILTED})
# By which odds before the data become those of a named effect.
_EVIDENCE_OF_A_RATE: Final = math.log(criteria.NAMED / (1.0 - criteria.NAMED) / criteria.PRIOR_ODDS)
_NOT_RADIAL: Final = (Axis.CIRCUMFERENTIAL, Axis.LATERAL)
_NOT_OF_SENSORS: Final = frozenset({*SILENCES, *THRESHOLDS, AlarmName.LINK})
# Links whose arrival times are derived from the times of the samples.
_WITHOUT_HOST_TIME: Final = ("import:", "dump:")


@dataclass(frozen=True, slots=True)
class ReadOrder:
    """Order to read one recording.

    Attributes:
        path: the recording.
        index: in the campaign.
        name: for labels.
        vehicle: replaces the recorded configuration, None to use that.
        wheel: position, None when there must be one wheel only.
        folds: blocks of a group.
        reverse: the tire rolled in the opposite direction.
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
    """Content of one recording.

    Attributes:
        wheels: positions found; all of them, except when there are several and none was chosen.
        groups: of the chosen or only wheel; times are those of the host.
        first_s: host time of the first revolution used.
        last_s: of the last.
        host_times: whether these are real arrival times.
        rejected: reason -> revolutions.
        clock_error: of the hub of the wheel.
        assumed: conditions that are assumed.
        stated: conditions that are stated or measured, with their source.
        damage: unreadable parts, None without any.
        sensor_id: serial number of the sensor of the wheel, None when there were several.
        notices: of wheels, sensors and signatures.
        remarks: on the signals.
        vehicle: name of the vehicle, empty if unknown.
        tire: size of the wheel's tire, empty if unknown.
        units: that screens show.
    """

    wheels: tuple[str, ...]
    groups: tuple[Group, ...] = ()
    first_s: float = 0.0
    last_s: float = 0.0
    host_times: bool = False
    rejected: Mapping[Reason, int] | None = None
    clock_error: tuple[float, float] = UNKNOWN
    assumed: tuple[Remark, ...] = ()
    stated: tuple[Reason, ...] = ()
    damage: Reason | None = None
    sensor_id: int | None = None
    notices: tuple[Notice, ...] = ()
    remarks: tuple[Reason, ...] = ()
    vehicle: str = ""
    tire: str = ""
    units: ShownUnits = ShownUnits.SI


class _SensorSamples:
    """What the samples of one sensor say of its converter and of gaps."""

    def __init__(self, reading: SensorReading) -> None:
        channels = len(reading.columns)
        self._reading = reading
        self._repeated = RepeatedSamples(channels, reading.saturation_counts)
        self._bridged = BridgedGaps(channels)
        self._next_sample: int | None = None

    def take(self, group: SampleGroup) -> None:
        follows = np.diff(group.first_sample.astype(np.int64)) == group.counts.shape[1]
        is_next = self._next_sample == int(group.first_sample[0])
        for part in np.split(group.counts, np.flatnonzero(~follows) + 1):
            samples = part.reshape(-1, group.counts.shape[2])
            self._repeated.add(samples)
            self._bridged.add(samples, follows=is_next)
            is_next = False
        self._next_sample = int(group.first_sample[-1]) + group.counts.shape[1]

    def repeats(self) -> Repeats | None:
        """Return the repeated samples, None without."""
        repeated = self._repeated.result()
        if repeated is None:
            return None
        return Repeats(repeated.runs, repeated.samples, repeated.total, self._by_axis_mps2(repeated.error_counts))

    def step_mps2(self) -> tuple[float, float, float]:
        """Return the step of the converter by axis, 0 where it is not known."""
        return self._by_axis_mps2(self._repeated.step_counts())

    def remarks(self, repeats: Repeats | None) -> list[Reason]:
        """Return that samples are repeated, and that gaps of the signal are bridged by straight lines."""
        remarks = []
        if repeats is not None:
            share = repeats.samples / repeats.total
            remarks.append(
                Reason(DiagnosisCode.DATA_FAULT, how="stuck", runs=repeats.runs, samples=repeats.samples, share=share)
            )
        if (bridging := self._bridged.result()) is not None:
            lines = len(bridging.lines)
            remarks.append(
                Reason(
                    DiagnosisCode.DATA_FAULT, how="bridged", samples=bridging.samples, share=bridging.share, lines=lines
                )
            )
        return remarks

    def _by_axis_mps2(self, counts: FloatArray) -> tuple[float, float, float]:
        by_axis = np.zeros(3)
        by_axis[list(self._reading.columns)] = counts * np.abs(self._reading.scale_mps2)
        return float(by_axis[0]), float(by_axis[1]), float(by_axis[2])


class _Collector:
    """Collects the revolutions of one wheel, and what the frames say of clocks and samples."""

    def __init__(self, order: ReadOrder) -> None:
        self.wheels: dict[str, int] = {}
        self.store = RevolutionStore(order.reverse)
        self.last: RevolutionResult | None = None
        self.clock = HubClockError()
        self.links: set[str] = set()
        self._readings: dict[tuple[int, int], SensorReading] = {}
        self._samples: dict[tuple[int, int], _SensorSamples] = {}
        self._wheel = order.wheel
        self._naming = _NAMING_REVOLUTIONS

    def result(self, result: RevolutionResult) -> bool:
        """Take a revolution; return False where reading on is pointless, as a wheel must be chosen first."""
        self.wheels[result.position] = self.wheels.get(result.position, 0) + 1
        if self._wheel is None and len(self.wheels) > 1:
            self._naming -= 1
            if self._naming < 0:
                return False
        if result.position == (self._wheel or next(iter(self.wheels))):
            self.store.take(result.revolution, result.conditions, result.host_ns, result.estimates)
            self.last = result
        return True

    def block(self, link: str, batch: FrameBatch, arrivals_ns: NDArray[np.int64]) -> None:
        self.links.add(link)
        self.clock.take(link, batch, arrivals_ns)
        for hub, number, places in batch.by_source():
            for index in places[batch.type[places] == MessageType.HELLO].tolist():
                hello = batch.message(index)
                if isinstance(hello, Hello):
                    self._readings.setdefault((hub, number), SensorReading.from_hello(hello))
        for group in batch.sample_groups():
            source, reading = (group.hub, group.wheel), self._readings.get((group.hub, group.wheel))
            if reading is not None and len(reading.columns) == group.counts.shape[2]:
                self._samples.setdefault(source, _SensorSamples(reading)).take(group)

    def samples(self, source: tuple[int, int] | None) -> "_SensorSamples | None":
        """Return what was seen of the samples of a wheel, None without any after a hello."""
        return self._samples.get(source) if source is not None else None

    @property
    def has_host_times(self) -> bool:
        return bool(self.links) and not any(link.startswith(_WITHOUT_HOST_TIME) for link in self.links)

    def clock_error(self, hub: int | None) -> tuple[float, float]:
        """Return the clock error of a hub and its standard error, unknown without arrival times."""
        return self.clock.error(hub) if self.has_host_times and hub is not None else UNKNOWN


def read_recording(order: ReadOrder, on_position: Callable[[int], None] | None = None) -> RecordingRead:
    """Read one recording.

    Args:
        order: recording and settings.
        on_position: called with the bytes of the file read so far.

    Raises:
        TreadlinkError: the file, its configuration or the keys cannot be read.
    """
    reader = RecordingReader(order.path)
    recording = open_recording(reader, order.vehicle, key_file=order.key_file, on_position=on_position)
    collected = _Collector(order)
    # Notes of the diagnosis report the alarms.
    reading = RecordingPass(recording, ("turning",), logs_alarms=False, on_block=collected.block)
    for result in reading:
        if not collected.result(result):
            return RecordingRead(tuple(collected.wheels))
    if on_position is not None:
        on_position(reader.info.size_bytes)
    wheels = tuple(collected.wheels)
    last = collected.last
    if last is None or (order.wheel is None and len(wheels) > 1):
        return RecordingRead(wheels, damage=reader.damage, notices=tuple(reading.notices(wheels)))
    if order.vehicle is not None:
        _check_sensor(order, reading.sensors, last.position, has_own=bool(reader.vehicle_toml))
    return _reduced(order, recording, reading, collected, last)


def _check_sensor(order: ReadOrder, sensors: SensorsHeard, position: str, *, has_own: bool) -> None:
    """Raise ConfigError when the given configuration names another sensor than the recording is of."""
    wheel = configured(order.vehicle, position)
    mismatches = tuple(sensors.mismatches([position]))
    if wheel is None or not mismatches or wheel.sensor_number in sensors.at(position):
        return
    listed = "; ".join(map(notice_text, mismatches))
    remedy = "Give the configuration of this wheel, or correct the sensor_id in it."
    raise ConfigError(
        f"the configuration does not belong to '{order.path}': {listed}",
        f"{remedy} Without --config the recording's own is used." if has_own else remedy,
    )


def _reduced(
    order: ReadOrder, recording: OpenedRecording, reading: RecordingPass, collected: _Collector, last: RevolutionResult
) -> RecordingRead:
    """Return the recording as groups; `last` is the last revolution of the wheel."""
    position, vehicle = last.position, recording.vehicle
    faults = _faults(reading.alarms(), position)
    wheel, tire = configured(vehicle, position), configured_tire(vehicle, position)
    store = collected.store
    # Where one axis is another, so may be the third; the steady value proves the radial one.
    misplaced = any(fault.code is TrustCode.GRAVITY_ABSENT for fault in faults)
    if misplaced:
        store.leave_out(_NOT_RADIAL)
    table = store.table()
    declared = _declared(order, vehicle, wheel, tire, last, store)
    rates = without_rates(table, declared.radius_m, ac_coupled=declared.ac_coupled, least_evidence=_EVIDENCE_OF_A_RATE)
    groups = make_groups(table, declared, order.folds, store.reject) if len(table) else []
    groups = [replace(group, rates=rates) for group in groups]
    host_s = table["host_s"]
    address = wheel_address(vehicle, position)
    remarks = [*(Reason(DiagnosisCode.SENSOR_ALARM, reason=fault) for fault in faults), *store.notes()]
    if misplaced:
        remarks.append(Reason(DiagnosisCode.AXES_LEFT_OUT, axes=tuple(AXIS_NAMES[axis] for axis in _NOT_RADIAL)))
    remarks += _range_remarks(table, reading, position)
    if _is_doubted(faults, wheel):
        groups = [replace(group, sensor_doubted=True) for group in groups]
    if (samples := collected.samples(address)) is not None:
        repeats, step_mps2 = samples.repeats(), samples.step_mps2()
        groups = [replace(group, step_mps2=step_mps2, repeats=repeats) for group in groups]
        remarks += samples.remarks(repeats)
    sensors, measures_pressure = reading.sensors.at(position), reading.sensors.measures_pressure(position)
    source = CoreCode.FROM_RECORDING if order.vehicle is None else CoreCode.FROM_CONFIGURATION
    provenance, assumed = provenance_of(vehicle, wheel, groups, source, pressure_measured=measures_pressure)
    return RecordingRead(
        wheels=tuple(collected.wheels),
        groups=tuple(groups),
        first_s=float(host_s.min()) if len(table) else 0.0,
        last_s=float(host_s.max()) if len(table) else 0.0,
        host_times=collected.has_host_times,
        rejected=store.rejected,
        clock_error=collected.clock_error(address[0] if address else None),
        assumed=assumed,
        stated=provenance,
        damage=recording.file.damage,
        sensor_id=next(iter(sensors)) if len(sensors) == 1 else None,
        notices=tuple(reading.notices([position])),
        remarks=tuple(remarks),
        vehicle=vehicle.name if vehicle is not None else "",
        tire=(tire.size or "") if tire is not None else "",
        units=shown_units_of(vehicle),
    )


def _range_remarks(table: RevolutionTable, reading: RecordingPass, position: str) -> list[Reason]:
    """Return that the wheel's signal left the range of its sensor; empty where it did not."""
    if (clipped := int(table["cut_off"].sum())) > 0:
        return [Reason(DiagnosisCode.REVOLUTIONS_CLIPPED, count=clipped, total=len(table))]
    saturated = sum(state.counters.samples_saturated for state in reading.wheels if state.position == position)
    return [Reason(SessionCode.SENSOR_RANGE_REACHED, count=saturated)] if saturated else []


def _faults(records: Iterable[AlarmRecord], position: str) -> tuple[Reason, ...]:
    """Return the faults of a wheel's sensor, and what its signal contradicts at the end of the recording."""
    return tuple(
        record.reason
        for record in records
        if record.position == position
        and record.name not in _NOT_OF_SENSORS
        and (record.is_standing or record.reason.code in _SENSOR_FAULTS)
    )


def _is_doubted(faults: Iterable[Reason], wheel: Wheel | None) -> bool:
    """Return whether a fault makes every shape doubtful; a tilt that is stated is corrected."""
    codes = {fault.code for fault in faults} & _DOUBTS
    if wheel is not None and (wheel.mounting.roll_deg or wheel.mounting.pitch_deg):
        codes -= {TrustCode.SENSOR_TILTED}
    return bool(codes)


def _declared(
    order: ReadOrder,
    vehicle: VehicleConfig | None,
    wheel: Wheel | None,
    tire: Tire | None,
    last: RevolutionResult,
    store: RevolutionStore,
) -> Declared:
    stated_m = tire.radius_m if tire is not None else None
    mounting = wheel.mounting if wheel is not None else Mounting()
    offset_m = mounting.offset_m
    offset_known = offset_m is not None and not is_assumed(vehicle, Quantity.OFFSET)
    measured = offset_m is None
    if offset_m is None:
        in_use = last.conditions
        offset_known = in_use.sensor_offset_std_m < _OFFSET_KNOWN_M
        offset_m = in_use.sensor_offset_m if offset_known else 0.0
    return Declared(
        name=order.name,
        recording=order.index,
        radius_m=ASSUMED_RADIUS_MM * 1e-3 if stated_m is None else stated_m,
        offset_m=offset_m,
        roll_rad=mounting.roll_rad,
        pitch_rad=mounting.pitch_rad,
        reverse=order.reverse,
        ac_coupled=store.ac_coupled,
        offset_known=offset_known,
        offset_measured=measured and offset_known,
        gain_std=last.conditions.claims.gain_std,
    )
