"""Pipeline of one wheel: from raw samples to revolutions and estimates."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass
from functools import partial
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Axis, Environment, Hello
from firmware_protocol.sample_numbers import is_jump
from firmware_protocol.sequence import unwrap
from gateway.core.constants import AXIS_NAMES
from gateway.core.contacts.contact_timing import ContactTimer, TimedPair
from gateway.core.contacts.missing_revolutions import MissingRevolutions, RadialSamples
from gateway.core.contacts.reasons import ContactCode
from gateway.core.contacts.segmenter import LOOK_BACK_S, ContactPair, Segmenter
from gateway.core.estimates.doubt_rules import DoubtRule
from gateway.core.estimates.estimator import Revolution
from gateway.core.estimates.results import (
    RevolutionResult,
    SensorFlag,
    Silence,
    SilentPart,
    WheelCounters,
    WheelSnapshot,
    WheelState,
)
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.quantity import Basis
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.angle_resampling import MARGIN_SAMPLES
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.sensor_health import SensorHealth
from gateway.core.trust.sensor_limits import Doubt, SensorLimits
from gateway.core.types import FloatArray
from gateway.core.wheels.gap_filling import GapFilling
from gateway.core.wheels.outside_readings import OutsideReading
from gateway.core.wheels.possible_readings import possible_reading
from gateway.core.wheels.reasons import WheelCode
from gateway.core.wheels.revolution import SensorReading, TimedRevolution, revolutions_in_angle
from gateway.core.wheels.sample_buffer import SampleBuffer
from gateway.core.wheels.timebase import HostClock, SampleClock
from gateway.core.wheels.tire_estimates import TireEstimates
from gateway.core.wheels.unmarked_loss import UnmarkedLossCheck

BUFFER_S: Final = 8.0
# Longer gaps are not interpolated: contacts are searched again after them.
_MAX_GAP_S: Final = 0.25
# From it on a gap is a silence, as in the alarms.
_SILENT_S: Final = 1.0
# Tolerance between the time stamp and the sample number of a late block. If it is exceeded, the hub has restarted.
_LATE_TOLERANCE_US: Final = 250_000
# Hellos, every two seconds or so, within which no sensor is exchanged and back.
_SERIALS: Final = 8
# Readings of pressure and temperature that may come while revolutions wait; with more, an earlier one could be lost.
_MAX_WAITING_READINGS: Final = 60
# Turns to either side of a contact within which a gap may hide it: it is known by the belt before and behind it too.
_HIDDEN_WITHIN_TURNS: Final = 0.25
# Share of the mean below which the radial axis is in a contact only, where a flat belt reads nothing, and share of half
# a turn for which it is, of the shortest one.
_CONTACT_SHARE: Final = 0.4
_DIP_SHARE: Final = 0.05


@dataclass(slots=True)
class _Sensor:
    """A wheel's sensor: its hello, the conversion of its samples, and its health."""

    hello: Hello
    reading: SensorReading
    health: SensorHealth
    limits: SensorLimits

    def doubts(
        self, revolutions: Sequence[Revolution], counts: Iterable[NDArray[np.int16]], radius_m: float
    ) -> list[tuple[Doubt, ...]]:
        """Return what is against each revolution's estimates, by the samples of its radial axis."""
        faults = self.health.revolutions(revolutions)
        all_doubts: list[tuple[Doubt, ...]] = []
        for revolution, radial, fault in zip(revolutions, counts, faults, strict=True):
            limits = tuple(self.limits.doubts(revolution, radial, radius_m))
            all_doubts.append(limits if fault is None else (Doubt(Basis.SAMPLES, fault), *limits))
        return all_doubts


class _WaitingRevolution(NamedTuple):
    """A revolution that the segmenter has found, not worked on yet; `sign` makes its radial axis positive inward."""

    pair: ContactPair
    sign: int


class _LossCheck(NamedTuple):
    """Samples that a revolution is short of without a mark, negative for repeated ones, and the turns it made."""

    missing: float = 0.0
    turns: int = 1


_NO_LOSS: Final = _LossCheck()


class WheelPipeline:
    """The synchronous pipeline of one wheel. Not thread-safe; never reads a clock.

    Revolutions are found while samples are added, and worked on in blocks: as late as `complete` is called, or as their
    samples or what holds for them would be lost. The results do not depend on the size of the blocks.
    """

    def __init__(self, setup: WheelSetup, estimators: Sequence[str], hold_s: float = 0.0) -> None:
        """Make the wheel's estimators; buffers are allocated at the first hello.

        Args:
            setup: of the wheel.
            estimators: names from the registry.
            hold_s: longest time for which a revolution may wait for the next ones.
        """
        self.setup = setup
        self._hold_s = hold_s
        self._tire = TireEstimates(setup, estimators)
        self._timer = ContactTimer()
        self._filling = GapFilling()
        self._unmarked = UnmarkedLossCheck()
        self._missing = MissingRevolutions(setup.radius_m)
        self._sensor: _Sensor | None = None
        # Serial numbers of the latest hellos.
        self._serials: deque[int] = deque(maxlen=_SERIALS)
        self._buffer: SampleBuffer | None = None
        self._segmenter: Segmenter | None = None
        self._clock: SampleClock | None = None
        self._host: HostClock | None = None
        self._waiting: list[_WaitingRevolution] = []
        # Number of samples, and hub time, until which the first of them may wait for the next ones.
        self._due_sample = self._due_us = 0.0
        self._results: list[RevolutionResult] = []
        self._environments_waiting = 0
        self._samples = self._lost = self._silent = self._saturated = self._revolutions = 0
        self._silent_s = 0.0
        self._overwritten_before = self._checked_until = 0
        # Samples that the last revolution was short of without a mark.
        self._previous_check = _NO_LOSS
        # Centre of the contact that ended the last revolution.
        self._end_sample = math.nan
        self.blocks_before_hello = 0
        # The latest state for views, until something changes it.
        self._snapshot: WheelSnapshot | None = None

    def hold(self, hold_s: float) -> None:
        """Let the revolutions that come wait for the next ones for at most so long."""
        self._hold_s = hold_s

    def hello(self, hello: Hello) -> None:
        """Take the layout and scaling of the samples; if they or the sensor change, the processing restarts."""
        previous = self._sensor
        self._serials.append(hello.sensor_id)
        if previous is not None and previous.hello == hello:
            return
        self._snapshot = None
        self._process_waiting()
        reading = SensorReading.from_hello(hello)
        is_same_layout = (
            previous is not None
            and all(map(np.array_equal, astuple(previous.reading), astuple(reading)))
            and previous.hello.boot_count == hello.boot_count
            and previous.hello.sensor_id == hello.sensor_id
        )
        health = SensorHealth(
            reading.columns, reading.scale_mps2, reading.offset_counts, hello.rate_hz, is_dc=not reading.ac_coupled
        )
        limits = SensorLimits(hello, self.setup.sensor.bandwidth_hz, ac_coupled=reading.ac_coupled)
        self._sensor = _Sensor(hello, reading, health, limits)
        if not is_same_layout:
            if len(self._serials) > 1 and self._serials[-2] != hello.sensor_id:  # a restart forgets `previous`
                self._tire.reset()
            if self._buffer is not None:
                self._overwritten_before += self._buffer.overwritten
            self._buffer = SampleBuffer(round(BUFFER_S * hello.rate_hz), len(reading.columns))
            self._segmenter = None
            self._timer.reset()
            self._end_sample = math.nan
            self._filling.reset()
            self._unmarked.reset()
            self._clock = SampleClock(hello.rate_hz)

    def environment(self, tick_us: int, environment: Environment) -> None:
        """Take a pressure and temperature reading with its hub time; one that no tire can have is left out."""
        reading = possible_reading(environment)
        if reading is None:
            return
        self._snapshot = None
        if self._waiting:
            self._environments_waiting += 1
            # The revolutions found before this reading must not see it, nor lose an earlier one.
            if self._environments_waiting > _MAX_WAITING_READINGS or tick_us < self._end_us():
                self._process_waiting()
        pressure_error_pa = self._sensor.health.environment(reading) if self._sensor is not None else 0.0
        self._tire.environment(tick_us, reading, pressure_error_pa)

    def outside(self, reading: OutsideReading) -> None:
        """Take a reading of a receiver beside the hub; one that no tire can have is left out, as in `environment`."""
        if (possible := possible_reading(reading.reading)) is not None:
            self._snapshot = None
            self._tire.outside.add(reading._replace(reading=possible))

    def outside_silence(self, host_ns: int) -> Silence | None:
        """Return the silence of a receiver whose reading is in use at a time, None while it is not old."""
        old_s = self._tire.outside_old_s(host_ns)
        if old_s is None:
            return None
        return Silence(SilentPart.ENVIRONMENT, old_s, Reason(WheelCode.ENVIRONMENT_SILENT, silence_s=old_s))

    def restart(self) -> None:
        """Handle a restart of the hub: its counters and times are new; the estimates of the tire are kept."""
        self._snapshot = None
        self._process_waiting()
        self._sensor = self._segmenter = None
        self._tire.forget_environment()

    def samples(
        self, first_sample: int, ticks_us: Sequence[int], axes: int, counts: NDArray[np.int16], host: HostClock
    ) -> list[RevolutionResult]:
        """Add consecutive samples and return the revolutions they complete; see `add`."""
        self.add(first_sample, ticks_us, axes, counts, host)
        return self.complete()

    def can_decide(self, next_sample: int) -> bool:
        """Return whether samples up to a running number, low 32 bits, exclusive, are enough for the next decision."""
        buffer, segmenter = self._buffer, self._segmenter
        return buffer is None or segmenter is None or unwrap(buffer.head, next_sample) >= segmenter.next_index

    def is_due(self, now_us: int | None) -> bool:
        """Return whether revolutions have waited long enough at a hub time."""
        if not self._waiting:
            return False
        assert self._buffer is not None
        # By samples too: the hub's time may stand still. By time too: the wheel may send no more samples.
        return self._buffer.head >= self._due_sample or (now_us is not None and now_us >= self._due_us)

    def complete(self) -> list[RevolutionResult]:
        """Work on the revolutions that wait, and return those that were completed since the last call."""
        self._process_waiting()
        return self.completed()

    def completed(self) -> list[RevolutionResult]:
        """Return the revolutions that were completed since the last call."""
        results, self._results = self._results, []
        return results

    def add(
        self, first_sample: int, ticks_us: Sequence[int], axes: int, counts: NDArray[np.int16], host: HostClock
    ) -> None:
        """Add consecutive samples.

        Args:
            first_sample: the hub's running number of the first, low 32 bits.
            ticks_us: unwrapped hub times of the first sample of each of the equally long blocks that make up `counts`.
            axes: axis mask; must be the hello's.
            counts: (n, channels) raw values.
            host: maps hub time to host time.
        """
        self._snapshot = None
        sensor, buffer, clock = self._sensor, self._buffer, self._clock
        is_described = sensor is not None and axes == sensor.hello.axes and sensor.reading.has_radial
        if sensor is None or buffer is None or clock is None or not is_described:
            self.blocks_before_hello += len(ticks_us)
            return
        if host is not self._host:
            self._process_waiting()
            self._host = host
        if self._segmenter is None:
            buffer.reset(first_sample)
            self._checked_until = first_sample
            self._start_segmenter(first_sample)
        assert self._segmenter is not None
        first = unwrap(buffer.head, first_sample)
        step = first - buffer.head
        if step < 0:
            expected_us = clock.hub_us(first)
            if first >= buffer.tail and abs(ticks_us[0] - expected_us) < _LATE_TOLERANCE_US:
                self._process_waiting()
                repaired = buffer.patch(first, counts)
                self._lost -= repaired
                self._samples += repaired
                return
            self._restart_at(first_sample)
            self.add(first_sample, ticks_us, axes, counts, host)
            return
        if step > _MAX_GAP_S * sensor.hello.rate_hz:
            # Numbers for which the hub's clock shows no time are a jump of the firmware's, not lost samples.
            if not is_jump(step, ticks_us[0] - clock.hub_us(buffer.head), sensor.hello.rate_hz):
                self._lost += step
                if (gap_s := step / sensor.hello.rate_hz) >= _SILENT_S:
                    self._silent += step
                    self._silent_s += gap_s
            self._finish_segment()
            self._restart_at(first)
            self.add(first_sample, ticks_us, axes, counts, host)
            return
        if step > 0:
            self._lost += step
            self._make_room(step)
            buffer.bridge(step, counts[0], self._segmenter.oldest_needed)
        clock.stamp_blocks(first, len(counts) // len(ticks_us), ticks_us)
        self._samples += len(counts)
        # At most as many samples at once as the buffer can take without overwriting samples that the segmenter needs.
        chunk_size = buffer.capacity - round(LOOK_BACK_S * sensor.hello.rate_hz) - 1
        for begin in range(0, len(counts), chunk_size):
            chunk = counts[begin : begin + chunk_size]
            self._make_room(len(chunk))
            buffer.append(chunk, self._segmenter.oldest_needed)
            if self._segmenter.next_index <= buffer.head:
                self._count_saturated()
                self._queue(self._segmenter.advance(self._read_radial, buffer.missing_between, buffer.head))
            self._missing.samples(buffer.head, self._radial_samples(buffer))

    def finish(self, host: HostClock) -> list[RevolutionResult]:
        """Complete the revolutions that can be completed, when no more samples will come."""
        self._snapshot = None
        if self._segmenter is None:
            return self.complete()
        self._host = host
        self._finish_segment()
        assert self._buffer is not None
        self._missing.finish(self._buffer.head, self._radial_samples(self._buffer))
        return self.complete()

    def _queue(self, pairs: Sequence[ContactPair]) -> None:
        """Keep revolutions that the segmenter has found."""
        assert self._segmenter is not None
        if pairs and not self._waiting:
            self._set_due_time()
        for pair in pairs:
            self._waiting.append(_WaitingRevolution(pair, self._segmenter.sign))
            self._missing.came(pair.end.centre)

    def _set_due_time(self) -> None:
        """Set the time until which the first waiting revolution may wait for the next ones."""
        assert self._buffer is not None
        assert self._clock is not None
        head, hold_s = self._buffer.head, self._hold_s
        self._due_sample = head + hold_s * self._clock.nominal_rate_hz
        # All wheels of a hub at the same times: the work on one finds the code of that on another in the cache.
        now_us, step_us = self._clock.hub_us(head), hold_s * 1e6
        self._due_us = (now_us // step_us + 1.0) * step_us if step_us else now_us

    def _make_room(self, count: int) -> None:
        """Work on the waiting revolutions if so many more samples would overwrite theirs."""
        if self._waiting:
            assert self._buffer is not None
            overwritten = self._buffer.head + count - self._buffer.capacity + 4 * MARGIN_SAMPLES
            if overwritten > int(self._waiting[0].pair.start.centre):
                self._process_waiting(overwritten)

    def _end_us(self) -> float:
        """Return a hub time at which the last waiting revolution had ended, however its contact will be timed."""
        assert self._clock is not None
        end = self._waiting[-1].pair.end
        return self._clock.hub_us(end.centre + 0.5 * end.duration)

    def _count_saturated(self) -> None:
        """Check the samples since the last call; once per revolution is cheaper than once per frame."""
        buffer, sensor = self._buffer, self._sensor
        assert buffer is not None
        assert sensor is not None
        samples = buffer.view(max(self._checked_until, buffer.tail), buffer.head)
        self._checked_until = buffer.head
        lowest, highest = sensor.health.samples(samples)
        limit = sensor.reading.saturation_counts
        if highest >= limit or lowest <= -limit:
            self._saturated += int(((samples >= limit) | (samples <= -limit)).any(axis=1).sum())

    def _restart_at(self, head: int) -> None:
        assert self._buffer is not None
        assert self._sensor is not None
        self._process_waiting()
        self._count_saturated()
        self._checked_until = head
        self._buffer.reset(head)
        self._start_segmenter(head)
        self._timer.reset()
        self._end_sample = math.nan
        self._unmarked.reset()
        self._clock = SampleClock(self._sensor.hello.rate_hz)

    def _start_segmenter(self, head: int) -> None:
        assert self._sensor is not None
        rate_hz = self._sensor.hello.rate_hz
        self._segmenter = Segmenter(rate_hz, head)
        self._missing.begin(head, rate_hz, is_dc=not self._sensor.reading.ac_coupled)

    def _finish_segment(self) -> None:
        buffer, segmenter = self._buffer, self._segmenter
        assert buffer is not None
        assert segmenter is not None
        self._count_saturated()
        self._queue(segmenter.finish(self._read_radial, buffer.missing_between, buffer.head))

    def _read_radial(self, first: int, end: int) -> FloatArray:
        sensor, buffer = self._sensor, self._buffer
        assert sensor is not None
        assert buffer is not None
        return sensor.reading.radial_mps2(buffer.view(first, end))

    def _radial_samples(self, buffer: SampleBuffer) -> RadialSamples:
        return RadialSamples(self._read_radial, self._saturated_share, buffer.longest_measured)

    def _saturated_share(self, first: int, end: int) -> float:
        """Return the share of samples whose radial axis is at the end of the sensor's range."""
        sensor, buffer = self._sensor, self._buffer
        assert sensor is not None
        assert buffer is not None
        radial = buffer.view(first, end)[:, sensor.reading.radial_column]
        limit = sensor.reading.saturation_counts
        return float(((radial >= limit) | (radial <= -limit)).mean()) if len(radial) else 0.0

    def _process_waiting(self, overwritten: int | None = None) -> None:
        """Work on the waiting revolutions, in blocks that end where the timing's template is renewed.

        Args:
            overwritten: sample from which on the buffer keeps them: revolutions behind it wait on where they do not
                fill a block; None for all.
        """
        waiting, self._waiting = self._waiting, []
        if waiting:
            self._snapshot = None
        done = 0
        while done < len(waiting):
            pair, sign = waiting[done]
            if not self._timer.until_renewal:
                assert self._sensor is not None
                reading = self._sensor.reading
                average = self._tire.average_as_measured(ac_coupled=reading.ac_coupled, corner_hz=reading.corner_hz)
                self._timer.renew(average, pair.end.centre - pair.start.centre)
            fills_no_block = len(waiting) - done < self._timer.until_renewal
            if overwritten is not None and fills_no_block and overwritten <= int(pair.start.centre):
                self._waiting = waiting[done:]
                self._set_due_time()
                return
            end = done + 1
            end_limit = min(done + self._timer.until_renewal, len(waiting))
            while end < end_limit and waiting[end].sign == sign:
                end += 1
            self._process_block([revolution.pair for revolution in waiting[done:end]], sign)
            done = end
        self._environments_waiting = 0

    def _process_block(self, pairs: Sequence[ContactPair], sign: int) -> None:
        sensor, buffer, clock, host = self._sensor, self._buffer, self._clock, self._host
        assert sensor is not None
        assert buffer is not None
        assert clock is not None
        assert host is not None
        reading = sensor.reading
        rates_hz = [clock.rate_hz(pair.end.centre) for pair in pairs]
        all_timed = self._timer.time(
            pairs,
            rates_hz,
            lambda first, end: sign * reading.radial_mps2(buffer.view(first, end)),
            buffer.gaps_between,
        )
        revolutions: list[TimedRevolution] = []
        ends_us: list[float] = []
        hosts_ns: list[int] = []
        checks = self._loss_checks(pairs, all_timed, sign)
        previous = self._previous_check
        for pair, timed, rate_hz, check in zip(pairs, all_timed, rates_hz, checks, strict=True):
            if previous != _NO_LOSS and timed.previous_period is not None:
                timed = timed._replace(previous_period=(timed.previous_period + previous.missing) / previous.turns)
            previous = check
            end_us = clock.hub_us(timed.end.centre)
            hosts_ns.append(host.host_ns(end_us))
            omega_radps = 2.0 * math.pi * check.turns * rate_hz / (timed.end.centre - timed.start.centre)
            contribution, uncorrected = self._tire.contribution(
                omega_radps,
                self._tire.conditions(end_us, hosts_ns[-1]),
                sensor_id=sensor.hello.sensor_id,
                ac_coupled=reading.ac_coupled,
            )
            start_s = clock.hub_us(timed.start.centre) * 1e-6
            revolutions.append(
                TimedRevolution(
                    pair, timed, self._revolutions, start_s, rate_hz, clock.rate_std(pair.end.centre),
                    timed.start.centre == self._end_sample, sign, contribution, uncorrected, *check,
                )
            )  # fmt: skip
            self._end_sample = timed.end.centre
            ends_us.append(end_us)
            self._revolutions += 1
        self._previous_check = previous
        in_angle = revolutions_in_angle(revolutions, buffer, reading, self.setup.radius_m, self._filling)
        counts = (
            buffer.view(math.ceil(timed.start.centre), math.ceil(timed.end.centre))[:, reading.radial_column]
            for timed in all_timed
        )
        doubts = sensor.doubts(in_angle.revolutions, counts, self.setup.radius_m)
        if (conflict := self._sensor_conflict) is not None:
            doubts = [(Doubt(None, conflict), *revolution_doubts) for revolution_doubts in doubts]
        self._results += self._tire.take_block(in_angle, ends_us, hosts_ns, doubts)

    @property
    def _sensor_conflict(self) -> Reason | None:
        """Why the samples are of several sensors: a serial number that comes back after another; None else."""
        serials = list(self._serials)
        changes = sum(before != after for before, after in pairwise(serials))
        if changes < len(set(serials)):
            return None
        first, second = sorted(set(serials))[:2]
        return Reason(WheelCode.SENSORS_SHARE_NUMBER, first=f"{first:08x}", second=f"{second:08x}")

    def _loss_checks(self, pairs: Sequence[ContactPair], timed: Sequence[TimedPair], sign: int) -> list[_LossCheck]:
        """Return what mean and period of each revolution say of its samples and contacts."""
        sensor, buffer = self._sensor, self._buffer
        assert sensor is not None
        assert buffer is not None
        reading = sensor.reading
        if reading.ac_coupled or DoubtRule.TURNS not in self.setup.rules:
            return [_NO_LOSS] * len(pairs)
        column = reading.radial_column
        offset, scale = float(reading.offset_counts[column]), sign * float(reading.scale_mps2[column])
        checks: list[_LossCheck] = []
        stated_mps2 = self.setup.radius_m * (2.0 * math.pi * sensor.hello.rate_hz) ** 2
        for pair, timed_pair in zip(pairs, timed, strict=True):
            start, end = timed_pair.start.centre, timed_pair.end.centre
            first, last = math.ceil(start), math.ceil(end)
            is_predicted = pair.start.predicted or pair.end.predicted
            is_lossy = buffer.missing_between(first, last) > 0
            is_seen = timed_pair.start.is_seen and timed_pair.end.is_seen
            is_measured = is_seen and not is_predicted
            if not is_lossy and not is_measured and not (is_predicted and self._unmarked.knows_a_turn):
                # The period is not measured, as where the loss is in the contact before this revolution begins. What is
                # stated may be wrong.
                checks.append(_NO_LOSS)
                continue
            if is_lossy or is_predicted:
                # Without a contact the mean is too large by the share of that, a tenth; over two turns, four times.
                mean_mps2 = scale * (buffer.measured_mean(first, last, column) - offset)
                turns = self._unmarked.turns(end - start, abs(mean_mps2), stated_mps2, is_whole=not is_predicted)
                # A mean that points outward is that of a wheel whose gaps were taken for contacts.
                level = offset + _CONTACT_SHARE * mean_mps2 / scale
                dips = partial(_dips, column=column, level=level, scale=scale)
                # The wheel's own revolutions tell of several turns wherever the gaps are. Between contacts that were
                # not seen there may be any number.
                is_hidden = is_predicted or mean_mps2 < 0.0 or self._unmarked.knows_a_turn
                is_hidden = is_hidden or _may_hide_contacts(buffer, start, end, turns, dips)
                checks.append(_LossCheck(0.0, turns) if is_hidden else _NO_LOSS)
                continue
            total = int(np.add.reduce(buffer.view(first, last)[:, column], dtype=np.int64))
            mean_mps2 = scale * (total / (last - first) - offset)
            if (turns := self._unmarked.turns(end - start, mean_mps2)) > 1:
                checks.append(_LossCheck(0.0, turns))
            else:
                checks.append(_LossCheck(self._unmarked.missing(end - start, mean_mps2)))
        return checks

    @property
    def average_mps2(self) -> FloatArray | None:
        """Running average of the radial axis, (n,), None before the first revolution."""
        return self._tire.average_mps2

    def _missing_reason(self, flags: tuple[SensorFlag, ...]) -> Reason | None:
        """Return why not a single revolution has come, None when one has, or it is too early to say."""
        sensor = self._sensor
        reasons = self._missing.reasons
        if self._revolutions:
            return None
        if not reasons and self.blocks_before_hello:
            if sensor is not None and not sensor.reading.has_radial:
                reasons = (Reason(TrustCode.AXIS_MISSING, axis=AXIS_NAMES[Axis.RADIAL]),)
            else:
                reasons = (Reason(CoreCode.SAMPLES_WITHOUT_HELLO, count=self.blocks_before_hello),)
        elif not reasons and sensor is not None and self._segmenter is None:
            reasons = (Reason(WheelCode.NO_SAMPLES),)
        if not reasons:
            return None
        faults = tuple(flag.reason for flag in flags if _is_contactless(flag.reason))
        if faults and reasons[0].code is not ContactCode.RADIAL_AT_RANGE_END:
            reasons = faults
        return Reason(CoreCode.NO_REVOLUTION, duration_s=self._missing.duration_s, why=reasons)

    def _flags(self) -> tuple[SensorFlag, ...]:
        """Return the present faults, one that keeps revolutions from coming last."""
        health = self._sensor.health.flags() if self._sensor is not None else ()
        flags = (*health, *self._tire.flags())
        if not self._missing.is_fault or any(_is_contactless(flag.reason) for flag in flags):
            return flags
        reason = Reason(CoreCode.NO_REVOLUTION, duration_s=self._missing.waited_s, why=self._missing.present)
        return (*flags, SensorFlag("no revolution", reason))

    def snapshot(self) -> WheelSnapshot:
        """Return the latest state for views."""
        if self._snapshot is None:
            self._snapshot = self._make_snapshot()
        return self._snapshot

    def _make_snapshot(self) -> WheelSnapshot:
        conditions, last = self._tire.conditions(math.inf, math.inf), self._tire.last
        old = self.outside_silence(last.host_ns) if last is not None else None
        load = self._tire.latest("load_n") if conditions.load_n is None else None
        hello = self._sensor.hello if self._sensor is not None else None
        state = self._segmenter.state if self._segmenter is not None else WheelState.NO_DATA
        buffer, flags = self._buffer, self._flags()
        return WheelSnapshot(
            position=self.setup.position,
            sensor_id=f"{hello.sensor_id:08x}" if hello is not None else "",
            rate_hz=hello.rate_hz if hello is not None else 0.0,
            state=state,
            last=self._tire.last,
            average_mps2=self.average_mps2,
            scatter_mps2=self._tire.scatter_mps2,
            pressure_pa=conditions.pressure_pa,
            temperature_degc=conditions.temperature_degc,
            load_n=load.value if load is not None else conditions.load_n,
            stated=conditions.stated,
            wear_mm=self._tire.latest("wear_mm"),
            counters=WheelCounters(
                samples=self._samples,
                samples_lost=self._lost,
                samples_silent=self._silent,
                silent_s=self._silent_s,
                samples_saturated=self._saturated,
                samples_overwritten=self._overwritten_before + (buffer.overwritten if buffer is not None else 0),
                revolutions=self._revolutions,
                revolutions_rejected=self._tire.rejected,
            ),
            flags=flags,
            missing=self._missing_reason(flags),
            silences=(old,) if old is not None else (),
        )


def _is_contactless(fault: Reason) -> bool:
    """Return whether the radial axis of a sensor with a fault shows no contacts; the fault says more than that axis."""
    if fault.code is TrustCode.SENSOR_STUCK:
        return any(("axis", AXIS_NAMES[Axis.RADIAL]) in part.values for part in fault)
    return fault.code in (TrustCode.SENSOR_DEAD, TrustCode.SENSOR_TILTED)


def _may_hide_contacts(
    buffer: SampleBuffer, start: float, end: float, turns: int, dips: Callable[[NDArray[np.int16]], bool]
) -> bool:
    """Return whether contacts may be at all places where they would be between two at a steady speed.

    There, samples were lost, or they dip as in a contact, which was passed over for its distance to the one before.
    """
    period = (end - start) / turns
    reach = _HIDDEN_WITHIN_TURNS * period
    windows = ((math.floor(start + n * period - reach), math.ceil(start + n * period + reach)) for n in range(1, turns))
    return all(buffer.missing_between(*window) or dips(buffer.view(*window)) for window in windows)


def _dips(samples: NDArray[np.int16], column: int, level: float, scale: float) -> bool:
    """Return whether the radial axis in samples of half a turn, (n, channels), stays nearer to zero than a level."""
    counts = samples[:, column]
    width = max(3, round(_DIP_SHARE * len(counts)))
    if len(counts) < width:
        return False
    sums = np.cumsum(np.concatenate([[0], counts]), dtype=np.int64)
    means = (sums[width:] - sums[:-width]) / width
    return bool((means < level).any() if scale > 0.0 else (means > level).any())
