"""Fuzz targets: each takes any bytes and raises only on a defect of the program.

`tests/reliability/test_fuzzing.py` runs them with hypothesis, `tools/fuzz_atheris.py` with coverage guidance.
"""

from __future__ import annotations

import contextlib
import math
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.codec import encode_frame, encode_raw
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Coupling, Environment, Frame, Hello, MessageType, SampleBlock
from gateway.clock import ManualClock
from gateway.config.vehicle import load_vehicle
from gateway.errors import TreadlinkError
from gateway.importing.import_map import load_map
from gateway.importing.importer import import_file
from gateway.io.source import Chunk, open_source
from gateway.recording.reader import RecordingReader
from gateway.recording.repair import repair_recording
from gateway.recording.writer import RecordingWriter
from gateway.session.core import SessionCore
from gateway.simulator.scenario import load_scenario

_START_NS = 1_700_000_000_000_000_000
_MAP = """
[sampling]
rate_hz = 9600.0
[axis.radial]
column = "z"
unit = "g"
[sensor]
coupling = "DC"
[conditions]
name = "fuzzed"
position = "W1"
radius_mm = 300.0
"""


@dataclass(frozen=True, slots=True)
class Target:
    """Target of fuzzing.

    Attributes:
        text: what it is.
        run: takes the bytes; tells whether they were accepted, else the user got an error with words.
        seeds: makes good inputs to start from.
    """

    text: str
    run: Callable[[bytes], bool]
    seeds: Callable[[], list[bytes]]


class UnclearError(AssertionError):
    """An error that the user would not understand."""


def _explained(error: TreadlinkError) -> None:
    """Complain about an error whose message is empty or carries control characters to the terminal."""
    text = f"{error} {error.remedy}"
    if not str(error).strip() or any(ord(character) < 32 and character not in "\n\t" for character in text):
        raise UnclearError(repr(text)) from error


@cache
def _folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="fuzz"))


@contextlib.contextmanager
def _file(data: bytes, name: str):
    path = _folder() / name
    path.write_bytes(data)
    yield path


def decode(data: bytes) -> bool:
    """Both decoders with arbitrary chunks: the same frames, the same counters, every byte accounted for."""
    whole, cut, batch = FrameDecoder(), FrameDecoder(), BatchDecoder()
    expected = [*whole.feed(data), *whole.finish()]
    step = 1 + (data[0] if data else 0)
    found: list[Frame] = []
    for at in range(0, len(data), step):
        found += cut.feed(data[at : at + step])
        assert cut.pending_bytes < 244
    found += cut.finish()
    keys = [frame[:5] for frame in expected]
    assert [frame[:5] for frame in found] == keys
    assert cut.counters == whole.counters
    rows = [frame[:5] for frame in batch.feed(data).frames()]
    rows += [frame[:5] for frame in batch.finish().frames()]
    assert rows == keys
    assert batch.counters == whole.counters
    assert whole.counters.noise_bytes <= len(data)
    return bool(keys)


def session(data: bytes) -> bool:
    """Valid frames with arbitrary content: type, wheel, length and payload come from the bytes."""
    frames: list[bytes] = []
    at = 0
    while at + 8 <= len(data):
        kind, wheel, size = 1 + data[at] % 8, data[at + 1] % 3, min(data[at + 2], 224)
        tick_us = int.from_bytes(data[at + 3 : at + 7], "little")
        payload = data[at + 8 : at + 8 + size]
        frames.append(encode_raw(kind, payload, 0, wheel, data[at + 7] * 16 + len(frames), tick_us))
        at += 8 + size
    core = SessionCore(None)
    core.tick(_START_NS)
    for number, frame in enumerate(frames):
        for result in core.take(Chunk("fuzz", _START_NS + number * 1_000_000, frame)):
            assert math.isfinite(result.revolution.period_s)
    core.tick(_START_NS + 1_000_000_000)
    core.finish()
    core.snapshot(1.0)
    return any(wheel.counters.samples for wheel in core.snapshot(1.0).wheels)


def read_recording(data: bytes) -> bool:
    """Reader, replay and repair of a file that calls itself a recording."""
    accepted = False
    with _file(data, "r.mcap") as path:
        try:
            reader = RecordingReader(path)
            taken = sum(len(item.data) for item in reader.items() if isinstance(item, Chunk))
            # Plain chunks cannot hold more than the file; compressed ones are bounded by the format's own limit.
            assert taken <= max(len(data), 64 << 20)
            assert reader.damage is None or reader.damage
            source = open_source(f"replay:{path}?speed=max", ManualClock())
            for _ in source.items(threading.Event()):
                pass
            accepted = taken > 0
        except TreadlinkError as error:
            _explained(error)
        fixed = _folder() / "fixed.mcap"
        try:
            repair_recording(path, fixed)
            assert RecordingReader(fixed).info.finished
        except TreadlinkError as error:
            _explained(error)
        finally:
            fixed.unlink(missing_ok=True)
    return accepted


def import_table(data: bytes) -> bool:
    """A table that is to be imported with a good map."""
    with _file(data, "t.csv") as path, _file(_MAP.encode(), "good.map.toml") as map_path:
        out = _folder() / "imported.mcap"
        try:
            import_file(path, load_map(map_path), out)
            assert any(isinstance(item, Chunk) for item in RecordingReader(out).items())
        except TreadlinkError as error:
            _explained(error)
            return False
        finally:
            out.unlink(missing_ok=True)
    return True


def import_with_map(data: bytes) -> bool:
    """A map that a good table is to be imported with."""
    with _file(data, "m.map.toml") as map_path, _file(_good_table(), "good.csv") as path:
        out = _folder() / "mapped.mcap"
        try:
            import_file(path, load_map(map_path), out)
        except TreadlinkError as error:
            _explained(error)
            return False
        finally:
            out.unlink(missing_ok=True)
    return True


def read_vehicle(data: bytes) -> bool:
    """A vehicle configuration; an accepted one must round-trip through its text."""
    with _file(data, "v.toml") as path:
        try:
            vehicle = load_vehicle(path)
            vehicle.wheel_setups()
            vehicle.notices()
        except TreadlinkError as error:
            _explained(error)
            return False
    with _file(vehicle.to_toml().encode(), "again.toml") as path:
        assert load_vehicle(path).to_toml() == vehicle.to_toml()
    return True


def read_scenario(data: bytes) -> bool:
    """A simulator scenario; only read, not run."""
    with _file(data, "s.toml") as path:
        try:
            load_scenario(str(path))
        except TreadlinkError as error:
            _explained(error)
            return False
    return True


def _good_frames() -> list[bytes]:
    hello = Hello(
        1, 0, 1, 2, (1, 0, 0), 1, 9600.0, 4, Coupling.DC, 0.0, (0.0, 0.0, 4e3), (0, 0, 0.125), (0.0,) * 3, 32767
    )
    frames = [
        Frame(MessageType.HELLO, 0, 0, 0, 0, hello),
        Frame(MessageType.ENVIRONMENT, 0, 0, 1, 0, Environment(2e5, 30.0, 3.0)),
    ]
    for number in range(6):
        counts = np.full((36, 1), 100 * number, "<i2")
        frames.append(Frame(MessageType.SAMPLES, 0, 0, 2 + number, 3750 * number, SampleBlock(36 * number, 4, counts)))
    return [encode_frame(frame) for frame in frames]


def _good_stream() -> list[bytes]:
    frames = _good_frames()
    return [b"".join(frames), b"\xa5\x5a\x10\x02\xde" * 60 + frames[3], frames[2][:30] + frames[3] * 2]


def _session_seeds() -> list[bytes]:
    """Return the good frames in the notation of `session`."""
    seed = b""
    for frame in _good_frames():
        payload = frame[16:-4]
        seed += bytes((frame[3] - 1, 0, len(payload))) + frame[12:16] + b"\0" + payload
    return [seed]


@cache
def _good_recording() -> bytes:
    path = _folder() / "seed.mcap"
    path.unlink(missing_ok=True)
    writer = RecordingWriter(path, start_ns=_START_NS, vehicle_toml="[vehicle]\nname = 'x'\n", sources=["sim:x"])
    for number, frame in enumerate(_good_frames()):
        writer.write(Chunk("serial:x", _START_NS + number * 40_000_000, frame))
    writer.write_topic("/log", _START_NS, {"level": "info", "text": "hello"})
    writer.close()
    return path.read_bytes()


@cache
def _good_table() -> bytes:
    return ("t,z\n" + "".join(f"{i / 9600:.6f},{100 * math.cos(i / 20):.3f}\n" for i in range(400))).encode()


def _vehicle_seeds() -> list[bytes]:
    example = Path(__file__).parents[2] / "examples" / "vehicle.toml"
    return [example.read_bytes()]


def _scenario_seeds() -> list[bytes]:
    folder = Path(__file__).parents[2] / "gateway" / "simulator" / "scenarios"
    return [path.read_bytes() for path in sorted(folder.glob("*.toml"))]


def _recordings() -> list[bytes]:
    return [_good_recording(), _good_recording()[: -len(_good_recording()) // 4]]


TARGETS: dict[str, Target] = {
    "decoder": Target("both frame decoders", decode, _good_stream),
    "session": Target("pipeline and estimators behind good checksums", session, _session_seeds),
    "recording": Target("reader, replay and repair of recordings", read_recording, _recordings),
    "table": Target("import of a table", import_table, lambda: [_good_table()]),
    "map": Target("import map", import_with_map, lambda: [_MAP.encode()]),
    "vehicle": Target("vehicle configuration", read_vehicle, _vehicle_seeds),
    "scenario": Target("simulator scenario", read_scenario, _scenario_seeds),
}
