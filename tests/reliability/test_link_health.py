"""Faults of a link are reported by their code, once, and only while they hold."""

import json

import numpy as np
import pytest

from firmware_protocol.codec import encode_raw
from firmware_protocol.messages import MessageType
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind
from gateway.core.reasons import Code, CoreCode, Notice, Reason
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.line_content import identify_content
from gateway.core.session.reasons import SessionCode
from gateway.core.text.wording import notice_text
from tests.reliability.streams import chunks_of, decodes, notices_of, readdressed, simulated
from tools.reliability.named import raw_frames
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
        Chunk(link, START_NS + round(index * seconds / count * 1e9), data[index * size : (index + 1) * size])
        for index in range(count)
    ]


NOT_OF_LINKS = {
    SessionCode.WHEEL_NOT_CONFIGURED,
    SessionCode.HUB_LOG,
    # Contradictions within the frames of a wheel, at the end.
    CoreCode.SAMPLES_WITHOUT_HELLO,
}


def of_links(core: SessionCore, items) -> list[Notice]:
    """Run items through a session; return its notices of links and hubs."""
    return [notice for notice in notices_of(core, items) if notice.reason.code not in NOT_OF_LINKS]


def codes(notices: list[Notice]) -> list[Code]:
    return [notice.reason.code for notice in notices]


def content_of(notice: Notice) -> Reason:
    """Return the identified content of a line without frames."""
    assert notice.reason.code is SessionCode.NO_FRAMES
    assert "(0 before)" not in notice_text(notice)
    content = notice.reason["content"]
    assert isinstance(content, Reason)
    return content


def test_good_link_gives_no_notice(hub) -> None:
    chunks, vehicle = hub
    assert of_links(SessionCore(vehicle), chunks) == []


@pytest.mark.parametrize("factor", [0.25, 0.5, 0.9, 1.12, 2.0, 4.0, 8.0])
def test_wrong_baud_rate(hub, factor: float) -> None:
    data = b"".join(chunk.data for chunk in hub[0])[:20_000]
    garbled = received(data, 921600.0, 921600.0 * factor)
    assert decodes(garbled) == 0
    (notice,) = of_links(SessionCore(None), paced(garbled))
    assert content_of(notice) == Reason(SessionCode.LINE_WRONG_BAUD_RATE, default_baud=921600)
    assert "?baudrate=" in notice_text(notice)


def test_uart_model_at_the_right_rate(hub) -> None:
    data = b"".join(chunk.data for chunk in hub[0])[:5000]
    assert received(data, 921600.0, 921600.0)[: len(data) - 4] == data[: len(data) - 4]
    assert received(data, 921600.0, 930000.0)[: len(data) - 4] == data[: len(data) - 4]


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n" * 40, SessionCode.LINE_NOT_A_HUB),
        (b"T=23.4C RH=51%\r\nT=23.5C RH=51%\r\n" * 60, SessionCode.LINE_TEXT),
        (b"\x1b[31mboot\x1b[0m \x07ok\n" * 100, None),
        (bytes(4000), SessionCode.LINE_CONSTANT),
        (b"\xb5\x62\x01\x07\x5c\x00" + bytes(range(92)), SessionCode.LINE_NOT_A_HUB),
    ],
)
def test_other_device_on_the_port(data: bytes, code: Code | None) -> None:
    (notice,) = of_links(SessionCore(None), paced(data * 20))
    content = content_of(notice)
    assert code in (None, content.code)
    if content.code is SessionCode.LINE_TEXT:
        assert content["line"] in ("T=23.5C RH=51%", "[31mboot[0m ok")
    assert notice_text(notice).isprintable(), "bytes of an unknown device must not reach the terminal raw"


def test_damaged_frames_are_not_a_wrong_rate(hub) -> None:
    frames = [bytearray(frame) for frame in raw_frames(b"".join(chunk.data for chunk in hub[0])[:80_000])]
    for frame in frames:
        frame[-1] ^= 0x55
    (notice,) = of_links(SessionCore(None), paced(b"".join(frames)))
    assert content_of(notice).code is SessionCode.LINE_ALL_FRAMES_DAMAGED


def test_link_that_loses_its_frames_says_how_many_there_were(hub) -> None:
    chunks, vehicle = hub
    noise = paced(np.random.default_rng(3).bytes(30_000))
    later = [Chunk(LINK, chunk.host_ns + 21 * SECOND_NS, chunk.data) for chunk in noise]
    notices = of_links(SessionCore(vehicle), [*chunks, *later])
    (lost,) = [notice for notice in notices if notice.reason.code is SessionCode.NO_FRAMES_ANY_MORE]
    assert lost.reason["frames"] > 1000


def test_tcp_link_gets_no_baud_rate_advice() -> None:
    content = identify_content("tcp:host:9000", np.random.default_rng(1).bytes(5000))
    assert content == Reason(
        SessionCode.LINE_NOT_A_HUB, device="unknown", remedy=Reason(SessionCode.CHECK_SOURCE_ADDRESS)
    )


def test_swapped_sync_is_named(hub) -> None:
    chunks, vehicle = hub
    data = b"".join(chunk.data for chunk in chunks[:200]).replace(b"\xa5\x5a\x10", b"\x5a\xa5\x10")
    notices = of_links(SessionCore(vehicle), paced(data))
    (notice,) = [notice for notice in notices if notice.reason.code is SessionCode.NO_FRAMES]
    assert notice.reason["content"] == Reason(SessionCode.LINE_SYNC_SWAPPED)


def test_stray_bytes_give_no_notice(hub) -> None:
    chunks, vehicle = hub
    stray = [Chunk(LINK, chunks[0].host_ns - 3 * SECOND_NS + i, b"\x00\xff") for i in range(60)]
    assert of_links(SessionCore(vehicle), [*stray, *chunks]) == []


def test_firmware_with_newer_minor_version(hub) -> None:
    chunks, vehicle = hub
    newer = []
    for number, frame in enumerate(raw_frames(b"".join(chunk.data for chunk in chunks))):
        newer.append(frame)
        if number % 20 == 0:  # a message unknown to this version, among known ones
            newer.append(encode_raw(77, b"new", 0, 200, number // 20, 0, version=0x12))
    core = SessionCore(vehicle)
    (notice,) = of_links(core, paced(b"".join(newer), 20.0))
    assert notice.reason == Reason(SessionCode.PROTOCOL_DIFFERS, how="newer_layout", own="1.1")
    assert core.snapshot(0.0).wheels[0].counters.revolutions > 100, "known frames are read"
    assert core.snapshot(0.0).links[0].skipped > 50


@pytest.mark.parametrize(("version", "older"), [(0x00, "firmware"), (0x20, "treadlink")])
def test_other_major_version(hub, version: int, older: str) -> None:
    frames = raw_frames(b"".join(chunk.data for chunk in hub[0])[:100_000])
    data = b"".join(readdressed(frame, version=version) for frame in frames)
    (notice,) = of_links(SessionCore(None), paced(data))
    assert notice.reason == Reason(SessionCode.FIRMWARE_UNREADABLE, major=version >> 4, own=1, older=older)


def test_frames_with_unknown_flags(hub) -> None:
    frames = raw_frames(b"".join(chunk.data for chunk in hub[0])[:100_000])
    data = b"".join(readdressed(frame, flags=0x80) for frame in frames)
    assert codes(of_links(SessionCore(None), paced(data))) == [SessionCode.FRAMES_WITH_UNKNOWN_FLAGS]


def test_samples_without_a_hello(hub) -> None:
    chunks, vehicle = hub
    frames = [f for f in raw_frames(b"".join(c.data for c in chunks)) if f[3] != MessageType.HELLO]
    (notice,) = of_links(SessionCore(vehicle), paced(b"".join(frames), 20.0))
    assert (notice.subject, notice.reason.code) == ("W1", SessionCode.NO_HELLO)


def test_open_but_silent_link() -> None:
    core = SessionCore(None)
    core.take(LinkEvent(LINK, START_NS, LinkEventKind.CONNECTED))
    for tenth in range(200):
        core.tick(START_NS + tenth * SECOND_NS // 10)
    assert codes(core.take_notices()) == [LinkCode.LINK_CONNECTED, SessionCode.LINK_NO_DATA_YET]
    core.take(Chunk(LINK, START_NS + 21 * SECOND_NS, b"\0"))
    core.tick(START_NS + 21 * SECOND_NS)
    assert codes(core.take_notices()) == [SessionCode.LINK_RESUMED]


def test_repeated_hub_restarts_are_summarised() -> None:
    items, toml = simulated("sim:lab?speed=max&duration=40&seed=4&fault=reboot:at=6,every=6,gap=1")
    result = codes(of_links(SessionCore(parse_vehicle(toml, "lab")), chunks_of(items)))
    assert result == 3 * [SessionCode.HUB_RESTARTED] + [SessionCode.HUB_RESTARTS_REPEATEDLY]


def test_many_damaged_frames_are_reported_once() -> None:
    items, toml = simulated("sim:lab?speed=max&duration=20&seed=4&fault=flip:rate=0.2")
    result = of_links(SessionCore(parse_vehicle(toml, "lab")), chunks_of(items))
    assert codes(result) == [SessionCode.FRAMES_DAMAGED]


def test_findings_are_repeated_after_reconnection_and_recorded(tmp_path) -> None:
    path = tmp_path / "r.mcap"
    core = SessionCore(None, recorder=RecordingWriter(path, start_ns=START_NS))
    noise = np.random.default_rng(1).bytes(20_000)
    again = [Chunk(LINK, chunk.host_ns + 60 * SECOND_NS, chunk.data) for chunk in paced(noise)]
    restored = LinkEvent(LINK, START_NS + 59 * SECOND_NS, LinkEventKind.RESTORED)
    notices = notices_of(core, [*paced(noise), restored, *again])
    assert codes(notices) == [SessionCode.NO_FRAMES, LinkCode.LINK_RESTORED, SessionCode.NO_FRAMES]
    logged = [json.loads(m.data) for m in RecordingReader(path).messages() if m.channel.topic == "/log"]
    assert [entry["code"] for entry in logged] == ["no_frames", "no_frames"]
    assert logged[0]["values"]["content"]["code"] == "line_wrong_baud_rate"
    assert "wrong baud rate" in logged[0]["text"]


def test_findings_are_independent_of_chunk_boundaries() -> None:
    noise = np.random.default_rng(2).bytes(30_000)
    whole = [Chunk(LINK, START_NS + i * SECOND_NS, noise[i * 3000 : (i + 1) * 3000]) for i in range(10)]
    fine = [
        Chunk(LINK, chunk.host_ns, chunk.data[index : index + 7])
        for chunk in whole
        for index in range(0, len(chunk.data), 7)
    ]
    assert notices_of(SessionCore(None), whole) == notices_of(SessionCore(None), fine)
