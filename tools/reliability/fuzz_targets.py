"""Fuzz targets: each takes any bytes and raises only on a defect of the program.

`tools/fuzz_files.py` runs them on seeded changes of good inputs, `tools/fuzz_atheris.py` with coverage guidance.
"""

import atexit
import contextlib
import io
import math
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache, partial
from importlib.resources import files
from pathlib import Path

import numpy as np
from scipy.io import savemat
from scipy.sparse import coo_array

from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.codec import encode_frame, encode_raw
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Coupling, Environment, Frame, Hello, MessageType, SampleBlock
from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import VehicleConfig, load_vehicle, parse_vehicle, recorded_vehicle
from gateway.core.errors import TreadlinkError
from gateway.core.estimates.wheel_setup import CorrectedEffect, CorrectionTable, EffectParameter
from gateway.core.links.source import Chunk, LinkEvent, open_source
from gateway.core.recording.inspection import inspect_recording
from gateway.core.recording.manifest import MANIFEST_NAME, absent_recordings
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.run_description import read_notes
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.corrections import check_effects, effects_notices, with_effects
from gateway.core.text import wording
from gateway.core.types import FloatArray
from gateway.diagnosis.effects_file import effects_text
from gateway.diagnosis.effects_opening import open_effects_file
from gateway.fleet.history_reading import read_odometer
from gateway.forces.known_runs import SlipRunsFile, load_runs
from gateway.importing.commands.import_measurement import report_lines
from gateway.importing.import_map import ImportMap, load_map, parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from gateway.importing.reader_process import ReaderProcesses
from gateway.planner.accelerometer import SHIPPED, parse_accelerometers
from gateway.security.cmac import Key
from gateway.security.freshness import Ledger
from gateway.security.key_file import KeyFile, hub_identity, sensor_identity
from gateway.simulator.scenario import load_scenario
from gateway.upkeep.compact import compact_recording
from gateway.upkeep.repair import repair_recording
from gateway.vehicle.tire_sensors import open_tire_sensors
from tools.reliability.logger_files import good_files, good_logs
from tools.reliability.mutations import Change, frame_content, mat_content, mdf_content, recording_content

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


_TIRE_SENSORS = parse_vehicle(
    '[vehicle]\nname = "v"\n[tire]\nradius_mm = 320\n[[wheel]]\nposition = "FL"\nhub = 0\nwheel = 0\n'
    '[[tpms.sensor]]\nwheel = "FL"\nid = "0ceb28a2"\n',
    "fuzzed",
)
_TPMS_LINES = b"".join(
    b'{"time" : "2022-06-22 12:5%d:16", "model" : "PMV-107J", "type" : "TPMS", "id" : "0ceb28a2", "status" : 16, '
    b'"pressure_kPa" : 205.840, "temperature_C" : 19.000, "mic" : "CRC"}\n' % minute
    for minute in range(8)
)


@dataclass(frozen=True, slots=True)
class Target:
    """Target of fuzzing.

    Attributes:
        text: what it is.
        run: takes the bytes; returns whether they were accepted, False when the user got an error with words.
        seeds: makes good inputs to start from.
        inner: change of what is behind checksums or compression, None when there is nothing.
    """

    text: str
    run: Callable[[bytes], bool]
    seeds: Callable[[], list[bytes]]
    inner: Change | None = None


class UnclearError(AssertionError):
    """An error that the user would not understand."""


def _explained(error: TreadlinkError) -> None:
    """Raise UnclearError for a message that is empty, has control characters, or hides an error of our own."""
    if "crashed (exit code" in str(error):
        raise UnclearError(str(error)) from error
    text = f"{error} {error.remedy}"
    if not str(error).strip() or any(ord(character) < 32 and character not in "\n\t" for character in text):
        raise UnclearError(repr(text)) from error


@cache
def _folder() -> Path:
    memory = Path("/dev/shm")
    folder = tempfile.TemporaryDirectory(prefix="fuzz", dir=memory if memory.is_dir() else None)
    atexit.register(folder.cleanup)
    return Path(folder.name)


@contextlib.contextmanager
def _file(data: bytes, name: str):
    path = _folder() / name
    path.write_bytes(data)
    yield path


@contextlib.contextmanager
def _private(data: bytes, name: str):
    with _file(data, name) as path:
        path.chmod(0o600)
        try:
            yield path
        finally:
            path.unlink(missing_ok=True)


def decode(data: bytes) -> bool:
    """Both decoders with arbitrary chunks: the same frames, the same counters, every byte accounted for."""
    whole, cut, batch = FrameDecoder(), FrameDecoder(), BatchDecoder()
    expected = [*whole.feed(data), *whole.finish()]
    step = 1 + (data[0] if data else 0)
    results: list[Frame] = []
    for offset in range(0, len(data), step):
        results += cut.feed(data[offset : offset + step])
        assert cut.pending_bytes < 244
    results += cut.finish()
    keys = [frame[:5] for frame in expected]
    assert [frame[:5] for frame in results] == keys
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
    offset = 0
    while offset + 8 <= len(data):
        kind, wheel, size = 1 + data[offset] % 8, data[offset + 1] % 3, min(data[offset + 2], 224)
        tick_us = int.from_bytes(data[offset + 3 : offset + 7], "little")
        payload = data[offset + 8 : offset + 8 + size]
        frames.append(encode_raw(kind, payload, 0, wheel, data[offset + 7] * 16 + len(frames), tick_us))
        offset += 8 + size
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
    """Reader, inspection, replay and repair of a file that calls itself a recording, and the vehicle in it."""
    accepted = False
    with _file(data, "r.mcap") as path:
        try:
            reader = RecordingReader(path)
            taken = sum(len(item.data) for item in reader.items() if isinstance(item, Chunk))
            # Plain chunks cannot hold more than the file; the content of compressed ones is limited.
            assert taken <= max(len(data), 64 << 20)
            if reader.damage is not None:
                assert wording.text(reader.damage)
            accepted = taken > 0
            inspect_recording(path)
            source = open_source(f"replay:{path}?speed=max", ManualClock())
            core = SessionCore(None)
            core.tick(_START_NS)
            for item in source.items(threading.Event()):
                core.take(item)
            core.finish()
            if source.vehicle_toml is not None:
                recorded_vehicle(source.vehicle_toml, str(path))
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


def read_dump(data: bytes) -> bool:
    """A raw dump, replayed through a whole session."""
    with _file(data, "r.bin") as path:
        try:
            source = open_source(f"replay:{path}?speed=max", ManualClock())
            core = SessionCore(None)
            core.tick(_START_NS)
            for item in source.items(threading.Event()):
                core.take(item)
            core.tick(_START_NS + 1_000_000_000)
            core.finish()
            core.snapshot(1.0)
        except TreadlinkError as error:
            _explained(error)
            return False
    return True


def read_recorded_vehicle(data: bytes) -> bool:
    """A vehicle configuration inside a recording."""
    try:
        recorded_vehicle(data.decode("utf-8", "replace"), "r.mcap").wheel_setups()
    except TreadlinkError as error:
        _explained(error)
        return False
    return True


def read_effects(data: bytes) -> bool:
    """An effects file, checked against the vehicle it belongs to."""
    with _file(data, "w.effects.json") as path:
        try:
            table = open_effects_file(path)
            check_effects([table], _effects_vehicle())
            with_effects(_effects_vehicle().wheel_setups(), [table])
            for notice in effects_notices([table], _effects_vehicle()):
                wording.text(notice.reason)
        except TreadlinkError as error:
            _explained(error)
            return False
    return True


def read_keys(data: bytes) -> bool:
    """A key file; an accepted one must read back equal."""
    with _private(data, "keys") as path:
        try:
            keys = KeyFile(path)
            before = {identity: key.secret for identity, key in keys.keys.items()}
            keys.save()
            assert {identity: key.secret for identity, key in KeyFile(path).keys.items()} == before
        except TreadlinkError as error:
            _explained(error)
            return False
    return True


def read_counters(data: bytes) -> bool:
    """The file of the sensors' counters."""
    with _private(data, "counters.json") as path:
        try:
            ledger = Ledger(path)
            ledger.counter(sensor_identity(0xA001), "c0ffee").take(1 << 40)
            ledger.save()
            Ledger(path)
        except TreadlinkError as error:
            _explained(error)
            return False
    return True


def _imports(suffix: str) -> Callable[[bytes], bool]:
    """Return the import of a file with a good map; a MATLAB file may be one of HDF5."""
    return lambda data: _imported(data, "t.mat" if data.startswith(b"MATLAB") else f"t.{suffix}", _MAP)


def import_logger_file(data: bytes) -> bool:
    """A file of a logger, which is recognised by its first bytes, guessed and imported by its first map."""
    with _file(data, "t.dat") as path:
        out = _folder() / "imported.mcap"
        try:
            import_file(path, parse_map(guess_map(path, processes=_PROCESSES), "t.map.toml"), out, processes=_PROCESSES)
        except TreadlinkError as error:
            _explained(error)
            return False
        finally:
            out.unlink(missing_ok=True)
    return True


def read_bus_log(data: bytes) -> bool:
    """A log of a CAN bus, as each format that it may be."""
    suffixes = ("blf",) if data.startswith(b"LOGG") else ("log", "asc", "csv")
    read = [_bus_log(data, suffix) for suffix in suffixes]
    return any(read)


def read_tire_sensor_log(data: bytes) -> bool:
    """A log of rtl_433, with its readings."""
    with _file(data, "t.json") as path:
        try:
            decoder = open_tire_sensors(_TIRE_SENSORS)
            for item in open_source(f"rtl433:{path}?speed=max&time_zone=UTC", ManualClock()).items(threading.Event()):
                if not isinstance(item, LinkEvent):
                    assert all(math.isfinite(reading.pressure_std_pa) for _, reading in decoder.take(item))
        except TreadlinkError as error:
            _explained(error)
            return False
    return True


def _bus_log(data: bytes, suffix: str) -> bool:
    with _file(data, f"t.{suffix}") as path:
        try:
            for item in open_source(f"can:{path}?speed=max", ManualClock()).items(threading.Event()):
                assert item.host_ns >= 0
        except TreadlinkError as error:
            _explained(error)
            return False
    return True


def import_table(data: bytes) -> bool:
    """A table that is to be imported with a good map: by its rate, and by its time column."""
    by_time = _MAP.replace("rate_hz = 9600.0", 'time_column = "t"')
    return any([_imported(data, "t.csv", _MAP), _imported(data, "t.csv", by_time)])


# One process reads all the files of a kind: starting one costs more than reading a file.
_PROCESSES = ReaderProcesses(keep=True)
_crashes = 0


def parser_crashes() -> int:
    """Return how often a parser's process was ended by a signal, which is a message for the user."""
    return _crashes


@cache
def _map(text: str) -> ImportMap:
    return parse_map(text, "good.map.toml")


def _imported(data: bytes, name: str, map_text: str) -> bool:
    global _crashes
    with _file(data, name) as path:
        out = _folder() / "imported.mcap"
        try:
            report = import_file(path, _map(map_text), out, processes=_PROCESSES)
            assert report_lines(report)
            assert any(isinstance(item, Chunk) for item in RecordingReader(out).items())
        except TreadlinkError as error:
            _explained(error)
            _crashes += "files crashed (SIG" in str(error)
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


def reads(name: str, read: Callable[[Path], object]) -> Callable[[bytes], bool]:
    """Return a target that only reads a file of this name."""

    def run(data: bytes) -> bool:
        with _file(data, name) as path:
            try:
                read(path)
            except TreadlinkError as error:
                _explained(error)
                return False
        return True

    return run


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
    path, packed = _folder() / "plain.mcap", _folder() / "packed.mcap"
    path.write_bytes(_good_recording())
    packed.unlink(missing_ok=True)
    compact_recording(path, packed)
    return [_good_recording(), packed.read_bytes(), _good_recording()[: -len(_good_recording()) // 4]]


def _dumps() -> list[bytes]:
    return [b"".join(_good_frames()), b"noise" + b"".join(_good_frames()[1:])]


def _columns() -> dict[str, FloatArray]:
    rows = np.arange(400)
    return {"t": rows / 9600.0, "z": 100.0 * np.cos(rows / 20.0)}


def _mats() -> list[bytes]:
    columns = _columns()
    matrix = np.column_stack(list(columns.values()))
    contents: list[tuple[dict[str, object], dict[str, object]]] = [
        (dict(columns), {}),
        (dict(columns), {"do_compression": True}),
        (dict(columns), {"format": "4"}),
        ({"run": {**columns, "note": "text", "deep": {"er": [1, 2]}}, "z": columns["z"].astype("f4")}, {}),
        ({"data": matrix, "z": (columns["z"] * 100).astype("i2"), "cell": np.array(["a", 1], object)}, {}),
        ({"z": columns["z"], "sparse": coo_array(np.eye(5)), "complex": np.ones(3) * 1j}, {"do_compression": True}),
    ]
    results = []
    for content, options in contents:
        file = io.BytesIO()
        savemat(file, content, **options)
        data = file.getvalue()
        # The header of version 5 states the time of writing.
        results.append(data if options.get("format") == "4" else b"MATLAB 5.0 MAT-file".ljust(116) + data[116:])
    return results


def _parquets() -> list[bytes]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({**_columns(), "text": ["a"] * 400, "n": pa.array([1, None] * 200)})
    results = []
    for compression in ("none", "snappy", "zstd", "gzip"):
        file = io.BytesIO()
        pq.write_table(table, file, compression=compression, row_group_size=150)
        results.append(file.getvalue())
    return results


def _hdf5s() -> list[bytes]:
    import h5py

    columns = _columns()
    results = []
    for name, options in (("plain", {}), ("packed", {}), ("latest", {"libver": "latest"}), ("matlab", {})):
        file = io.BytesIO()
        matlab = {"userblock_size": 512} if name == "matlab" else {}
        with h5py.File(file, "w", **options, **matlab) as content:
            packed = {"compression": "gzip", "shuffle": True, "chunks": (150,)} if name == "packed" else {}
            for column, values in columns.items():
                content.create_dataset(column, data=values[None, :] if matlab else values, **packed)
            # A group's header would state the time of writing.
            timeless = h5py.h5p.create(h5py.h5p.GROUP_CREATE)
            timeless.set_obj_track_times(False)
            h5py.h5g.create(content.id, b"run", gcpl=timeless)
            content["run/acc"] = np.column_stack(list(columns.values()))
            content["run"].attrs["note"] = "text"
            content["z"].attrs["units"] = "g"
            content["table"] = np.array([(1, 2.0)] * 20, dtype=[("a", "i4"), ("b", "f8")])
            content["far"] = h5py.ExternalLink("none.h5", "/a")
            content["again"] = h5py.SoftLink("/run")
            if matlab:
                content["run"].attrs["MATLAB_class"] = np.bytes_("struct")
                content["z"].attrs["MATLAB_class"] = np.bytes_("double")
                content["#refs#/a"] = columns["z"]
                cell = content.create_dataset("cell", (1, 2), dtype=h5py.ref_dtype)
                cell[0, 0], cell[0, 1] = content["#refs#/a"].ref, content["z"].ref
                cell.attrs["MATLAB_class"] = np.bytes_("cell")
        data = file.getvalue()
        results.append(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + data[128:] if matlab else data)
    return results


def _mdfs() -> list[bytes]:
    from asammdf import MDF, Signal

    columns = _columns()
    results = []
    for version, compression in (("4.10", 0), ("4.10", 2), ("4.11", 1), ("3.30", 0)):
        with MDF(version=version) as mdf:
            mdf.header.start_time = datetime(2024, 5, 1, tzinfo=UTC)
            times_s = columns["t"]
            counts = (100 * columns["z"]).astype("<i2")
            scaled = {"a": 0.01, "b": 0.0}
            mdf.append(
                [
                    Signal(columns["z"], times_s, name="z", unit="g"),
                    Signal(counts, times_s, name="x", unit="g", conversion=scaled),
                ]
            )
            mdf.append(
                [
                    Signal(np.arange(5.0), np.arange(5.0) / 100, name="speed", unit="km/h"),
                    Signal(np.array([b"one"] * 5), np.arange(5.0) / 100, name="text", encoding="utf-8"),
                ]
            )
            path = _folder() / f"seed{'.mf4' if version[0] == '4' else '.mdf'}"
            mdf.save(path, overwrite=True, compression=compression)
        data = bytearray(path.read_bytes())
        offset = data.find(b"##FH")
        while offset >= 0:
            # The history states the time of writing.
            data[offset + 40 : offset + 48] = bytes(8)
            offset = data.find(b"##FH", offset + 4)
        offset = data.find(b": updated by")
        if offset >= 24:
            data[offset - 24 : offset] = b"Wed May  1 00:00:00 2024"
        results.append(bytes(data))
    return results


@cache
def _effects_vehicle() -> VehicleConfig:
    return parse_vehicle(
        '[tire]\nradius_mm = 320\n[[wheel]]\nposition = "FL"\nhub = 0\nwheel = 0\nsensor_id = "a001"\n'
        "[wheel.mounting]\noffset_mm = 3.0\n",
        "v.toml",
    )


def _effects() -> list[bytes]:
    table = CorrectionTable(
        position="FL",
        omega_radps=np.array([40.0, 60.0]),
        orders_mps2=np.ones((2, 3, 4)) * (1.0 + 0.5j),
        effects=(CorrectedEffect("mounting offset", (EffectParameter("offset_m", 0.004, 1e-6, "m"),)),),
        radius_m=0.32,
        omega_range_radps=(40.0, 60.0),
        load_range_n=(3000.0, 4000.0),
        pressure_range_pa=(2e5, 2.2e5),
        sensor_offset_m=0.003,
        sensor_id=0xA001,
        sources=("a.mcap",),
    )
    return [effects_text(table).encode()]


def _keys() -> list[bytes]:
    path = _folder() / "seed.keys"
    path.unlink(missing_ok=True)
    keys = KeyFile(path)
    keys.add({sensor_identity(0xA001): Key(bytes(range(16))), hub_identity(7): Key(bytes(16))})
    keys.save()
    return [path.read_bytes()]


def _counters() -> list[bytes]:
    path = _folder() / "seed.json"
    path.unlink(missing_ok=True)
    ledger = Ledger(path)
    for number in range(3):
        ledger.counter(sensor_identity(number), "c0ffee").take(number << 32)
    ledger.save()
    return [path.read_bytes()]


_SLIP_RUNS = b"""slip_std_deg = 0.1
[[run]]
recording = "a.mcap"
slip_deg = -1.0
from_s = 1
to_s = 9.5
[[run]]
recording = "b.mcap"
slip_deg = 2
direction = "reverse"
"""
_ODOMETER = (
    b"vehicle,utc,km\ntruck 7,2026-01-31T12:00:00Z,20450.5\ntruck 7,2026-03-01,21000\nvan,2026-02-01T01:00+02:00,1\n"
)
_NOTES = b"""{"utc": "2026-01-31T12:00:00Z", "comment": "first", "tags": ["wet"]}
{"utc": "2026-01-31T12:00:01Z", "comment": "second", "tags": []}
"""


def _accelerometers() -> list[bytes]:
    parts = (files("gateway.planner") / SHIPPED).read_bytes().split(b"[[sensor]]")
    return [b"[[sensor]]".join(parts[:3])]


TARGETS: dict[str, Target] = {
    "decoder": Target("both frame decoders", decode, _good_stream, frame_content),
    "session": Target("pipeline and estimators behind good checksums", session, _session_seeds),
    "recording": Target(
        "reader, inspection, replay, repair of recordings", read_recording, _recordings, recording_content
    ),
    "dump": Target("raw dump through a session", read_dump, _dumps, frame_content),
    "table": Target("import of a CSV table", import_table, lambda: [_good_table()]),
    "mat": Target("import of a MATLAB file", _imports("mat"), _mats, mat_content),
    "hdf5": Target("import of an HDF5 or MATLAB 7.3 file", _imports("h5"), _hdf5s),
    "mf4": Target("import of an MDF file", _imports("mf4"), _mdfs, mdf_content),
    "parquet": Target("import of a Parquet file", _imports("parquet"), _parquets),
    "logger": Target("file of a logger, guessed and imported", import_logger_file, lambda: [*good_files().values()]),
    "bus-log": Target("log of a CAN bus", read_bus_log, lambda: [*good_logs().values()]),
    "rtl433": Target("lines of rtl_433", read_tire_sensor_log, lambda: [_TPMS_LINES]),
    "map": Target("import map", import_with_map, lambda: [_MAP.encode()]),
    "vehicle": Target("vehicle configuration", read_vehicle, _vehicle_seeds),
    "recorded-vehicle": Target("vehicle configuration inside a recording", read_recorded_vehicle, _vehicle_seeds),
    "scenario": Target("simulator scenario", reads("s.toml", lambda path: load_scenario(str(path))), _scenario_seeds),
    "runs": Target("runs of a calibration", reads("runs.toml", partial(load_runs, SlipRunsFile)), lambda: [_SLIP_RUNS]),
    "accelerometers": Target(
        "list of accelerometers",
        reads("parts.toml", lambda path: parse_accelerometers(path.read_text("utf-8", "replace"), path.name)),
        _accelerometers,
    ),
    "odometer": Target("readings of an odometer", reads("km.csv", read_odometer), lambda: [_ODOMETER]),
    "notes": Target(
        "notes beside a recording",
        reads("r.mcap.notes.jsonl", lambda path: read_notes(path.parent / "r.mcap")),
        lambda: [_NOTES],
    ),
    "manifest": Target(
        "hashes of recordings",
        reads(MANIFEST_NAME, lambda path: absent_recordings(path.parent)),
        lambda: [b"0" * 64 + b"  a.mcap\n" + b"f" * 64 + b"  b.mcap\n"],
    ),
    "effects": Target("effects file", read_effects, _effects),
    "keys": Target("key file", read_keys, _keys),
    "counters": Target("file of the sensors' counters", read_counters, _counters),
}
