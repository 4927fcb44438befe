"""Small good files of loggers and buses, made after the public descriptions of their formats."""

import io
import struct
from pathlib import Path
from tempfile import TemporaryDirectory

import asammdf
import can
import h5py
import nptdms
import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.writer import Writer
from scipy.io import savemat, wavfile

from gateway.core.types import FloatArray

RATE_HZ = 8000.0
NAMES = ("ax", "ay", "az")
_ROWS = 1600


def axes_g() -> FloatArray:
    """Return (n, 3) circumferential, lateral and radial acceleration of a rolling wheel in g."""
    angle = (np.arange(_ROWS) / RATE_HZ * 55.0 + np.pi) % (2.0 * np.pi) - np.pi
    inside = 0.5 * (1.0 - np.tanh((np.abs(angle) - 0.2) / 0.02))
    edge = np.exp(-(((angle - 0.25) / 0.05) ** 2)) - np.exp(-(((angle + 0.25) / 0.05) ** 2))
    noise = np.random.default_rng(3).normal(size=(_ROWS, 3))
    return np.column_stack((60.0 * edge, 10.0 * edge**2, 100.0 * (1.0 - inside))) + noise


def good_files() -> dict[str, bytes]:
    """Return a good file of each format by its name."""
    axes = axes_g()
    return {
        "run.csv": _csv(axes), "run.raw": _famos(axes), "run.vbo": _vbo(axes), "run.wav": _wav(axes),
        "run.npz": _npz(axes), "run.mcap": _imu(axes),
        "run.tdx": _tydex(axes), "run.ide": ide_file(axes), "dated.csv": _csv(axes, dated=True), **_by_packages(axes),
    }  # fmt: skip


def good_logs() -> dict[str, bytes]:
    """Return a good log of a CAN bus of each format by its name."""
    stamps = [1_700_000_000 + 0.05 * k for k in range(40)]
    lines = {
        "candump.log": [f"({stamp:.6f}) can0 204#6419FF00" for stamp in stamps],
        "console.log": [f" ({stamp:.6f})  can0  204   [4]  64 19 FF 00" for stamp in stamps],
        "savvy.csv": ["Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2"]
        + [f"{k * 50000},00000204,false,Rx,0,2,64,19," for k in range(40)],
        "vector.asc": ["date Mon Dec 6 11:21:13 am 2021", "base hex  timestamps absolute", "internal events logged"]
        + [f"   {0.05 * k:.6f} 1  204             Rx   d 4 64 19 FF 00" for k in range(40)],
    }
    return {name: ("\n".join(text) + "\n").encode() for name, text in lines.items()} | {"bus.blf": _blf(stamps)}


def _csv(axes: FloatArray, *, dated: bool = False) -> bytes:
    times = [f"2024-03-31T12:00:00.{round(row * 1e6 / RATE_HZ):06d}+02:00" for row in range(len(axes))]
    times = times if dated else [f"{row / RATE_HZ:.6f}" for row in range(len(axes))]
    rows = [",".join([time, *(f"{v:.4f}" for v in values)]) for time, values in zip(times, axes, strict=True)]
    return ("\n".join(["time_s,ax (g),ay (g),az (g)", *rows]) + "\n").encode()


def _famos(axes: FloatArray) -> bytes:
    def key(name: str, content: str) -> bytes:
        return f"|{name},1,{len(content)},{content};".encode()

    parts = [b"|CF,2,1,1;|CK,1,3,1,1;"]
    for k, name in enumerate(NAMES):
        data = axes[:, k].astype("<f4").tobytes()
        parts += [
            key("CG", "1,1,1"), key("CD", f"{1.0 / RATE_HZ!r},1,1,s,0,0,0"), key("NT", "1,5,2024,12,0,0.0"),
            key("CC", "1,1"), key("CP", "1,4,7,32,0,0,1,0"),
            key("Cb", f"1,0,1,{k + 1},0,{len(data)},0,{len(data)},1,0,0,"),
            key("CR", "0,1.0,0.0,1,1,g"), key("CN", f"0,0,0,{len(name)},{name},0,"),
            f"|CS,1,{len(data) + 2},{k + 1},".encode() + data + b";",
        ]  # fmt: skip
    return b"".join(parts)


def _vbo(axes: FloatArray) -> bytes:
    rows = [
        f"004 {120000 + row / RATE_HZ:013.6f} 035.0 " + " ".join(f"{value:.5E}" for value in values)
        for row, values in enumerate(axes)
    ]
    return "\r\n".join([
        "File created on 15/04/2024 @ 08:21", "", "[header]", "satellites", "time", "velocity kmh", *NAMES, "",
        "[channel units]", "g", "g", "g", "", "[column names]", "sats time velocity ax ay az", "", "[data]", *rows, "",
    ]).encode()  # fmt: skip


def _tydex(axes: FloatArray) -> bytes:
    lines = ["**HEADER", "**MEASURCHANNELS", f"{'RUNTIME':<40}{'s':<10}1"]
    lines += [*(f"{name:<40}{'g':<10}1" for name in NAMES), "**MEASURDATA"]
    lines += [f"{row / RATE_HZ:.6f} " + " ".join(f"{v:.4f}" for v in values) for row, values in enumerate(axes)]
    return ("\r\n".join([*lines, "**END"]) + "\r\n").encode()


def ide_file(axes: FloatArray, rate_hz: float = RATE_HZ, start_s: int = 1_714_640_070) -> bytes:
    """Return blocks of counts with their times in ticks of 1/32768 s, as enDAQ sensors do, by the schema of idelib."""
    from ebmlite import loadSchema

    schema = loadSchema("mide_ide.xml")
    count_g, middle, block, ticks_hz = 0.01, 1 << 15, 480, 32768
    counts = np.round(axes / count_g + middle).astype("<u2")
    parts = [
        {"SubChannelID": k, "SubChannelName": f"{axis} (300g)", "SubChannelLabel": "Acceleration",
         "SubChannelUnits": "g", "SubChannelSensorRef": 0}
        for k, axis in enumerate("XYZ")
    ]  # fmt: skip
    channel = {
        "ChannelID": 8, "ChannelName": "Accelerometer", "ChannelFormat": "<HHH", "TimeCodeScale": f"1/{ticks_hz}",
        "ChannelCalibrationIDRef": 1, "SubChannel": parts,
    }  # fmt: skip
    properties = {
        "RecorderInfo": {"RecorderSerial": 7},
        "SensorList": {"Sensor": [{"SensorID": 0, "SensorName": "Accelerometer"}]},
        "ChannelList": {"Channel": [channel]},
    }
    calibration = {"CalID": 1, "CalReferenceValue": float(middle), "PolynomialCoef": [count_g, 0.0]}
    elements = [
        {"EBML": {"EBMLVersion": 1, "DocType": "mide", "DocTypeVersion": 2, "DocTypeReadVersion": 2}},
        {"CalibrationList": {"UnivariatePolynomial": [calibration]}},
        {"RecordingProperties": properties},
        {"TimeBaseUTC": start_s},
    ]
    for first in range(0, len(counts), block):
        rows = counts[first : first + block]
        begin, end = (int((first + k) / rate_hz * ticks_hz) for k in (0, len(rows) - 1))
        elements.append(
            {"ChannelDataBlock": {"ChannelIDRef": 8, "StartTimeCodeAbsMod": begin, "EndTimeCodeAbsMod": end,
                                  "ChannelDataPayload": rows.tobytes()}}
        )  # fmt: skip
    return b"".join(schema.encodes(element) for element in elements)


def _wav(axes: FloatArray) -> bytes:
    file = io.BytesIO()
    wavfile.write(file, int(RATE_HZ), axes.astype(np.float32))
    return file.getvalue()


def _npz(axes: FloatArray) -> bytes:
    file = io.BytesIO()
    np.savez(file, acc=axes, fs=RATE_HZ)
    return file.getvalue()


def _imu(axes: FloatArray) -> bytes:
    file = io.BytesIO()
    writer = Writer(file)
    writer.start("ros2", "rosbag2")
    channel = writer.register_channel("/imu", "cdr", writer.register_schema("sensor_msgs/msg/Imu", "ros2msg", b""))
    for row, values in enumerate(axes):
        stamp_ns = 1_714_640_070_000_000_000 + round(row * 1e9 / RATE_HZ)
        head = struct.pack("<iII", *divmod(stamp_ns, 10**9), 4) + b"imu\0"
        body = head + struct.pack("<37d", *[0.0] * 25, *(9.80665 * values), *[0.0] * 9)
        writer.add_message(channel, stamp_ns, b"\0\1\0\0" + body, stamp_ns, row)
    writer.finish()
    return file.getvalue()


def _by_packages(axes: FloatArray) -> dict[str, bytes]:
    """Return files that packages of extras write."""
    times_s = np.arange(len(axes)) / RATE_HZ
    channels = {name: axes[:, k] for k, name in enumerate(NAMES)}
    with TemporaryDirectory() as name:
        folder = Path(name)
        clock = {"wf_increment": 1.0 / RATE_HZ, "unit_string": "g"}
        with nptdms.TdmsWriter(str(folder / "run.tdms")) as writer:
            writer.write_segment([nptdms.ChannelObject("g", n, values, clock) for n, values in channels.items()])
        book = openpyxl.Workbook(write_only=True)
        sheet = book.create_sheet("Run")
        for row in [["time_s", *(f"{n} (g)" for n in NAMES)], *np.column_stack((times_s, axes)).tolist()]:
            sheet.append(row)
        book.save(folder / "run.xlsx")
        log = asammdf.MDF()
        log.append([asammdf.Signal(values, times_s, name=n, unit="g") for n, values in channels.items()])
        log.save(folder / "run.mf4")
        log.close()
        savemat(folder / "run.mat", {"acc": axes, "fs": RATE_HZ})
        with h5py.File(folder / "run.h5", "w") as file:
            file["acc"] = axes
            file.attrs["fs"] = RATE_HZ
        pq.write_table(pa.table({"time_s": times_s, **channels}), folder / "run.parquet", write_page_checksum=True)
        return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def _blf(stamps: list[float]) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "bus.blf"
        with can.BLFWriter(str(path), compression_level=0, max_container_size=512) as log:
            for stamp in stamps:
                log(can.Message(timestamp=stamp, arbitration_id=0x204, data=[0x64, 0x19], is_extended_id=False))
        return path.read_bytes()
