"""A pass over a recording: opened with vehicle, keys and effects, read in blocks, watched and estimated."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.block_decoder import FrameBatch
from firmware_protocol.counters import LinkCounters
from gateway.core.config.vehicle import VehicleConfig, choose_vehicle
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
from gateway.core.estimates.result_block import ResultBlock, blocks_of
from gateway.core.estimates.results import AlarmRecord, RevolutionResult, WheelSnapshot
from gateway.core.estimates.wheel_setup import CorrectionTable
from gateway.core.links.source import Chunk, LinkEvent, VehicleData
from gateway.core.reasons import Level, Notice
from gateway.core.recording.decoder_blocks import DecodedLinks
from gateway.core.recording.recorded_clock import RecordedClock
from gateway.core.recording.recorded_file import RecordedFile
from gateway.core.session.alarm_watch import RecordingAlarms
from gateway.core.session.corrections import effects_doubts, open_effects
from gateway.core.session.frame_guard import FrameGuard
from gateway.core.session.missing_results import FrameCounts, missing_frames, missing_revolutions
from gateway.core.session.result_path import ResultPath
from gateway.core.session.session_parts import VehicleSignals, open_guard, open_vehicle_signals
from gateway.core.session.wheel_identity import SensorsHeard
from gateway.core.trust.turn_verdict import Verdict

# Revolutions of a recording wait for a full block for as long as the buffer of their wheel has them.
_HOLD_S: Final = 7.6

Block = tuple[str, FrameBatch, NDArray[np.int64]]
"""Link, a block of its frames, and their arrival times in ns."""


@dataclass(frozen=True, slots=True)
class OpenedRecording:
    """A recording or the dump of a link, with all that decides what a pass over it gives.

    Attributes:
        file: the open file. Passes over one object must not overlap; those over copies of it may.
        vehicle: configuration, None for an assumed belt radius.
        effects: known effects to subtract, one table per wheel.
        key_file: keys of signed frames; None for the user's.
        config_path: file of the configuration where the user gave one.
        on_position: called with the bytes of the file read so far.
        verifies: whether frames are verified where the policy of the vehicle asks for it.
    """

    file: RecordedFile
    vehicle: VehicleConfig | None = None
    effects: tuple[CorrectionTable, ...] = ()
    key_file: Path | None = None
    config_path: Path | None = None
    on_position: Callable[[int], None] | None = None
    verifies: bool = True

    def effects_doubts(self) -> list[Notice]:
        """Return what the configuration states otherwise than the recordings of the effects' diagnosis."""
        return effects_doubts(self.effects, self.vehicle)

    def guard(self) -> FrameGuard | None:
        """Return a new guard, which verifies the frames of one pass; None where none are verified.

        Raises:
            SecurityError: the keys cannot be read, or would verify nothing.
        """
        return open_guard(self.vehicle, self.key_file, remembers=False) if self.verifies else None

    def signals(self) -> VehicleSignals:
        """Return a new decoder of the vehicle's signals, for one pass.

        Raises:
            ConfigError: the DBC file cannot be read, or does not fit the configuration.
        """
        return open_vehicle_signals(self.vehicle, self.config_path, recorded=[self.file.info.dbc_text])

    def blocks(
        self, links: DecodedLinks, on_other: Callable[[VehicleData | LinkEvent], None] | None = None
    ) -> Iterator[Block]:
        """Yield the frames of all links in blocks.

        Args:
            links: their decoders, for this pass alone.
            on_other: called with the other items, in the order of the recording.
        """
        for item in self.file.items():
            if isinstance(item, Chunk):
                if self.on_position is not None:
                    self.on_position(self.file.position)
                yield from links.add(item)
            elif on_other is not None:
                if isinstance(item, LinkEvent):
                    yield from links.waiting()
                on_other(item)
        yield from links.finish()

    def verified_blocks(self) -> Iterator[Block]:
        """Yield the frames of all links in blocks, in a pass that needs nothing else."""
        return self.blocks(DecodedLinks(self.guard()))


def open_recording(
    file: RecordedFile,
    config: VehicleConfig | Path | None = None,
    *,
    effects_paths: Sequence[Path] = (),
    key_file: Path | None = None,
    on_position: Callable[[int], None] | None = None,
    verifies: bool = True,
) -> OpenedRecording:
    """Return a recording with its vehicle and effects.

    Args:
        file: recording or dump.
        config: vehicle configuration or its file; None for the one in the recording.
        effects_paths: files of known effects.
        key_file: keys of signed frames; None for the user's.
        on_position: called with the bytes of the file read so far.
        verifies: whether frames are verified where the policy of the vehicle asks for it.

    Raises:
        ConfigError: the configuration or the effects cannot be read, or do not belong together.
    """
    config_path = config if isinstance(config, Path) else None
    vehicle = choose_vehicle(config, [file.vehicle_toml], str(file.info.path))
    effects = open_effects(effects_paths, vehicle)
    return OpenedRecording(file, vehicle, effects, key_file, config_path, on_position, verifies)


class RecordingPass:
    """One pass over a recording, in constant memory, with the same results as live.

    Iterate it once for the result of every completed revolution, in order per wheel, wheels interleaved by block. What
    was watched is complete afterwards.

    Attributes:
        sensors: heard at the wheels.
        statements: of the hubs, compared with what they send.
        wheels: last state of every wheel.
        span_ns: arrival of the first and the last frame, None before the first.
        clock: what the recording says of its times.
    """

    def __init__(
        self,
        recording: OpenedRecording,
        estimators: Sequence[str] = DEFAULT_ESTIMATORS,
        *,
        is_watched: bool = True,
        logs_alarms: bool = True,
        signals: VehicleSignals | None = None,
        on_block: Callable[[str, FrameBatch, NDArray[np.int64]], None] | None = None,
    ) -> None:
        """Prepare the pass.

        Args:
            recording: what is read.
            estimators: names from the registry; none for the revolutions alone.
            is_watched: whether sensors, statements and alarms are of interest; results then have their alarms.
            logs_alarms: whether alarms go to the program's log too.
            signals: decodes the vehicle's signals; every result then has them.
            on_block: called with each block of frames before its revolutions.

        Raises:
            ConfigError: unknown estimator.
            SecurityError: the keys cannot be read.
        """
        vehicle = recording.vehicle
        self.sensors = SensorsHeard(vehicle)
        self.wheels: tuple[WheelSnapshot, ...] = ()
        self.span_ns: tuple[int, int] | None = None
        self.clock = RecordedClock()
        self._recording = recording
        self._guard = recording.guard()
        self._links = DecodedLinks(self._guard)
        self._path = path = ResultPath(vehicle, recording.effects, estimators, _HOLD_S, signals)
        self.statements = path.statements
        self._alarms: RecordingAlarms | None = None
        if is_watched:
            path.attach(self.statements)
            path.attach(self.sensors)
            self._alarms = RecordingAlarms(vehicle, path, path.pairs.alarms, logs=logs_alarms)
            path.raise_alarms(self._alarms)
        self._on_block = on_block

    def __iter__(self) -> Iterator[RevolutionResult]:
        return (result for block in self.blocks() for result in block.results)

    def blocks(self) -> Iterator[ResultBlock]:
        """Yield the results in blocks of a wheel; likewise once."""
        for link, batch, arrivals_ns in self._recording.blocks(self._links, self._take_other):
            if self._on_block is not None:
                self._on_block(link, batch, arrivals_ns)
            first_ns, last_ns = int(arrivals_ns.min()), int(arrivals_ns.max())
            previous_ns = self.span_ns or (first_ns, last_ns)
            self.span_ns = min(first_ns, previous_ns[0]), max(last_ns, previous_ns[1])
            yield from blocks_of(self._path.watched(link, batch, arrivals_ns, lambda _: None))
        yield from blocks_of(self._path.compared(self._path.finish()))
        self.wheels = self._path.wheels()
        for name, counted in self.links.items():
            self.statements.counters(name, counted)

    @property
    def links(self) -> dict[str, LinkCounters]:
        """Counters of the decoder, by link."""
        return self._links.counters

    def alarms(self) -> tuple[AlarmRecord, ...]:
        """Return the history of every alarm, after the last result; none of a pass that is not watched."""
        return self._alarms.finish() if self._alarms is not None else ()

    def lateral_axis(self, position: str) -> Verdict:
        """Return what the curves of the recording say of a wheel's lateral axis, after the last result."""
        return self._path.pairs.axis(position)

    def notices(self, heard: Sequence[str]) -> list[Notice]:
        """Return what was wrong with sensors, statements and effects, after the last result.

        Args:
            heard: positions of the wheels whose sensors are compared with the configuration.
        """
        recording = self._recording
        # Where signatures are checked, the guard reports misplaced sensors, and what becomes of their frames.
        of_guard = self._guard.take_notices() if self._guard is not None else []
        of_sensors = of_guard or self.sensors.mismatches(heard)
        of_receivers = self._path.notices_of_receivers()
        # A receiver that contradicts the clock has its own notice.
        step = self.clock.set if self.clock.ahead_s and not of_receivers else None
        of_clock = [Notice("this computer", step, Level.WARNING)] if step is not None else []
        return [*of_sensors, *self.statements.contradictions(), *of_receivers, *of_clock, *recording.effects_doubts()]

    def missing(self) -> tuple[Notice, ...]:
        """Return the links without a frame and the wheels without a revolution, after the last result."""
        counts = {name: FrameCounts(counted.frames, counted.refused) for name, counted in self.links.items()}
        return (*missing_frames(counts), *missing_revolutions(self.wheels, counts))

    def _take_other(self, item: VehicleData | LinkEvent) -> None:
        self.clock.take(item)
        if isinstance(item, LinkEvent):
            if self._alarms is not None:
                self._alarms.event(item)
            return
        if self._alarms is not None:
            self._alarms.vehicle(item)
        for position, reading in self._path.vehicle(item)[1]:
            if reading.reading.pressure_pa is not None:
                self.sensors.hears_pressure(position)
