"""First pass over a recording: its wheels, their sensors, and the conditions that an export file states."""

import math
import shlex
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from firmware_protocol.messages import Axis
from gateway import __version__
from gateway.core.config.vehicle import ASSUMED_RADIUS_MM, VehicleConfig
from gateway.core.constants import AXIS_NAMES
from gateway.core.errors import OutputError
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.reasons import CoreCode, Reason
from gateway.core.recording.reader import REPAIR_REMEDY
from gateway.core.recording.recorded_file import RawDump, RecordedFile
from gateway.core.recording.run_description import RunDescription, TireIdentity
from gateway.core.session.recording_pass import OpenedRecording
from gateway.core.session.wheel_identity import configured
from gateway.core.text.text import escaped
from gateway.core.text.wording import text
from gateway.core.types import FloatArray
from gateway.exporting.export_table import Condition
from gateway.exporting.recorded_signals import SignalBlock, signals


@dataclass(slots=True)
class _Mean:
    total: float = 0.0
    count: int = 0

    def add(self, value: float | None) -> None:
        if value is not None and math.isfinite(value):
            self.total += value
            self.count += 1

    @property
    def value(self) -> float | None:
        return self.total / self.count if self.count else None


@dataclass(slots=True)
class MeasuredWheel:
    """A wheel of a recording.

    Attributes:
        position: its name.
        sensors: serial numbers heard, in order.
        rate_hz: last measured sampling rate; 0 without samples.
        ac_coupled: whether the sensor passes no steady value.
        axes: which of the axes the sensor has, in the order of AXIS_NAMES.
        range_mps2: (3,) end of the range of each axis, the least of all sensors; NaN where none is stated.
        samples: number of samples.
        lost: number of samples lost on the link.
        start_ns: host time of the first sample.
        end_ns: host time of the last sample.
        pressure: mean of the measured gauge pressure, Pa.
        temperature: mean of the measured temperature, degC.
    """

    position: str
    sensors: list[int] = field(default_factory=list)
    rate_hz: float = 0.0
    ac_coupled: bool = False
    axes: list[bool] = field(default_factory=lambda: [False] * len(Axis))
    range_mps2: FloatArray = field(default_factory=lambda: np.full(len(Axis), np.nan))
    samples: int = 0
    lost: int = 0
    start_ns: int = 0
    end_ns: int = 0
    pressure: _Mean = field(default_factory=_Mean)
    temperature: _Mean = field(default_factory=_Mean)

    def take(self, block: SignalBlock) -> None:
        """Take a block of samples."""
        if block.sensor_id not in self.sensors:
            self.sensors.append(block.sensor_id)
        if not self.samples:
            self.start_ns = int(block.host_time_ns[0])
        self.end_ns = int(block.host_time_ns[-1])
        self.rate_hz, self.ac_coupled = block.rate_hz, block.ac_coupled
        self.samples += len(block)
        self.lost += block.lost_before
        self.range_mps2 = np.fmin(self.range_mps2, block.range_mps2)
        for axis in Axis:
            self.axes[axis] |= not math.isnan(block.axes_mps2[0, axis])


@dataclass(frozen=True, slots=True)
class FirstPass:
    """Result of the first pass.

    Attributes:
        wheels: with samples, in the order of the configuration, others behind in that of the recording.
        start_ns: beginning of the recording, ns since the epoch; the zero of its times.
        has_arrivals: whether the file contains arrival times; without them, times are those of the hub.
    """

    wheels: tuple[MeasuredWheel, ...]
    start_ns: int
    has_arrivals: bool


def has_arrivals(recording: RecordedFile) -> bool:
    """Return whether a file contains arrival times; the dump of a link does not."""
    return not isinstance(recording, RawDump)


def on_hub_time(block: SignalBlock) -> SignalBlock:
    """Return samples with the times of the hub instead of those of the computer."""
    return replace(block, host_time_ns=np.rint(block.hub_time_s * 1e9).astype(np.int64))


def first_pass(opened: OpenedRecording, *, wheels: Collection[str] = ()) -> FirstPass:
    """Read a recording once.

    Args:
        opened: the recording.
        wheels: positions to export; all when empty.

    Raises:
        OutputError: it has no samples, or a wheel of `wheels` has none.
    """
    recording, vehicle = opened.file, opened.vehicle
    order = {wheel.position: index for index, wheel in enumerate(vehicle.wheel if vehicle is not None else ())}
    by_position: dict[str, MeasuredWheel] = {}
    for item in signals(opened):
        wheel = by_position.setdefault(item.wheel, MeasuredWheel(item.wheel))
        if isinstance(item, SignalBlock):
            wheel.take(item if has_arrivals(recording) else on_hub_time(item))
        else:
            wheel.pressure.add(item.pressure_pa)
            wheel.temperature.add(item.temperature_degc)
    senders = sorted(
        (wheel for wheel in by_position.values() if wheel.samples),
        key=lambda wheel: order.get(wheel.position, len(order)),
    )
    path = recording.info.path
    if not senders and recording.damage is not None:
        raise OutputError(
            f"'{path}' has no samples to export in its readable part: {text(recording.damage)}", REPAIR_REMEDY
        )
    if not senders:
        raise OutputError(
            f"'{path}' has no samples to export",
            f"`treadlink inspect {shlex.quote(str(path))}` shows what the recording contains.",
        )
    missing = [name for name in wheels if name not in {wheel.position for wheel in senders}]
    if missing:
        raise OutputError(
            f"'{path}' has no samples of wheel {', '.join(missing)}",
            f"It has: {', '.join(wheel.position for wheel in senders)}.",
        )
    chosen = tuple(wheel for wheel in senders if not wheels or wheel.position in wheels)
    if not has_arrivals(recording):
        return FirstPass(chosen, 0, has_arrivals=False)
    # A wheel that is left out must not move the zero of the times.
    first_ns = min(wheel.start_ns for wheel in senders)
    start_ns = recording.info.start_ns
    start_ns = first_ns if start_ns is None or not start_ns <= first_ns else start_ns
    return FirstPass(chosen, start_ns, has_arrivals=True)


def conditions(wheel: MeasuredWheel, seen: FirstPass, recording: OpenedRecording) -> tuple[Condition, ...]:
    """Return what is known of a wheel, each entry with its source.

    Args:
        wheel: the wheel.
        seen: the pass that found it.
        recording: that was read.
    """
    entries = _conditions(wheel, seen, recording)
    # Names come from files and hubs, and neither a terminal nor XML takes their control characters.
    return tuple(
        replace(entry, value=escaped(entry.value)) if isinstance(entry.value, str) else entry for entry in entries
    )


def _conditions(wheel: MeasuredWheel, overview: FirstPass, recording: OpenedRecording) -> Iterator[Condition]:
    vehicle, info = recording.vehicle, recording.file.info
    by_sensor = text(Reason(CoreCode.FROM_SENSOR))
    origin = text(Reason(CoreCode.FROM_RECORDING if recording.config_path is None else CoreCode.FROM_CONFIGURATION))
    setups = {setup.position: setup for setup in (vehicle.wheel_setups() if vehicle is not None else ())}
    setup = setups.get(wheel.position)
    yield Condition("exported_by", f"treadlink {__version__}")
    yield Condition("recording", info.path.name)
    if info.treadlink:
        yield Condition("recorded_by", f"treadlink {info.treadlink}")
    yield Condition("recorded_from", ", ".join(info.sources))
    yield Condition("start_ns", overview.start_ns, "ns")
    yield Condition("clock", "computer" if overview.has_arrivals else "hub")
    yield Condition("wheel", wheel.position)
    yield from _run(info.described_run(), wheel.position)
    if vehicle is not None:
        yield Condition("vehicle", vehicle.name, "", origin)
        if vehicle.vehicle.assumed:
            yield Condition("assumed", "; ".join(vehicle.vehicle.assumed), "", origin)
    yield Condition("sensor_id", ", ".join(f"{number:08x}" for number in wheel.sensors), "", by_sensor)
    yield Condition("axes", ", ".join(name for name, used in zip(AXIS_NAMES, wheel.axes, strict=True) if used))
    if np.isfinite(wheel.range_mps2).any():
        ranges = zip(AXIS_NAMES, wheel.range_mps2.tolist(), strict=True)
        limits = ", ".join(f"{name} {limit!r}" for name, limit in ranges if math.isfinite(limit))
        yield Condition("ranges_mps2", limits, "", by_sensor)
    yield Condition("rate_hz", wheel.rate_hz, "Hz", by_sensor)
    if setup is not None:
        yield Condition("relative_rate_std", setup.sensor.rate_std, "", origin)
    yield Condition("coupling", "ac" if wheel.ac_coupled else "dc", "", by_sensor)
    yield Condition("samples", wheel.samples)
    yield Condition("samples_lost", wheel.lost)
    yield Condition("duration_s", (wheel.end_ns - wheel.start_ns) * 1e-9, "s")
    yield from _tire(setup, vehicle, wheel, origin)
    yield from _environment(setup, wheel, origin, by_sensor)


def _run(run: RunDescription, position: str) -> Iterator[Condition]:
    """Yield what is stated of the test run and of the tire at a wheel."""
    tire = run.tires.get(position, TireIdentity())
    for name, value in (
        ("test", run.test),
        ("driver", run.driver),
        ("comment", run.comment),
        ("tags", ", ".join(run.tags)),
        ("tire_maker", tire.maker),
        ("tire_dot", tire.dot),
    ):
        if value:
            yield Condition(name, value, "", text(Reason(CoreCode.FROM_RECORDING)))
    for name, length_m in (("tire_wear_m", tire.wear_m), ("tire_run_in_m", tire.run_in_m)):
        if length_m is not None:
            yield Condition(name, length_m, "m", text(Reason(CoreCode.FROM_RECORDING)))


def _tire(
    setup: WheelSetup | None, vehicle: VehicleConfig | None, wheel: MeasuredWheel, origin: str
) -> Iterator[Condition]:
    if setup is None or vehicle is None:
        radius_m = ASSUMED_RADIUS_MM * 1e-3
        source = text(Reason(CoreCode.ASSUMED_RADIUS, radius_m=radius_m))
        yield Condition("radius_m", radius_m, "m", source)
        return
    yield Condition("radius_m", setup.radius_m, "m", origin)
    yield Condition("radius_std_m", setup.radius_std_m, "m", origin)
    wheel_table = configured(vehicle, wheel.position)
    assert wheel_table is not None
    tire = vehicle.tire_of(wheel_table)
    if tire.size is not None:
        yield Condition("tire_size", tire.size, "", origin)
    if setup.load_n is not None:
        yield Condition("load_n", setup.load_n, "N", origin)
        if setup.load_std_n > 0.0:
            yield Condition("load_std_n", setup.load_std_n, "N", origin)
    if wheel_table.mounting.offset_m is not None:
        yield Condition("mounting_offset_m", wheel_table.mounting.offset_m, "m", origin)


def _environment(setup: WheelSetup | None, wheel: MeasuredWheel, origin: str, by_sensor: str) -> Iterator[Condition]:
    """Yield pressure and temperature: the mean of what the sensor measured, else what is stated."""
    quantities = (
        ("pressure_pa", "Pa", wheel.pressure.value, setup.pressure_pa if setup is not None else None),
        ("temperature_degc", "degC", wheel.temperature.value, setup.temperature_degc if setup is not None else None),
    )
    for name, unit, measured, configured_value in quantities:
        if measured is not None:
            yield Condition(name, measured, unit, by_sensor)
        elif configured_value is not None:
            yield Condition(name, configured_value, unit, origin)
