"""Driver of a day: hubs, bus, receiver, broker and disk beside a real session, whose clock moves as it can follow."""

import resource
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import can
import numpy as np

from gateway.core.config.validation import parse_document
from gateway.core.config.vehicle import VehicleConfig, parse_vehicle
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import AlarmChange, RevolutionResult, SessionSnapshot, SinkSnapshot, SinkState
from gateway.core.estimates.weighted_mean import WeightedMean
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk, Sentences, is_live, open_source
from gateway.core.reasons import Notice, Reason
from gateway.core.recording.run_description import RunDescription
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.live import LiveSession, Recordings
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_stage import Recorder
from gateway.publishing.publisher import Publisher, open_publisher
from gateway.publishing.sink import SinkSetting
from gateway.simulator.link_faults import apply_faults, frame_pieces, parse_fault
from gateway.simulator.motion import MotionProfile
from gateway.simulator.receiver import SimulatedReceiver, rmc
from gateway.simulator.scenario import vehicle_toml
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate
from gateway.vehicle.vehicle_signals import RECEIVER_SIGNALS
from tools.mqtt_broker import Broker
from tools.rehearsal.ends import DayClock, GatedSource, HubEnd, PtyEnd, TcpEnd
from tools.rehearsal.plan import BUS, HUBS, LINKS, POSITIONS, RECEIVER, TERMINALS, Fault, Kind

START_NS: Final = 1_790_000_000_000_000_000
ESTIMATORS: Final = ("kinematic", "weak-form")
STEP_NS: Final = 50_000_000
_BUS_STEP_NS: Final = 100_000_000
_RECEIVER_HZ: Final = 5.0
_PLACE: Final = frozenset(signal.name for signal in RECEIVER_SIGNALS if signal.suffix == "deg")
# The session may lag behind the readers by this much of the day.
_MOST_LAG_NS: Final = 2_000_000_000
_TIMEOUT_S: Final = 60.0
_WRITTEN_S: Final = 0.5
_CHANGED_HUB_S: Final = 1.5
# Alarms are heard from the session itself, and the bus of this day has no mapping.
_NOT_NAMES: Final = frozenset(
    {
        SessionCode.ALARM_RAISED,
        SessionCode.ALARM_CLEARED,
        SessionCode.ALARM_STANDS,
        SessionCode.ALARM_COMES_AND_GOES,
        SessionCode.BUS_NOT_MAPPED,
    }
)
_SCENARIO: Final = """
[scenario]
seed = {seed}
name = "Rehearsal"
[motion]
speed_kmh = 45.0
[sensor]
rate_hz = 2000.0
"""
_THRESHOLDS: Final = "\n[thresholds]\nframe_loss_max_percent = 5.0\n"


@dataclass(slots=True)
class Played:
    """What a day left behind; times in s from its beginning.

    Attributes:
        sent: frames of each hub, content of those of the bus, and sentences of the receiver, with their times.
        recordings: files, in their order.
        said: time, subject and name of each alarm and warning.
        standing: alarms that stand at the end: subject and name.
        restored_s: of each link, the times at which it came back.
        means: weighted mean of the valid estimates, by position and name.
        single_std: sum and number of their standard errors.
        revolutions: number of results.
        published: revolutions and alarms that the broker took, and those that it did not get.
        links: name of the link of each hub, then of the bus and the receiver.
    """

    sent: list[list[tuple[float, bytes]]]
    recordings: list[Path] = field(default_factory=list)
    said: list[tuple[float, str, str]] = field(default_factory=list)
    standing: list[tuple[str, str]] = field(default_factory=list)
    restored_s: dict[str, list[float]] = field(default_factory=dict)
    means: dict[tuple[str, str], WeightedMean] = field(default_factory=lambda: defaultdict(WeightedMean))
    single_std: dict[tuple[str, str], list[float]] = field(default_factory=lambda: defaultdict(list))
    revolutions: int = 0
    published: tuple[int, int] = (0, 0)
    links: list[str] = field(default_factory=list)


class _Heard:
    """Live outputs that also keep what alarms say."""

    def __init__(self, publisher: Publisher | None, played: Played) -> None:
        self.publisher = publisher
        self._played = played

    def take(self, items: Sequence[RevolutionResult | AlarmChange], host_ns: int) -> None:
        for item in items:
            if isinstance(item, RevolutionResult):
                self._count(item)
            elif item.is_raised:
                self._played.said.append((item.at_s, item.alarm.position, str(item.alarm.name)))
        if self.publisher is not None:
            self.publisher.take(items, host_ns)

    def _count(self, result: RevolutionResult) -> None:
        self._played.revolutions += 1
        for estimate in result.estimates:
            # Where the vehicle is depends on the length of the day.
            if estimate.status is Status.VALID and estimate.std > 0.0 and estimate.name not in _PLACE:
                key = result.position, estimate.name
                self._played.means[key].add(estimate.value, estimate.std)
                self._played.single_std[key].append(estimate.std)

    def show(self, snapshot: SessionSnapshot, host_ns: int) -> None:
        if self.publisher is not None:
            self.publisher.show(snapshot, host_ns)

    def sinks(self) -> tuple[SinkSnapshot, ...]:
        return self.publisher.sinks() if self.publisher is not None else ()


def _hub_scenario(seed: int, hub: int, *, sensor: int = 0xA000) -> str:
    return (
        _SCENARIO.format(seed=seed)
        + f'[[hub]]\nhub = {hub}\n[[wheel]]\nposition = "{POSITIONS[hub]}"\nhub = {hub}\nwheel = 0\n'
        f'sensor_id = "{sensor + hub:08x}"\nload_n = {4000 + 100 * hub}\n'
    )


def day_vehicle() -> VehicleConfig:
    """Return the configuration of the day's vehicle."""
    wheels = [_hub_scenario(0, hub).partition("[[hub]]")[2] for hub in range(HUBS)]
    text = _SCENARIO.format(seed=0) + "".join(f"[[hub]]{wheel}" for wheel in wheels)
    return parse_vehicle(vehicle_toml(parse_document(Scenario, text, "rehearsal")) + _THRESHOLDS, "rehearsal")


def _receiver(seed: int) -> SimulatedReceiver:
    motion = parse_document(Scenario, _hub_scenario(0, 0), "rehearsal").motion
    return SimulatedReceiver(MotionProfile(motion.speed_kmh), _RECEIVER_HZ, np.random.default_rng(seed))


def hub_chunks(seed: int, hub: int, faults: Sequence[Fault], day_s: float) -> Iterator[Chunk]:
    """Return what a hub sends. Restarts and silence are its own, before its line: they lose no frame."""
    mine = [fault for fault in faults if fault.target == hub]

    def stream(text: str, start_s: float) -> Iterator[Chunk]:
        start_ns = START_NS + round(start_s * 1e9)
        return simulate(parse_document(Scenario, text, "rehearsal"), duration_s=day_s - start_s).chunks("", start_ns)

    selected = {
        Kind.RESTART: "reboot:at={begin},gap={gap}",
        Kind.SENSOR: "silence:part=1,at={begin},for={gap}",
    }
    texts = [selected[f.kind].format(begin=f.begin_s, gap=f.end_s - f.begin_s) for f in mine if f.kind in selected]
    replaced = next((fault for fault in mine if fault.kind is Kind.REPLACED), None)
    until_ns = START_NS + round((day_s if replaced is None else replaced.begin_s) * 1e9)

    def hubs() -> Iterator[Chunk]:
        for chunk in stream(_hub_scenario(hub, hub), 0.0):
            if chunk.host_ns >= until_ns:
                break
            yield chunk
        if replaced is not None:
            yield from stream(_hub_scenario(HUBS + hub, hub, sensor=0xB000), replaced.begin_s + _CHANGED_HUB_S)

    return apply_faults([parse_fault(text, seed) for text in texts], hubs())


class Day:
    """A day that is played once."""

    def __init__(self, folder: Path, seed: int, faults: Sequence[Fault], day_s: float, broker: Broker | None) -> None:
        """Prepare; `folder` takes ports and recordings, `broker` runs."""
        self._folder, self._seed, self._faults, self._day_s = folder, seed, list(faults), day_s
        self._broker = broker
        self._clock = DayClock(START_NS)
        self._played = Played([[] for _ in range(LINKS)])
        self._ends: dict[int, HubEnd] = {}
        self._goals = [0] * LINKS
        self._paused_ns = 0

    def play(self) -> Played:
        """Play the day and return what it left.

        Raises:
            AssertionError: the session does not follow.
        """
        with ExitStack() as stack:
            for hub in range(HUBS):
                end: HubEnd = PtyEnd(self._folder / f"ttyDay{hub}") if hub in TERMINALS else TcpEnd()
                stack.callback(end.unplug)
                self._ends[hub] = end
            self._ends[RECEIVER] = PtyEnd(self._folder / "ttyReceiver", "nmea")
            stack.callback(self._ends[RECEIVER].unplug)
            channel = f"rehearsal-{self._folder}"
            bus = stack.enter_context(can.Bus(channel, "virtual"))
            uris = [self._ends[end].uri if end in self._ends else f"can:virtual:{channel}" for end in range(LINKS)]
            self._sources = [GatedSource(open_source(uri, self._clock), self._clock) for uri in uris]
            self._played.links = [source.link for source in self._sources]
            publish = [f"mqtt://127.0.0.1:{self._broker.port}/day?discovery=off"] if self._broker is not None else []
            self._heard = _Heard(open_publisher(publish, SinkSetting(POSITIONS), self._clock), self._played)
            self._live = LiveSession(
                self._sources,
                SessionCore(day_vehicle(), estimators=ESTIMATORS),
                self._clock,
                patient=[not is_live(uri) for uri in uris],
                recordings=Recordings(self._recorder(), self._recorder),
                publication=self._heard,
            )
            stack.callback(self._live.request_stop)
            self._live.start()
            self._until(lambda: all(source.is_connected for source in self._sources), "every link is open")
            self._drive(bus)
            self._end()
        return self._played

    def _recorder(self, run: RunDescription | None = None) -> Recorder:
        path = self._folder / f"part{len(self._played.recordings) + 1}.mcap"
        self._played.recordings.append(path)
        return RecordingWriter(path, start_ns=self._clock.now_ns(), run=run)

    def _drive(self, bus: can.BusABC) -> None:
        streams = [frame_pieces(hub_chunks(self._seed, hub, self._faults, self._day_s)) for hub in range(HUBS)]
        heads = [next(stream, None) for stream in streams]
        bits = {
            fault: parse_fault("flip:rate=0.3", (self._seed, number))
            for number, fault in enumerate(self._faults)
            if fault.kind is Kind.NOISE
        }
        sentences = _receiver(self._seed).sentences(START_NS)
        sentence = next(sentences)
        waiting = [*self._faults]
        present: list[Fault] = []
        for step in range(round(self._day_s * 1e9) // STEP_NS):
            now_s = step * STEP_NS * 1e-9
            for fault in [fault for fault in present if fault.end_s <= now_s]:
                self._finish(fault)
                present.remove(fault)
            while waiting and waiting[0].begin_s <= now_s:
                present.append(waiting.pop(0))
                self._begin(present[-1])
            for hub, stream in enumerate(streams):
                while (head := heads[hub]) is not None and head[1] < START_NS + (step + 1) * STEP_NS:
                    heads[hub] = next(stream, None)
                    data = b"".join(piece.data for piece in head[2])
                    self._played.sent[hub] += [(now_s, piece.data) for piece in head[2] if piece.whole]
                    noise = next((f for f in present if f.kind is Kind.NOISE and f.target == hub), None)
                    if noise is not None:
                        data = b"".join(chunk.data for chunk in bits[noise]([Chunk("", 0, data)]))
                    self._send(hub, data)
            if step * STEP_NS % _BUS_STEP_NS == 0 and not any(fault.kind is Kind.BUS for fault in present):
                content = step.to_bytes(8, "little")
                bus.send(can.Message(arbitration_id=0x123, data=content, is_extended_id=False))
                self._played.sent[BUS].append((now_s, content))
                self._goals[BUS] += 1
            while sentence.host_ns < START_NS + (step + 1) * STEP_NS:
                self._receive(sentence, now_s, {fault.kind for fault in present})
                sentence = next(sentences)
            if any(fault.kind is Kind.PAUSE for fault in present):
                self._paused_ns += STEP_NS  # nothing of this computer runs
            else:
                self._clock.advance_ns(STEP_NS)
                self._follow()
            self._take_notices()
        for fault in present:
            self._finish(fault)

    def _receive(self, sentence: Sentences, now_s: float, present: set[Kind]) -> None:
        """Send a sentence of the receiver, if it is on, without a position where it has lost that."""
        if Kind.RECEIVER in present:
            return
        line = sentence.data if Kind.POSITION not in present else rmc(sentence.host_ns, 0.0, 0.0, 0.0, has_fix=False)
        self._played.sent[RECEIVER].append((now_s, line))
        self._send(RECEIVER, line)

    def _send(self, hub: int, data: bytes) -> None:
        # A line may take bytes before its reader says that it is there, and a reader may discard them.
        if self._sources[hub].is_connected:
            self._goals[hub] += len(data) - self._ends[hub].send(data)

    def _follow(self) -> None:
        """Wait until the readers have what was sent, and the session is not far behind."""
        begin_s = time.monotonic()
        while behind := [number for number in range(len(self._sources)) if self._is_behind(number)]:
            assert time.monotonic() - begin_s < _TIMEOUT_S, f"not read within {_TIMEOUT_S:g} s: {behind}"
            time.sleep(0.0005)
        self._until(lambda: self._clock.now_ns() - self._live.core.newest_ns < _MOST_LAG_NS, "the session follows")

    def _is_behind(self, number: int) -> bool:
        end = self._ends.get(number)
        is_waiting = end is not None and self._sources[number].is_connected and end.waiting()
        return is_waiting or self._sources[number].read != self._goals[number]

    def _begin(self, fault: Fault) -> None:
        if fault.kind in (Kind.UNPLUGGED, Kind.CUT):
            self._ends[fault.target].unplug()
            self._until(lambda: not self._sources[fault.target].is_connected, "the link is lost")
            self._goals[fault.target] = self._sources[fault.target].read
        elif fault.kind is Kind.PAUSE:
            for source in self._sources:
                source.gate.clear()
        elif fault.kind is Kind.CLOCK:
            self._clock.set_system_time(round(fault.size_s * 1e9))
        elif fault.kind is Kind.BROKER and self._broker is not None:
            self._broker.kill()
            self._until(lambda: self._sink_state() is not SinkState.UP, "the broker is missed")
        elif fault.kind is Kind.DISK:
            # A busy processor would leave seconds of a compressed day in memory, which a full disk loses.
            time.sleep(_WRITTEN_S)
            size = self._played.recordings[-1].stat().st_size
            self._limit = resource.getrlimit(resource.RLIMIT_FSIZE)
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, self._limit[1]))

    def _finish(self, fault: Fault) -> None:
        if fault.kind in (Kind.UNPLUGGED, Kind.CUT):
            self._ends[fault.target].plug()
        elif fault.kind is Kind.PAUSE:
            self._clock.pause_computer(self._paused_ns)
            self._paused_ns = 0
            for source in self._sources:
                source.gate.set()
        elif fault.kind is Kind.BROKER and self._broker is not None:
            self._broker.start()
        elif fault.kind is Kind.DISK:
            resource.setrlimit(resource.RLIMIT_FSIZE, self._limit)
            self._until(lambda: self._live.core.recording.recorder is None, "the full disk is noticed", moves=True)
            self._live.start_recording()

    def _sink_state(self) -> SinkState:
        return self._heard.sinks()[0].state

    def _end(self) -> None:
        self._follow()
        snapshot = self._live.close()
        self._take_notices()
        if self._heard.publisher is not None:
            (sink,) = self._heard.publisher.close()
            self._played.published = sink.published, sink.dropped
        self._played.standing = [(r.position, str(r.name)) for r in snapshot.alarm_records if r.is_standing]
        for source in self._sources:
            self._played.restored_s[source.link] = [(at_ns - START_NS) * 1e-9 for at_ns in source.connected_ns]

    def _take_notices(self) -> None:
        at_s = (self._live.core.newest_ns - START_NS) * 1e-9
        self._live.results()
        self._played.said += [
            (at_s, notice.subject, name) for notice in self._live.notices() for name in _names(notice)
        ]

    def _until(self, condition: Callable[[], bool], what: str, *, moves: bool = False) -> None:
        """Wait in real time; `moves` lets the clock of the day run with it."""
        due_s = time.monotonic() + _TIMEOUT_S
        while not condition():
            assert time.monotonic() < due_s, f"not within {_TIMEOUT_S:g} s: {what}"
            self._live.check()
            time.sleep(0.001)
            if moves:
                self._clock.advance_ns(1_000_000)


def _names(notice: Notice) -> Iterator[str]:
    """Yield what a notice says to be wrong: its code, or that of the event of a link; alarms are heard as such."""
    reason = notice.reason
    if str(notice.level) not in ("warning", "error") or reason.code in _NOT_NAMES:
        return
    event = reason["event"] if reason.code is LinkCode.LINK_EVENT else reason
    if isinstance(event, Reason) and event.code is not LinkCode.COMPUTER_EVENT:  # the recording has those
        yield str(event.code)
