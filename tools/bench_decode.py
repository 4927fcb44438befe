"""Decoding time as a multiple of zlib.crc32 over the same bytes, measured in the same run.

Prints one table: the machine, batch and streaming decoding, damage, hostile streams, the live path, and other decoders.
Run `python tools/bench_decode.py`; it takes about a minute.
"""

import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import construct
import numpy as np

from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    HUB_ITSELF,
    Coupling,
    Environment,
    Frame,
    Hello,
    HubStatus,
    Message,
    MessageType,
    SampleBlock,
    TimeSync,
)
from firmware_protocol.reference_frames import FRAME

BLOCK_BYTES = 1 << 21
SAMPLES = 36
RATE_HZ = 9600.0
WHEELS = 4
ROUNDS = 30_000
REPETITIONS = 7


def clean_stream(rounds: int = ROUNDS) -> tuple[bytes, int]:
    """Return the bytes of a hub with four wheels, and the number of frames."""
    rng = np.random.default_rng(1)
    angle = np.arange(1024 * SAMPLES) * (2 * np.pi / 1024)
    radial = 9000 - 9000 * np.exp(-(((angle % (2 * np.pi)) - np.pi) ** 2) / 0.02)
    signal = np.stack([900 * np.sin(angle), 200 * np.cos(angle), radial], 1) + rng.normal(0, 60, (len(angle), 3))
    blocks = np.round(signal).astype("<i2").reshape(-1, SAMPLES, 3)
    hello = Hello(1, 0, 1, 2, (1, 0, 0), 1, RATE_HZ, 7, Coupling.DC, 0.0, (4e3,) * 3, (0.125,) * 3, (0.0,) * 3, 32767)
    frames: list[bytes] = []
    seqs = dict.fromkeys((*range(WHEELS), HUB_ITSELF), 0)

    def send(type_: MessageType, wheel: int, tick_us: int, message: Message) -> None:
        frames.append(encode_frame(Frame(type_, 0, wheel, seqs[wheel], tick_us & 0xFFFF_FFFF, message)))
        seqs[wheel] += 1

    second = round(RATE_HZ / SAMPLES)
    for index in range(rounds):
        tick_us = round(index * SAMPLES / RATE_HZ * 1e6)
        for wheel in range(WHEELS):
            if index % (2 * second) == 0:
                send(MessageType.HELLO, wheel, tick_us, hello)
            if index % second == 0:
                send(MessageType.ENVIRONMENT, wheel, tick_us, Environment(235e3, 31.5, 2.9))
            counts = blocks[(index + 7 * wheel) % len(blocks)]
            send(MessageType.SAMPLES, wheel, tick_us, SampleBlock(index * SAMPLES, 7, counts))
        if index % second == 0:
            send(
                MessageType.HUB_STATUS,
                HUB_ITSELF,
                tick_us,
                HubStatus(index // second, 90, 12.0, 1.0, -60, len(frames), 0, 0, 0),
            )
            send(MessageType.TIME_SYNC, HUB_ITSELF, tick_us, TimeSync(tick_us, 0))
    return b"".join(frames), len(frames)


def damaged(stream: bytes, frames: int, share: float) -> bytes:
    """Return the stream with a share of its frames touched: half change 1 to 3 bytes, half lose 1 to 100."""
    rng = np.random.default_rng(2)
    each = round(frames * share / 2)
    data = np.frombuffer(stream, np.uint8).copy()
    for position in rng.integers(0, len(data) - 3, each):
        data[position : position + rng.integers(1, 4)] ^= rng.integers(1, 256, dtype=np.uint8)
    keep = np.ones(len(data), np.bool_)
    for position in rng.integers(0, len(data) - 100, each):
        keep[position : position + rng.integers(1, 101)] = False
    return data[keep].tobytes()


def seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def crc_of(stream: bytes) -> None:
    view = memoryview(stream)
    for start in range(0, len(stream), BLOCK_BYTES):
        zlib.crc32(view[start : start + BLOCK_BYTES])


def against(
    reference: Callable[[], object], work: Callable[[], object], repetitions: int = REPETITIONS
) -> tuple[float, float]:
    """Return medians of the duration of `work` in s, and in times that of `reference` just before and after it."""
    work()
    durations, ratios = [], []
    before = seconds(reference)
    for _ in range(repetitions):
        duration = seconds(work)
        after = seconds(reference)
        durations.append(duration)
        ratios.append(2 * duration / (before + after))
        before = after
    return statistics.median(durations), statistics.median(ratios)


def batch(stream: bytes) -> Callable[[], None]:
    view = memoryview(stream)

    def work() -> None:
        decoder = BatchDecoder(BLOCK_BYTES)
        for start in range(0, len(stream), BLOCK_BYTES):
            decoder.feed(view[start : start + BLOCK_BYTES]).sample_groups()
        decoder.finish().sample_groups()

    return work


def streaming(stream: bytes, chunk_bytes: int) -> Callable[[], None]:
    chunks = [stream[start : start + chunk_bytes] for start in range(0, len(stream), chunk_bytes)]

    def work() -> None:
        feed = FrameDecoder().feed
        for chunk in chunks:
            feed(chunk)

    return work


def file_to_arrays(path: Path) -> BatchDecoder:
    decoder = BatchDecoder(BLOCK_BYTES)
    with path.open("rb", buffering=0) as file:
        while size := file.readinto(decoder.writable()):
            decoder.commit(size).sample_groups()
    decoder.finish()
    return decoder


def file_to_crc(path: Path) -> None:
    buffer = bytearray(BLOCK_BYTES)
    view = memoryview(buffer)
    with path.open("rb", buffering=0) as file:
        while size := file.readinto(buffer):
            zlib.crc32(view[:size])


def peak_mb(path: Path) -> float:
    """Return the peak memory of a process that decodes the file."""
    done = subprocess.run([sys.executable, __file__, str(path)], capture_output=True, text=True, check=True)
    return int(done.stdout) / 1024


def own_peak_kib() -> int:
    """Return this process's peak memory; ru_maxrss would count that of the process that started it."""
    status = Path("/proc/self/status")
    if status.exists():
        return int(status.read_text().split("VmHWM:")[1].split()[0])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def row(name: str, stream_bytes: int, duration_s: float, ratio: float | None, note: str = "") -> None:
    times = "" if ratio is None else f"{ratio:8.2f} x"
    print(f"{name:44s} {times:>10s} {stream_bytes / duration_s / 1e6:9.1f} MB/s  {note}", flush=True)


def bulk(stream: bytes, frames: int) -> None:
    for share in (0.0, 0.005, 0.02, 0.10):
        data = damaged(stream, frames, share)
        duration, ratio = against(lambda data=data: crc_of(data), batch(data))
        target = "target 5.5 x, aim 4.5 x" if share == 0.005 else ""
        row(f"batch, {share * 100:g} % of frames damaged", len(data), duration, ratio, target)
    data = damaged(stream, frames, 0.005)
    duration, ratio = against(lambda: crc_of(data), streaming(data, BLOCK_BYTES), 3)
    row("streaming, 2 MiB chunks, 0.5 % damaged", len(data), duration, ratio)
    with tempfile.TemporaryDirectory() as directory:
        once, four = Path(directory) / "once", Path(directory) / "four"
        once.write_bytes(data)
        with four.open("wb") as file:
            for _ in range(4):
                file.write(data)
        duration, ratio = against(lambda: file_to_crc(once), lambda: file_to_arrays(once))
        row("file to sample arrays, against read + crc32", len(data), duration, ratio, "target 6 x")
        print(f"{'':44s} peak memory {peak_mb(once):.0f} MB; of a file 4 times as long {peak_mb(four):.0f} MB")


def hostile() -> None:
    stuck = np.full((SAMPLES, 3), 0x5AA5, "<i2")
    stuck[:, 2] = 0
    held = b"".join(
        encode_frame(Frame(MessageType.SAMPLES, 0, 0, seq, seq, SampleBlock(seq, 7, stuck))) for seq in range(8000)
    )
    streams = {
        "false headers A5 5A 10 02 DE": bytes.fromhex("a55a1002de") * 200_000,
        "false headers A5 5A": b"\xa5\x5a" * 250_000,
        "frames of a channel stuck at A5 5A": held,
        "noise": np.random.default_rng(3).bytes(10_000_000),
        "zeros": bytes(10_000_000),
    }
    live_mbps = WHEELS * RATE_HZ / SAMPLES * 242 / 1e6
    for name, data in streams.items():
        for kind, work in (("batch", batch(data)), ("streaming", streaming(data, 4096))):
            duration, ratio = against(lambda data=data: crc_of(data), work, 3)
            row(
                f"{kind}, {name}",
                len(data),
                duration,
                ratio,
                f"{len(data) / duration / 1e6 / live_mbps:.0f} x live rate",
            )


def live(stream: bytes, frames: int) -> None:
    part, share = stream[: len(stream) // 4], frames / 4
    for chunk_bytes in (64, 240, 242, 4096):
        duration, _ = against(lambda: crc_of(part), streaming(part, chunk_bytes), 5)
        target = "target 2 us" if chunk_bytes == 240 else "one frame a notification" if chunk_bytes == 242 else ""
        row(
            f"live, chunks of {chunk_bytes} bytes",
            len(part),
            duration,
            None,
            f"{duration / share * 1e6:.2f} us/frame  {target}",
        )


def others(stream: bytes) -> None:
    first = encode_frame(next(frame for frame in FrameDecoder().feed(stream) if frame.type == MessageType.SAMPLES))
    count = 300
    data = first * count
    samples = construct.Struct(
        "first_sample" / construct.Int32ul,
        "axes" / construct.Int8ul,
        "n" / construct.Int8ul,
        "counts" / construct.Array(3 * SAMPLES, construct.Int16sl),
    )
    for name, frame, payload in (
        ("interpreted", FRAME, samples),
        ("compiled", FRAME.compile(), samples.compile()),
    ):

        def parse(frame: construct.Construct = frame, payload: construct.Construct = payload) -> None:
            for start in range(0, len(data), len(first)):
                payload.parse(frame.parse(data[start : start + len(first)]).body.value.payload)

        duration, ratio = against(lambda: crc_of(data), parse, 3)
        row(f"construct, {name}, framing given", len(data), duration, ratio, f"{duration / count * 1e6:.1f} us/frame")
    os.environ["MAVLINK20"] = "1"
    from pymavlink.dialects.v20 import common

    writer = common.MAVLink(None)
    opaque = list(first[16:238]) + [1] * 31
    messages = [writer.encapsulated_data_encode(seq & 0xFFFF, opaque).pack(writer) for seq in range(4000)]
    data = b"".join(messages)
    for chunk_bytes in (240, 4096):
        chunks = [data[start : start + chunk_bytes] for start in range(0, len(data), chunk_bytes)]

        def parse_mavlink(chunks: list[bytes] = chunks) -> None:
            reader = common.MAVLink(None)
            for chunk in chunks:
                reader.parse_buffer(chunk)

        duration, ratio = against(lambda: crc_of(data), parse_mavlink, 3)
        note = f"{duration / len(messages) * 1e6:.1f} us/frame of {len(messages[0])} bytes"
        row(f"pymavlink, chunks of {chunk_bytes} bytes", len(data), duration, ratio, note)


def main() -> None:
    if len(sys.argv) > 1:
        file_to_arrays(Path(sys.argv[1]))
        print(own_peak_kib())
        return
    model = (
        next(
            (
                line.split(":")[1].strip()
                for line in Path("/proc/cpuinfo").read_text().splitlines()
                if "model name" in line
            ),
            platform.processor(),
        )
        if Path("/proc/cpuinfo").exists()
        else platform.processor()
    )
    print(
        f"{model}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; Python {platform.python_version()}, ", end=""
    )
    print(f"numpy {np.__version__}, zlib {zlib.ZLIB_RUNTIME_VERSION}")
    stream, frames = clean_stream()
    print(f"{frames} frames, {len(stream) / 1e6:.1f} MB, {WHEELS} wheels, {SAMPLES} x 3 samples; x: times zlib.crc32")
    duration, _ = against(lambda: None, lambda: crc_of(stream))
    row("zlib.crc32", len(stream), duration, 1.0)
    bulk(stream, frames)
    live(stream, frames)
    hostile()
    others(stream)


if __name__ == "__main__":
    main()
