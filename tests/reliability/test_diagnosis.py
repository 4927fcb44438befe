"""What is wrong with a link is named in plain words, once, and only when it is so."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_protocol.codec import encode_raw
from firmware_protocol.messages import MessageType
from gateway.config.vehicle import parse_vehicle
from gateway.io.source import Chunk, LinkEvent, LinkEventKind
from gateway.recording.reader import RecordingReader
from gateway.recording.writer import RecordingWriter
from gateway.session.core import SessionCore
from gateway.session.line_content import describe_content
from tests.reliability.streams import chunks_of, decodes, raw_frames, readdressed, simulated, told
from tools.reliability.uart import received

START_NS = 1_700_000_000_000_000_000
LINK = "serial:/dev/ttyUSB0"
SECOND_NS = 1_000_000_000


@pytest.fixture(scope="module")
def hub():
    """20 s of two simulated wheels at low rate: chunks under a serial link's name, and the vehicle."""
    items, toml = simulated("sim:lab?speed=max&duration=20&seed=4")
    return [Chunk(LINK, chunk.host_ns, chunk.data) for chunk in chunks_of(items)], parse_vehicle(toml, "lab")


def paced(data: bytes, seconds: float = 10.0, link: str = LINK) -> list[Chunk]:
    """Cut bytes into chunks over some seconds."""
    size = max(1, len(data) // 500)
    count = -(-len(data) // size)
    return [
        Chunk(link, START_NS + round(at * seconds / count * 1e9), data[at * size : (at + 1) * size])
        for at in range(count)
    ]


def about_links(notices: list[str]) -> list[str]:
    return [text for text in notices if "configured" not in text and "simulator:" not in text]


def test_a_good_link_gives_no_cause_for_remarks(hub) -> None:
    chunks, vehicle = hub
    assert about_links(told(SessionCore(vehicle), chunks)) == []


@pytest.mark.parametrize("factor", [0.25, 0.5, 0.9, 1.12, 2.0, 4.0, 8.0])
def test_wrong_baud_rate(hub, factor: float) -> None:
    data = b"".join(chunk.data for chunk in hub[0])[:20_000]
    garbled = received(data, 921600.0, 921600.0 * factor)
    assert decodes(garbled) == 0
    (text,) = told(SessionCore(None), paced(garbled))
    assert "no frame is in them" in text
    assert "wrong baud rate" in text
    assert "?baudrate=" in text


def test_the_uart_model_is_right_at_the_right_rate(hub) -> None:
    data = b"".join(chunk.data for chunk in hub[0])[:5000]
    assert received(data, 921600.0, 921600.0)[: len(data) - 4] == data[: len(data) - 4]
    assert received(data, 921600.0, 930000.0)[: len(data) - 4] == data[: len(data) - 4]


@pytest.mark.parametrize(
    ("data", "named"),
    [
        (b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n" * 40, "GPS receiver"),
        (b"T=23.4C RH=51%\r\nT=23.5C RH=51%\r\n" * 60, "it sends text: 'T=23.5C RH=51%'"),
        (b"\x1b[31mboot\x1b[0m \x07ok\n" * 100, "no frame is in them"),
        (bytes(4000), "held at one level"),
        (b"\xb5\x62\x01\x07\x5c\x00" + bytes(range(92)), "u-blox receiver"),
    ],
)
def test_another_device_on_the_port(data: bytes, named: str) -> None:
    (text,) = told(SessionCore(None), paced(data * 20))
    assert named in text
    assert text.isprintable(), "what a stranger sends must not reach the terminal raw"


def test_frames_that_are_all_damaged_are_not_taken_for_a_wrong_rate(hub) -> None:
    frames = [bytearray(frame) for frame in raw_frames(b"".join(chunk.data for chunk in hub[0])[:80_000])]
    for frame in frames:
        frame[-1] ^= 0x55
    (text,) = told(SessionCore(None), paced(b"".join(frames)))
    assert "every one is damaged" in text


def test_a_tcp_address_gets_no_advice_on_baud_rates() -> None:
    data = np.random.default_rng(1).bytes(5000)
    text = describe_content("tcp:host:9000", data)
    assert "baud" not in text
    assert "address" in text


def test_no_verdict_on_a_few_stray_bytes(hub) -> None:
    chunks, vehicle = hub
    stray = [Chunk(LINK, chunks[0].host_ns - 3 * SECOND_NS + i, b"\x00\xff") for i in range(60)]
    assert about_links(told(SessionCore(vehicle), [*stray, *chunks])) == []


def test_firmware_with_a_newer_minor_version(hub) -> None:
    chunks, vehicle = hub
    newer = []
    for number, frame in enumerate(raw_frames(b"".join(chunk.data for chunk in chunks))):
        newer.append(frame)
        if number % 20 == 0:  # a message that this version does not know, among those it does
            newer.append(encode_raw(77, b"new", 0, 200, number // 20, 0, version=0x12))
    core = SessionCore(vehicle)
    (text,) = about_links(told(core, paced(b"".join(newer), 20.0)))
    assert "newer than protocol 1.0" in text
    assert "Update treadlink" in text
    assert core.snapshot(0.0).wheels[0].counters.revolutions > 100, "what both know is read"
    assert core.snapshot(0.0).links[0].skipped > 50


@pytest.mark.parametrize(("version", "words"), [(0x00, "firmware of the hub"), (0x20, "Update treadlink")])
def test_another_major_version(hub, version: int, words: str) -> None:
    frames = raw_frames(b"".join(chunk.data for chunk in hub[0])[:100_000])
    (text,) = told(SessionCore(None), paced(b"".join(readdressed(frame, version=version) for frame in frames)))
    assert f"protocol {version >> 4}.x" in text
    assert words in text


def test_frames_with_unknown_flags(hub) -> None:
    frames = raw_frames(b"".join(chunk.data for chunk in hub[0])[:100_000])
    data = b"".join(readdressed(frame, flags=0x80) for frame in frames)
    (text,) = told(SessionCore(None), paced(data))
    assert "flags" in text


def test_samples_without_a_hello(hub) -> None:
    chunks, vehicle = hub
    frames = [f for f in raw_frames(b"".join(c.data for c in chunks)) if f[3] != MessageType.HELLO]
    texts = about_links(told(SessionCore(vehicle), paced(b"".join(frames), 20.0)))
    assert [text for text in texts if "no hello for 5 s" in text] == texts
    assert len(texts) == 1
    assert texts[0].startswith("W1: ")


def test_a_sensor_that_falls_silent_and_comes_back(hub) -> None:
    chunks, vehicle = hub
    begin_ns = chunks[0].host_ns
    quiet = []
    for chunk in chunks:
        if begin_ns + 5 * SECOND_NS < chunk.host_ns < begin_ns + 13 * SECOND_NS:
            hub_only = b"".join(frame for frame in raw_frames(chunk.data) if frame[6] == 0xFF)
            quiet += [Chunk(LINK, chunk.host_ns, hub_only)] if hub_only else []
        else:
            quiet.append(chunk)
    texts = about_links(told(SessionCore(vehicle), quiet))
    assert len(texts) == 2
    assert "W1: its sensor has sent nothing for 5 s" in texts[0]
    after_s = float(texts[1].removeprefix("W1 sends again after ").removesuffix(" s"))
    assert after_s == pytest.approx(8.0, abs=0.6)


def test_a_link_that_is_open_but_silent() -> None:
    core = SessionCore(None)
    notices: list[str] = []
    core.on_notice = notices.append
    core.take(LinkEvent(LINK, START_NS, LinkEventKind.CONNECTED, "open"))
    for tenth in range(200):
        core.tick(START_NS + tenth * SECOND_NS // 10)
    assert [text for text in notices if "no byte has come yet" in text] == notices[1:]
    assert len(notices) == 2
    core.take(Chunk(LINK, START_NS + 21 * SECOND_NS, b"\0"))
    core.tick(START_NS + 21 * SECOND_NS)
    assert "bytes arrive again" in notices[-1]


def test_a_hub_that_restarts_and_one_that_keeps_restarting() -> None:
    items, toml = simulated("sim:lab?speed=max&duration=40&seed=4&fault=reboot:at=6,every=6,gap=1")
    texts = about_links(told(SessionCore(parse_vehicle(toml, "lab")), chunks_of(items)))
    restarts = [text for text in texts if "has restarted" in text]
    assert len(restarts) == 3
    assert sum("keeps restarting" in text for text in texts) == 1
    assert len(texts) == 4


def test_many_damaged_frames_are_told_once(hub) -> None:
    items, toml = simulated("sim:lab?speed=max&duration=20&seed=4&fault=flip:rate=0.2")
    texts = about_links(told(SessionCore(parse_vehicle(toml, "lab")), chunks_of(items)))
    assert len(texts) == 1
    assert "of the frames arrive damaged" in texts[0]


def test_findings_are_told_again_after_a_reconnection_and_kept_in_the_recording(tmp_path) -> None:
    path = tmp_path / "r.mcap"
    core = SessionCore(None, recorder=RecordingWriter(path, start_ns=START_NS))
    noise = np.random.default_rng(1).bytes(20_000)
    again = [Chunk(LINK, chunk.host_ns + 60 * SECOND_NS, chunk.data) for chunk in paced(noise)]
    restored = LinkEvent(LINK, START_NS + 59 * SECOND_NS, LinkEventKind.RESTORED, "back")
    notices = told(core, [*paced(noise), restored, *again])
    assert sum("no frame is in them" in text for text in notices) == 2
    logged = [m.data for m in RecordingReader(path).messages() if m.channel.topic == "/log"]
    assert len(logged) == 2
    assert b"wrong baud rate" in logged[0]


def test_findings_do_not_depend_on_how_bytes_are_cut(hub) -> None:
    noise = np.random.default_rng(2).bytes(30_000)
    whole = [Chunk(LINK, START_NS + i * SECOND_NS, noise[i * 3000 : (i + 1) * 3000]) for i in range(10)]
    fine = [
        Chunk(LINK, chunk.host_ns, chunk.data[at : at + 7]) for chunk in whole for at in range(0, len(chunk.data), 7)
    ]
    assert told(SessionCore(None), whole) == told(SessionCore(None), fine)
