"""Byte streams of real frames, cut into chunks as by a link, and recordings of them."""

import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Coupling, Environment, Frame, Hello, HubStatus, MessageType, SampleBlock
from gateway.core.clock import ManualClock
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem, open_source
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter

START_NS = 1_732_150_000_000_000_000
RATE_HZ = 9600.0
TOML = '[vehicle]\nname = "Test car"\n'


def hello(wheel: int = 0, boot_count: int = 3) -> Hello:
    return Hello(
        protocol_major=1,
        protocol_minor=0,
        hub_id=0x1122334455667788,
        sensor_id=0xA000 + wheel,
        firmware=(1, 2, 3),
        boot_count=boot_count,
        rate_hz=RATE_HZ,
        axes=7,
        coupling=Coupling.DC,
        highpass_hz=0.0,
        range_mps2=(4000.0, 4000.0, 4000.0),
        scale_mps2=(0.125, 0.125, 0.125),
        offset_counts=(0.0, 0.0, 0.0),
        saturation_counts=32000,
    )


def frames(rng: np.random.Generator, count: int, *, hub: int = 0, wheels: int = 4) -> list[bytes]:
    """Return `count` encoded frames, interleaved as by a hub: hellos, samples, environment, status."""
    sequences = dict.fromkeys([*range(wheels), 0xFF], 0)
    samples = dict.fromkeys(range(wheels), 0)
    boot_us = int(rng.integers(0, 60_000_000))
    encoded = []
    for number in range(count):
        wheel = number % wheels
        tick_us = round(samples[wheel] / RATE_HZ * 1e6) + boot_us
        if number < wheels:
            kind, message = MessageType.HELLO, hello(wheel)
        elif number % 211 == 0:
            wheel = 0xFF
            status = HubStatus(number // 100, 80, 3.3, 0.25, -60, number, 0, 0, 0)
            kind, message = MessageType.HUB_STATUS, status
        elif number % 97 == 0:
            kind, message = MessageType.ENVIRONMENT, Environment(210_000.0, 31.5, 2.9)
        else:
            counts = rng.integers(-32000, 32000, (36, 3)).astype("<i2")
            kind, message = MessageType.SAMPLES, SampleBlock(samples[wheel], 7, counts)
            samples[wheel] += 36
        encoded.append(encode_frame(Frame(kind, hub, wheel, sequences[wheel], tick_us, message)))
        sequences[wheel] += 1
    return encoded


def chunks(
    rng: np.random.Generator,
    stream: bytes,
    link: str,
    *,
    smallest: int = 1,
    largest: int = 600,
    step_ns: int = 2_000_000,
) -> list[Chunk]:
    """Cut a stream at random places, also inside frames, into chunks `step_ns` apart."""
    cut: list[Chunk] = []
    position = 0
    while position < len(stream):
        size = int(rng.integers(smallest, largest + 1))
        cut.append(Chunk(link, START_NS + len(cut) * step_ns, stream[position : position + size]))
        position += size
    return cut


def write(path: Path, items: Iterable[LinkItem], *, topics: bool = False, finish: bool = True) -> RecordingWriter:
    """Record items, optionally with decoded topics between them."""
    writer = RecordingWriter(path, start_ns=START_NS, vehicle_toml=TOML, sources=["sim:test"])
    for number, item in enumerate(items):
        writer.write(item)
        if topics and number % 7 == 3:
            row = {"index": number, "speed_mps": 22.0 + number, "Bs": 3e-3, "Bs_std": 1e-5}
            writer.write_topic("/wheel/FL/revolution", item.host_ns, row)
        if topics and number % 41 == 5:
            wave = {"index": number, "theta_rad": np.linspace(-3, 3, 64), "radial_mps2": np.arange(64.0)}
            writer.write_topic("/wheel/FL/waveform", item.host_ns, wave)
    if finish:
        writer.close()
    return writer


def some_events(link: str) -> list[LinkEvent]:
    return [
        LinkEvent(link, START_NS, LinkEventKind.CONNECTED, "open"),
        LinkEvent(link, START_NS + 10, LinkEventKind.LOST, "gone – unplugged?"),
        LinkEvent(link, START_NS + 20, LinkEventKind.RETRYING, "no port"),
        LinkEvent(link, START_NS + 30, LinkEventKind.RESTORED, "back", -61),
        LinkEvent("", START_NS + 40, LinkEventKind.MARK, "pothole"),
    ]


def read(path: Path) -> list[LinkItem]:
    return list(RecordingReader(path).items())


def link_bytes(items: Iterable[LinkItem], link: str | None = None) -> bytes:
    return b"".join(item.data for item in items if isinstance(item, Chunk) and link in (None, item.link))


def decoded(stream: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield (hub, wheel, seq) of every intact frame of a stream."""
    decoder = FrameDecoder()
    for frame in [*decoder.feed(stream), *decoder.finish()]:
        yield frame.hub, frame.wheel, frame.seq


def replay(uri: str) -> list[LinkItem]:
    return list(open_source(uri, ManualClock()).items(threading.Event()))
