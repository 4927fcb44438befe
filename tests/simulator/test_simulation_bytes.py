"""The simulator as a source of bytes: determinism, protocol, timing and truth."""

import math
import threading
from itertools import pairwise

import numpy as np
import pytest

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    HUB_ITSELF,
    Coupling,
    Environment,
    Frame,
    Hello,
    HubStatus,
    LogText,
    SampleBlock,
    TimeSync,
)
from gateway.core.clock import ManualClock
from gateway.core.errors import ConfigError, SourceError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem, open_source
from gateway.simulator.scenario import parse_scenario
from gateway.simulator.simulation import simulate
from gateway.simulator.simulator_source import SimulatorSource

START_NS = 1_700_000_000_000_000_000
LINK = "sim:test"


def chunks_of(uri: str) -> list[Chunk]:
    source = open_source(uri, ManualClock(START_NS))
    return [item for item in source.items(threading.Event()) if isinstance(item, Chunk)]


def decode(chunks: list[Chunk]) -> tuple[list[Frame], FrameDecoder]:
    decoder = FrameDecoder()
    return [frame for chunk in chunks for frame in decoder.feed(chunk.data)] + decoder.finish(), decoder


def scenario(text: str, **arguments: float) -> tuple[list[Chunk], object]:
    simulation = simulate(parse_scenario(text, "test"), **arguments)  # type: ignore[arg-type]
    return list(simulation.chunks(LINK, START_NS)), simulation


WHEEL = '[[wheel]]\nposition = "W"\nwheel = 0\n'


def test_bytes_depend_on_the_seed_only() -> None:
    uri = "sim:demo?speed=max&duration=0.6"
    assert chunks_of(uri) == chunks_of(uri)
    assert chunks_of(f"{uri}&seed=1") == chunks_of(uri)
    assert chunks_of(f"{uri}&seed=2") != chunks_of(uri)
    longer = b"".join(chunk.data for chunk in chunks_of("sim:demo?speed=max&duration=1.0"))
    assert longer.startswith(b"".join(chunk.data for chunk in chunks_of(uri))[:100_000])


def test_frames_are_intact_numbered_and_sized() -> None:
    frames, decoder = decode(chunks_of("sim:demo?speed=max&duration=4.2"))
    counters = decoder.counters
    assert counters.noise_bytes == counters.lost == counters.crc_errors == counters.skipped == 0
    sources = {(frame.hub, frame.wheel) for frame in frames}
    assert sources == {(0, 0), (0, 1), (0, 2), (0, 3), (0, HUB_ITSELF)}
    for source in sources:
        of_source = [frame for frame in frames if (frame.hub, frame.wheel) == source]
        assert [frame.seq for frame in of_source] == list(range(len(of_source)))
        assert sum(isinstance(frame.message, Hello) for frame in of_source) == (0 if source[1] == HUB_ITSELF else 3)
        slow = Environment if source[1] != HUB_ITSELF else HubStatus
        assert sum(isinstance(frame.message, slow) for frame in of_source) == 5
        blocks = [frame.message for frame in of_source if isinstance(frame.message, SampleBlock)]
        assert [block.first_sample for block in blocks] == [36 * n for n in range(len(blocks))]
        assert all(block.counts.shape == (36, 3) for block in blocks)
        if source[1] != HUB_ITSELF:
            assert isinstance(of_source[0].message, Hello)
            # Only an incomplete frame at the end is missing.
            assert 0 <= 4.2 * 9600 - 36 * len(blocks) < 37
    texts = [frame.message.text for frame in frames if isinstance(frame.message, LogText)]
    assert texts == ["treadlink simulator: Demo car, seed 1"]


@pytest.mark.parametrize(("axes", "size"), [('["radial"]', 109), ('["radial", "lateral"]', 54)])
def test_fewer_axes_fill_frames(axes: str, size: int) -> None:
    chunks, _ = scenario(f"[sensor]\naxes = {axes}\n{WHEEL}", duration_s=0.2)
    blocks = [frame.message for frame in decode(chunks)[0] if isinstance(frame.message, SampleBlock)]
    assert {len(block.counts) for block in blocks} == {size}


def test_hello_describes_the_sensor() -> None:
    chunks, _ = scenario(
        f'{WHEEL}sensor_id = "00c0ffee"\n[wheel.sensor]\ncoupling = "ac"\nhighpass_hz = 2.0\nrate_hz = 4800.0\n'
        "radial_sign = -1\n[[hub]]\nhub = 0\nboot_count = 9\n",
        duration_s=0.1,
    )
    hello = next(frame.message for frame in decode(chunks)[0] if isinstance(frame.message, Hello))
    assert hello.sensor_id == 0xC0FFEE
    assert (hello.coupling, hello.highpass_hz, hello.rate_hz, hello.boot_count) == (Coupling.AC, 2.0, 4800.0, 9)
    assert hello.scale_mps2[2] == pytest.approx(-hello.scale_mps2[0])
    assert hello.range_mps2[2] == pytest.approx(hello.scale_mps2[0] * 32767, rel=1e-6)


def test_hub_clock_runs_fast_and_wraps() -> None:
    text = f"[[hub]]\nhub = 0\nclock_ppm = 500.0\nuptime_s = 4294.0\nbattery_percent = 50.0\n{WHEEL}"
    chunks, simulation = scenario(text, duration_s=4.0)
    frames, _ = decode(chunks)
    blocks = [frame for frame in frames if isinstance(frame.message, SampleBlock)]
    ticks = np.array([frame.tick_us for frame in blocks])
    assert (np.diff(ticks) < 0).sum() == 1  # 32 bits of microseconds are over at 4294.97 s
    steps = np.diff(np.unwrap(ticks, period=2**32))
    # The hub counts its own microseconds: 36 samples of its own 9600 Hz.
    assert steps == pytest.approx(3750.0, abs=1.0)
    syncs = [frame.message for frame in frames if isinstance(frame.message, TimeSync)]
    assert [sync.hub_us for sync in syncs] == [round((4294 + n * (1 + 500e-6)) * 1e6) for n in range(4)]
    # A fast hub takes more samples in the same true time.
    assert abs(len(blocks) * 36 - 4.0 * 9600 * (1 + 500e-6)) < 40
    truth = simulation.truth["W"]  # type: ignore[attr-defined]
    assert truth.hub_s(2.0) == pytest.approx(4296.001)


def test_chunks_arrive_every_10_ms_after_their_samples() -> None:
    chunks = chunks_of("sim:lab?speed=max&duration=2")
    times = np.array([chunk.host_ns - START_NS for chunk in chunks]) * 1e-9
    assert (np.diff(times) >= 0).all()
    assert np.diff(times).mean() == pytest.approx(0.010, rel=0.02)
    decoder = FrameDecoder()
    for chunk, time_s in zip(chunks, times, strict=True):
        for frame in decoder.feed(chunk.data):
            if isinstance(frame.message, SampleBlock):
                last_s = (frame.message.first_sample + 35) / 9600
                assert 0.0 < time_s - last_s < 0.02 + 0.0061


def test_truth_finds_the_sensor_below_the_axle() -> None:
    chunks, simulation = scenario(
        f"[motion]\nspeed_kmh = [[0, 60], [4, 80]]\n[sensor]\nnoise_mg_rthz = 1.0\n{WHEEL}", duration_s=4.0
    )
    truth = simulation.truth["W"]  # type: ignore[attr-defined]
    frames, _ = decode(chunks)
    radial = np.concatenate([f.message.counts for f in frames if isinstance(f.message, SampleBlock)])[:, 2]
    scale = next(frame.message for frame in frames if isinstance(frame.message, Hello)).scale_mps2[2]
    signal = radial * scale
    bottoms = truth.bottom_times_s(0.2, 3.8)
    turned = np.diff(truth.angle_rad(np.array([0.2, 3.8])))[0] / (2 * math.pi)
    assert len(bottoms) == pytest.approx(turned, abs=1)
    for time_s in bottoms:
        omega = truth.omega_radps(time_s)
        level = 0.5 * 0.32 * omega**2
        index = round(time_s * 9600)
        half = int(0.5 / omega * 9600)
        inside = np.flatnonzero(signal[index - half : index + half] < level) + index - half
        # Half-level crossings lie evenly about the bottom of an undamped tire.
        assert (inside[0] + inside[-1]) / 2 / 9600 == pytest.approx(time_s, abs=1.5e-4)
        leading, trailing = truth.contact_edges_rad(time_s)
        assert (inside[-1] - inside[0]) / 9600 * omega == pytest.approx(trailing - leading, rel=0.25)
    assert truth.speed_mps(2.0) == pytest.approx(70 / 3.6)
    assert truth.numbers(0.0).Cw == pytest.approx(0.195)


def test_bending_stiffness_is_cubic_in_thickness() -> None:
    text = f"{WHEEL}[wheel.tire]\nwear_mm = 5.0\nring_thickness_mm = 15.0\n"
    _, simulation = scenario(text, duration_s=0.1)
    numbers = simulation.truth["W"].numbers(0.0)  # type: ignore[attr-defined]
    assert numbers.Bs == pytest.approx(3.08e-3 * (2 / 3) ** 3)
    assert numbers.Rs == pytest.approx(2.97)


def test_half_of_the_sidewall_stiffness_grows_with_pressure() -> None:
    _, simulation = scenario(f"{WHEEL}pressure_kpa = [[0, 210], [10, 420]]\n", duration_s=0.1)
    truth = simulation.truth["W"]  # type: ignore[attr-defined]
    assert truth.numbers(0.0).Rs == pytest.approx(2.97)
    assert truth.numbers(10.0).Rs == pytest.approx(2.97 * 1.5 / 2)
    assert truth.numbers(10.0).Cw == pytest.approx(0.195)


def test_source_connects_paces_and_ends() -> None:
    for speed, elapsed_s in (("1", 0.5), ("10", 0.05), ("max", 0.0)):
        clock = ManualClock(START_NS)
        source = open_source(f"sim:lab?speed={speed}&duration=0.5", clock)
        items: list[LinkItem] = list(source.items(threading.Event()))
        assert isinstance(items[0], LinkEvent)
        assert items[0].kind is LinkEventKind.CONNECTED
        assert isinstance(items[-1], LinkEvent)
        assert items[-1].kind is LinkEventKind.ENDED
        assert {item.link for item in items} == {source.link} == {"sim:lab"}
        assert all(a.host_ns <= b.host_ns for a, b in pairwise(items))
        # Whatever the pace, the chunks carry times on the scenario's own scale.
        assert (items[-1].host_ns - START_NS) * 1e-9 == pytest.approx(0.5, abs=0.02)
        assert (clock.now_ns() - START_NS) * 1e-9 == pytest.approx(elapsed_s, abs=0.02)


def test_pace_does_not_drift_with_slow_reader() -> None:
    clock = ManualClock(START_NS)
    source = open_source("sim:lab?speed=1&duration=1", clock)
    for number, item in enumerate(source.items(threading.Event())):
        if number % 10 == 0 and isinstance(item, Chunk):
            clock.advance_ns(60_000_000)  # late for six chunks, then caught up
    assert (clock.now_ns() - START_NS) * 1e-9 == pytest.approx(1.0, abs=0.1)


def test_stop_and_close_end_an_endless_source() -> None:
    stop = threading.Event()
    source = open_source("sim:lab?speed=1", ManualClock(START_NS))
    seen = 0
    for _ in source.items(stop):
        seen += 1
        if seen == 50:
            stop.set()
    assert seen == 50
    closed = open_source("sim:lab?speed=max", ManualClock(START_NS))
    for number, _ in enumerate(closed.items(threading.Event())):
        if number == 20:
            closed.close()
            closed.close()
    assert number == 20


def test_uri_and_scenario_faults_are_combined() -> None:
    source = open_source("sim:lab?speed=max&duration=2&fault=drop:rate=0.05;flip:rate=0.05", ManualClock(START_NS))
    assert isinstance(source, SimulatorSource)
    chunks = [item for item in source.items(threading.Event()) if isinstance(item, Chunk)]
    _, decoder = decode(chunks)
    drop, flip = source.simulation.faults
    assert decoder.counters.lost == pytest.approx(drop.counts.frames_hit + flip.counts.frames_hit, abs=2)
    assert decoder.counters.lost > 10
    plus = open_source("sim:lab?duration=2&fault=drop:rate=0.05+flip:rate=0.05", ManualClock(START_NS))
    assert isinstance(plus, SimulatorSource)
    assert [fault.kind for fault in plus.simulation.faults] == ["drop", "flip"]
    text = f'[scenario]\nfaults = ["drop:rate=0.5"]\n{WHEEL}'
    chunks, simulation = scenario(text, duration_s=1.0)
    assert simulation.faults[0].counts.frames_hit > 50  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("speed=0", "invalid option speed=0"),
        ("speed=fast", "invalid option speed=fast"),
        ("duration=-1", "invalid option duration=-1"),
        ("seed=x", "invalid option seed=x"),
        ("sped=1", "no option 'sped'"),
        ("fault=bang", "fault 'bang' is invalid"),
    ],
)
def test_invalid_options_are_reported(options: str, message: str) -> None:
    with pytest.raises(SourceError, match=message) as caught:
        open_source(f"sim:demo?{options}", ManualClock())
    assert caught.value.remedy


def test_unsolvable_tire_is_reported() -> None:
    text = f"{WHEEL}load_n = 50000.0\npressure_kpa = 20.0\n[wheel.tire]\nradius_mm = 120.0\n"
    with pytest.raises(ConfigError, match="wheel W: its tire cannot be solved"):
        simulate(parse_scenario(text, "test"))


def test_two_hubs_share_a_link() -> None:
    text = f'{WHEEL}[[wheel]]\nposition = "X"\nhub = 5\nwheel = 0\n[[hub]]\nhub = 5\nuptime_s = 100.0\n'
    frames, decoder = decode(scenario(text, duration_s=1.5)[0])
    assert {frame.hub for frame in frames} == {0, 5}
    assert decoder.counters.lost == decoder.counters.restarts == 0
    uptimes = {f.hub: f.message.uptime_s for f in frames if isinstance(f.message, HubStatus)}
    assert uptimes == {0: 1, 5: 101}
