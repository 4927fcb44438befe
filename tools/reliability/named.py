"""Notices of a session for each fault of a link, with the time until they are given."""

import threading
from collections.abc import Iterator, Sequence

import numpy as np

from firmware_protocol import wire
from firmware_protocol.codec import encode_raw
from firmware_protocol.framing import next_frame
from firmware_protocol.messages import MessageType
from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem, open_source
from gateway.core.reasons import Notice
from gateway.core.session.core import SessionCore
from gateway.core.session.reasons import SessionCode
from gateway.core.text.wording import notice_text
from tools.reliability.uart import received

LINK = "serial:/dev/ttyUSB0"
START_NS = 1_700_000_000_000_000_000
_NOT_FAULTS = {SessionCode.HUB_LOG, LinkCode.LINK_CONNECTED}


def raw_frames(data: bytes) -> Iterator[bytes]:
    """Yield every intact frame of bytes as bytes."""
    offset = 0
    while True:
        offset, end, _ = next_frame(data, offset)
        if not end:
            return
        yield data[offset:end]
        offset = end


def _as(frame: bytes, version: int) -> bytes:
    payload = frame[wire.HEADER_BYTES : -wire.CRC_BYTES]
    seq, tick_us = int.from_bytes(frame[8:12], "little"), int.from_bytes(frame[12:16], "little")
    return encode_raw(frame[3], payload, frame[5], frame[6], seq, tick_us, version=version)


def _paced(data: bytes, seconds: float) -> list[LinkItem]:
    size = max(1, round(len(data) / seconds / 100))
    return [
        Chunk(LINK, START_NS + (offset // size) * 10_000_000, data[offset : offset + size])
        for offset in range(0, len(data), size)
    ]


def cases() -> Iterator[tuple[str, list[LinkItem]]]:
    """Yield name and items of every fault."""

    def simulated(faults: str = "") -> list[LinkItem]:
        source = open_source(f"sim:lab?speed=max&duration=20&seed=4{faults}", ManualClock(START_NS))
        items = source.items(threading.Event())
        return [Chunk(LINK, item.host_ns, item.data) for item in items if isinstance(item, Chunk)]

    good = simulated()
    data = b"".join(item.data for item in good if isinstance(item, Chunk))
    frames = list(raw_frames(data))
    part = data[: len(data) // 4]
    yield "nothing wrong", good
    for baud in (115200, 460800, 1843200):
        yield f"read at {baud} instead of 921600 baud", _paced(received(part, 921600.0, float(baud)), 5.0)
    nmea = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n"
    yield "a GPS receiver on the port", _paced(nmea * 100, 5.0)
    yield "a thermometer on the port", _paced(b"T=23.4C RH=51%\r\n" * 300, 5.0)
    yield "a binary stranger on the port", _paced(np.random.default_rng(1).bytes(20_000), 5.0)
    yield "line held low", _paced(bytes(5000), 5.0)
    yield "older protocol (0.x)", _paced(b"".join(_as(frame, 0x01) for frame in frames), 20.0)
    yield "newer protocol (2.x)", _paced(b"".join(_as(frame, 0x20) for frame in frames), 20.0)
    newer = [encode_raw(77, b"new", 0, 200, number, 0, version=0x12) for number in range(len(frames))]
    both = b"".join(a + b for a, b in zip(frames, newer, strict=True))
    yield "newer minor version (1.2)", _paced(both, 20.0)
    yield "no hello", _paced(b"".join(frame for frame in frames if frame[3] != MessageType.HELLO), 20.0)
    # The sensor falls silent after 5 s; the hub continues.
    silent = [frame for number, frame in enumerate(frames) if frame[6] == 0xFF or number < len(frames) / 4]
    early = sum(number < len(frames) / 4 for number in range(len(frames)))
    yield (
        "sensor gone after 5 s",
        [
            *_paced(b"".join(silent[:early]), 5.0),
            *(
                Chunk(item.link, item.host_ns + 5_000_000_000, item.data)
                for item in _paced(b"".join(silent[early:]), 15.0)
                if isinstance(item, Chunk)
            ),
        ],
    )
    yield "hub restarts after 6 s", simulated("&fault=reboot:at=6,gap=1")
    yield "a fifth of the frames damaged", simulated("&fault=flip:rate=0.2")
    yield "open but silent", [LinkEvent(LINK, START_NS, LinkEventKind.CONNECTED)]


def notices_of(items: Sequence[LinkItem], toml: str) -> list[tuple[float, str]]:
    """Return the notices of a session as text, with the time of the items, s since the first."""
    results: list[tuple[float, Notice]] = []
    core = SessionCore(parse_vehicle(toml, "lab"))
    core.take_notices()
    begin_ns, last_s = items[0].host_ns, 0.0
    for item in items:
        core.take(item)
        last_s = (item.host_ns - begin_ns) * 1e-9
        results += [(last_s, notice) for notice in core.take_notices()]
    if len(items) == 1:
        for tenth in range(100):
            core.tick(begin_ns + tenth * 100_000_000)
            last_s = tenth / 10
            results += [(last_s, notice) for notice in core.take_notices()]
    core.finish()
    results += [(last_s, notice) for notice in core.take_notices()]
    shown = [(at_s, notice) for at_s, notice in results if notice.reason.code not in _NOT_FAULTS]
    return [(at_s, notice_text(notice)) for at_s, notice in shown]


def report() -> Iterator[str]:
    """Yield one or more lines for each fault."""
    toml = open_source("sim:lab?speed=max", ManualClock()).vehicle_toml or ""
    for name, items in cases():
        findings = notices_of(items, toml)
        yield f"{name}:" + ("" if findings else " no notice")
        for at_s, text in findings:
            yield f"    after {at_s:4.1f} s: {text}"
