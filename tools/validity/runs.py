"""Runs through the whole chain: ring, sensor, hub, bytes, decoder, pipeline, estimates, and the truth beside them."""

from __future__ import annotations

import hashlib
import math
import pickle
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from scipy.interpolate import CubicSpline

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Coupling, Environment, Frame, Hello, SampleBlock
from gateway.core.estimates.doubt_rules import EVERY_RULE, DoubtRule
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.links.source import Chunk
from gateway.core.types import FloatArray
from gateway.core.wheels.wheels import Pipeline
from gateway.simulator.hub import HubSimulator, TimedFrame
from gateway.simulator.link_faults import FAULTS, apply_faults, parse_faults
from gateway.simulator.road_profile import largest_swing, roughness_m3
from gateway.simulator.simulated_wheel import WheelSimulator
from gateway.simulator.simulation import BLOCK_S
from gateway.simulator.tire_model import TireModel
from gateway.simulator.tire_table import LATERAL, TABLE_ANGLES, Range, TireTable, WaveformTable
from gateway.simulator.truth import WheelTruth, slopes_of
from gateway.simulator.wheel_plan import WheelPlan
from validity.later_spoils import EVERY_SPOIL
from validity.spoils import Signal
from validity.statements import Statement
from validity.tires import World

T = TypeVar("T")

# Pass band of a sensor's decimation filter, as shares of the sampling rate: linear phase, as digital sensors have.
_PASS: Final = (0.40, 0.48)
_LINK: Final = "sim:bench"
# Corner that is stated of an AC coupling which is none.
_AC_HZ: Final = 0.5
# Option of a fault that its size is; of those that are not named, the rate.
_SIZE_OF: Final = {"reboot": "at", "silence": "at"}
# Loads under which the slopes are solved where the load changes.
_LOADS: Final = 3
_START_NS: Final = 1_760_000_000_000_000_000


class Store:
    """Solutions kept in a folder between runs; without a folder, nothing is kept."""

    folder: Path | None = None

    @classmethod
    def get(cls, key: tuple[Any, ...], make: Callable[[], T]) -> T:
        """Return what was made for a key before, or make it."""
        if cls.folder is None:
            return make()
        path = cls.folder / (hashlib.sha256(repr(key).encode()).hexdigest()[:32] + ".pickle")
        if path.is_file():
            stored: T = pickle.loads(path.read_bytes())
            return stored
        made = make()
        cls.folder.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(f".{id(made)}.part")
        part.write_bytes(pickle.dumps(made))
        part.replace(path)
        return made


class FilteredTable:
    """A tire's waveforms as a sensor with a decimation filter sees them."""

    def __init__(self, table: TireTable, highest_order: float) -> None:
        """Take the table, and the order that half the sampling rate is at the first speed."""
        self._table = table
        order = np.arange(TABLE_ANGLES // 2 + 1) / (2.0 * highest_order)
        fade = np.clip((order - _PASS[0]) / (_PASS[1] - _PASS[0]), 0.0, 1.0)
        self._gain = 0.5 * (1.0 + np.cos(math.pi * fade))
        self.depends_on_speed = table.depends_on_speed

    def edges_rad(self, load_n: float, pressure_pa: float, omega_radps: float) -> tuple[float, float]:
        """Return the true edges of the contact."""
        return self._table.edges_rad(load_n, pressure_pa, omega_radps)

    def waveform(self, *conditions: float) -> WaveformTable:
        """Return the waveform under given conditions, orders beyond the pass band removed."""
        return self._filtered(self._table.waveform(*conditions))

    def by_load(self, *conditions: float) -> tuple[FloatArray, list[WaveformTable]]:
        """Return the loads that are solved, and the waveform under each, likewise."""
        loads, waves = self._table.by_load(*conditions)
        return loads, [self._filtered(wave) for wave in waves]

    def _filtered(self, wave: WaveformTable) -> WaveformTable:
        for column in (0, 1, LATERAL):
            spectrum = np.fft.rfft(wave[:-1, column].astype(np.float64))
            wave[:-1, column] = np.fft.irfft(spectrum * self._gain, n=TABLE_ANGLES)
        wave[-1] = wave[0]
        return wave


@dataclass(frozen=True, slots=True)
class BenchPlan(WheelPlan):
    """A simulated wheel with its tire's waveforms.

    Attributes:
        waveforms: at the speeds of this run only.
    """

    waveforms: Any

    def table(self) -> Any:
        """Return the tire's waveforms."""
        return self.waveforms


@dataclass(frozen=True, slots=True)
class Run:
    """A recorded run: what the hub sent, and the truth.

    Attributes:
        world: the truth it was made from.
        frames: decoded frames.
        arrivals_s: true time at which each arrives.
        truth: of the simulated wheel.
        bottoms_s: times at which the sensor is directly below the axle.
        lateral: whether the lateral axis has a signal.
    """

    world: World
    frames: tuple[Frame, ...]
    arrivals_s: tuple[float, ...]
    truth: WheelTruth
    bottoms_s: FloatArray
    lateral: bool = True

    def slopes(self, turns: int | None = None) -> Slopes:
        """Return the slopes of the belt in the contact, without slip, in the mean over the first turns, or over all.

        NaN without a lateral axis, and where the pressure changes.
        """
        plan = self.truth.plan
        if not self.lateral or not plan.pressure_pa.is_constant or "lateral" not in plan.sensor.axes:
            return Slopes(*(math.nan,) * len(Slopes._fields))
        middle_s = 0.5 * self.world.seconds
        omega = self.truth.omega_radps(middle_s) if plan.tire.depends_on_speed else 0.0

        def under(load_n: float) -> Slopes:
            conditions = (plan.tire, load_n, self.world.pressure_pa, omega)
            return Store.get(("slopes and parity", *conditions), lambda: _slopes(*conditions))

        if plan.load_n.is_constant:
            return under(self.world.load_n)
        bottoms = self.bottoms_s[: turns or len(self.bottoms_s)]
        solved_n = np.linspace(plan.load_n.low, plan.load_n.high, _LOADS)
        by_load = np.polyfit(solved_n, np.array([under(float(load)) for load in solved_n]), _LOADS - 1)
        loads_n = np.asarray(plan.load_n.at_times(bottoms))
        means = np.vander(loads_n, _LOADS) @ by_load
        return Slopes(*means.mean(axis=0).tolist())


class Slopes(NamedTuple):
    """True slopes of the streamline in the contact at zero slip.

    Attributes:
        peak_rad: as in `LateralSlopes`.
        first_half_rad: likewise.
        adhesion_line_rad: likewise.
        contact_line_rad: of the line through the whole contact.
        conicity_rad: half the change of the mean slope from the first to the second half, by conicity alone.
    """

    peak_rad: float
    first_half_rad: float
    adhesion_line_rad: float
    contact_line_rad: float
    conicity_rad: float


# They are asked for at every revolution of a run.
@lru_cache(maxsize=8)
def _slopes(tire: TireModel, load_n: float, pressure_pa: float, omega_radps: float) -> Slopes:
    ring = tire.solve(load_n, pressure_pa, omega_radps)
    shape = tire.solve_lateral(ring, 0.0).y_m
    cone = replace(tire, lateral=replace(tire.lateral, coupling_length_m=0.0)).solve_lateral(ring, 0.0).y_m
    edges = ring.leading_edge_rad, ring.trailing_edge_rad
    theta = np.linspace(*edges, 2001)
    line = np.polyfit(ring.ring.radius_m * theta, np.interp(theta, ring.theta_rad, shape), 1)[0]
    first, middle, last = np.interp([edges[0], sum(edges) / 2.0, edges[1]], ring.theta_rad, cone)
    half_m = 0.5 * ring.ring.radius_m * (edges[1] - edges[0])
    return Slopes(
        *slopes_of(shape, ring.ring.radius_m, *edges), float(line), 0.5 * float(last - 2.0 * middle + first) / half_m
    )


def record(world: World, seed: Sequence[int]) -> Run:
    """Return a run of the exact ring; the same seed gives the same noise in every world."""
    return record_wheel(world, world.plan(), ring_waveforms, seed)


def record_wheel(
    world: World,
    plan: WheelPlan,
    waveforms: Callable[[WheelPlan, World], Any],
    seed: Sequence[int],
    *,
    lateral: bool = True,
) -> Run:
    """Return a run of a wheel whose waveforms come from anywhere.

    Args:
        world: what the run is made from.
        plan: the simulated wheel.
        waveforms: gives the table of waveforms, as a `TireTable`.
        seed: of phase and noise.
        lateral: whether the lateral axis has a signal.
    """
    table = FilteredTable(waveforms(plan, world), 0.5 * world.rate_hz * 2.0 * math.pi / world.omega_radps)
    bench_plan = BenchPlan(**{field.name: getattr(plan, field.name) for field in fields(plan)}, waveforms=table)
    wheel = WheelSimulator(bench_plan, np.random.default_rng(list(seed)))
    hub = HubSimulator(bench_plan.hub, [wheel], "bench")
    sent: list[TimedFrame] = []
    for block in range(math.ceil(world.seconds / BLOCK_S)):
        sent += hub.advance(min((block + 1) * BLOCK_S, world.seconds))
    decoder = FrameDecoder()
    frames: list[Frame] = []
    arrivals_s: list[float] = []
    for chunk in _delivered(sent, dict(world.link), seed):
        frames += decoder.feed(chunk.data)
        arrivals_s += [1e-9 * chunk.host_ns] * (len(frames) - len(arrivals_s))
    truth = WheelTruth(bench_plan, wheel.phase_rad)
    bottoms_s = truth.bottom_times_s(0.0, world.seconds)
    return Run(world, tuple(frames), tuple(arrivals_s), truth, bottoms_s, lateral)


def _delivered(sent: Sequence[TimedFrame], link: dict[str, float], seed: Sequence[int]) -> Iterator[Chunk]:
    """Yield what a link delivers of frames that are sent, with its faults; without any, each frame at once."""
    rng = np.random.default_rng([*seed, 9])
    step_s, late_s = 1e-3 * link.get("chunk_ms", 0.0), 1e-3 * link.get("jitter_ms", 0.0)
    chunks: list[Chunk] = []
    for _, group in groupby(sent, key=lambda frame: math.ceil(frame.time_s / step_s) if step_s else frame.time_s):
        frames = list(group)
        arrival_s = math.ceil(frames[-1].time_s / step_s) * step_s if step_s else frames[-1].time_s
        arrival_ns = round(1e9 * (arrival_s + late_s * float(rng.exponential())))
        # A link keeps the order of its bytes.
        arrival_ns = max(arrival_ns, chunks[-1].host_ns if chunks else 0)
        chunks.append(Chunk(_LINK, arrival_ns, b"".join(frame.data for frame in frames)))
    texts = [f"{name}:{_SIZE_OF.get(name, 'rate')}={size!r}" for name, size in link.items() if name in FAULTS]
    yield from apply_faults(parse_faults(texts), chunks)


def ring_waveforms(plan: WheelPlan, world: World) -> TireTable:
    """Return the waveforms of the plan's tire at the speeds of the run."""
    speeds = plan.motion.at(np.linspace(0.0, world.seconds, 200)).speed_mps / plan.radius_m
    swing = 0.0
    if plan.road.profile is not None:
        density = roughness_m3(plan.road.profile)
        swing = largest_swing(plan.quarter_car(), world.load_n, density, plan.road.waviness, plan.motion.highest_mps)
    extents = (
        Range(plan.load_n.low * (1.0 - swing), plan.load_n.high * (1.0 + swing)),
        Range(plan.pressure_pa.low, plan.pressure_pa.high),
        Range(float(speeds.min()), float(speeds.max())),
        Range(plan.slip_angle_rad.low, plan.slip_angle_rad.high),
    )
    return Store.get(("table", plan.tire, extents), lambda: TireTable(plan.tire, *extents))


def results_of(
    run: Run, statement: Statement, estimators: Sequence[str], rules: frozenset[DoubtRule] = EVERY_RULE
) -> list[RevolutionResult]:
    """Return the gateway's results of a run that is stated so, with some of its rules of doubt."""
    setups = [replace(setup, rules=rules) for setup in statement.vehicle(run.world).wheel_setups()]
    names = [name for name in estimators if name not in statement.left_out]
    pipeline = Pipeline(setups, WheelSetup("", 0, 0, setups[0].radius_m), names)
    results: list[RevolutionResult] = []
    frames = _channels(_spoiled(run, statement), run.world, statement)
    for frame, arrival_s in _received(zip(frames, run.arrivals_s, strict=True), *statement.lost):
        arrival_ns = _START_NS + round(1e9 * arrival_s / statement.rate_factor)
        results += pipeline.frames(_LINK, (_as_stated(frame, statement),), arrival_ns)
    return results + pipeline.finish()


def _spoiled(run: Run, statement: Statement) -> Sequence[Frame]:
    """Return the frames with what the sensor does to its samples."""
    blocks = [frame.message for frame in run.frames if isinstance(frame.message, SampleBlock)]
    hello = next((frame.message for frame in run.frames if isinstance(frame.message, Hello)), None)
    if not (statement.spoils or statement.wander[0]) or hello is None or not blocks:
        return run.frames
    scale = np.array([item for item in hello.scale_mps2 if item])
    counts = np.concatenate([block.counts for block in blocks])
    number = np.concatenate([block.first_sample + np.arange(len(block.counts)) for block in blocks])
    time_s = number / run.truth.plan.sample_rate_hz
    values = counts * scale
    if statement.wander[0]:
        true_s = statement.true_time_s(time_s)
        values = np.stack([CubicSpline(time_s, axis)(np.clip(true_s, 0.0, time_s[-1])) for axis in values.T], axis=1)
    signal = Signal(time_s, run.truth.angle_rad(time_s), values, run.truth.plan.sample_rate_hz)
    for name, size in statement.spoils:
        rng = np.random.default_rng(zlib.crc32(name.encode()))
        signal = signal._replace(values_mps2=EVERY_SPOIL[name](signal, size, rng))
    spoiled = np.clip(np.round(signal.values_mps2 / scale), -32768, 32767).astype(np.int16)
    parts = iter(np.split(spoiled, np.cumsum([len(block.counts) for block in blocks])[:-1]))
    return [
        frame._replace(message=frame.message._replace(counts=next(parts)))
        if isinstance(frame.message, SampleBlock)
        else frame
        for frame in run.frames
    ]


def _channels(frames: Sequence[Frame], world: World, statement: Statement) -> Iterator[Frame]:
    """Yield frames of a sensor whose axes are swapped or late."""
    late = [round(seconds * world.rate_hz) for seconds in statement.late_s]
    if statement.axes == (0, 1, 2) and not any(late):
        yield from frames
        return
    before = np.zeros((max(late), 3), np.int16)
    for frame in frames:
        message = frame.message
        if isinstance(message, SampleBlock) and message.counts.shape[1] == len(statement.axes):
            counts = np.concatenate([before, message.counts[:, statement.axes]])
            before, count = counts[len(counts) - len(before) :], len(message.counts)
            begin = len(counts) - count
            delayed = np.stack([counts[begin - lag : len(counts) - lag, axis] for axis, lag in enumerate(late)], axis=1)
            frame = frame._replace(message=message._replace(counts=delayed))
        yield frame


def _received(frames: Iterable[tuple[Frame, float]], share: float, in_a_row: int) -> Iterator[tuple[Frame, float]]:
    """Yield the frames that a link delivers which loses a share of those with samples, some in a row."""
    rng, losing = np.random.default_rng(1), 0
    for frame, arrival_s in frames:
        if share and isinstance(frame.message, SampleBlock):
            losing = losing - 1 if losing else in_a_row * int(rng.random() < share / (in_a_row * (1.0 - share)))
            if losing:
                continue
        yield frame, arrival_s


def _as_stated(frame: Frame, statement: Statement) -> Frame:
    """Return a frame of a sensor with another rate, unit or pressure than its own."""
    message = frame.message
    if isinstance(message, Hello):
        unit = statement.unit_factor
        message = message._replace(
            rate_hz=message.rate_hz * statement.rate_factor,
            scale_mps2=tuple(unit * scale for scale in message.scale_mps2),
            range_mps2=tuple(unit * scale for scale in message.range_mps2),
        )
    elif isinstance(message, Environment) and message.pressure_pa is not None:
        message = message._replace(pressure_pa=message.pressure_pa * statement.pressure_factor)
    for name, size, axis in statement.told:
        message = _told(message, name, size, axis)
    return frame._replace(message=message, tick_us=round(frame.tick_us / statement.rate_factor))


def _told(message: Any, name: str, size: Any, axis: int | None) -> Any:
    """Return a message with one of its fields edited, if it is that message."""
    kind, _, field = name.partition(":")
    if type(message).__name__.lower() != kind or getattr(message, field) in (None, 0.0):
        return message
    before = getattr(message, field)
    if field == "coupling":
        return message._replace(coupling=Coupling.AC, highpass_hz=_AC_HZ)
    if field == "temperature_degc":
        return message._replace(temperature_degc=before + size)
    if field == "saturation_counts":
        return message._replace(saturation_counts=round(0.01 * size * before))
    if axis is None:
        return message._replace(**{field: before * (1.0 + 0.01 * size)})
    values = list(before)
    if field == "offset_counts":
        values[axis] += size / message.scale_mps2[axis] if message.scale_mps2[axis] else 0.0
    else:
        values[axis] *= 1.0 + 0.01 * size
    return message._replace(**{field: tuple(values)})
