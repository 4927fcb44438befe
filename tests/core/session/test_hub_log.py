"""A hub's log text: shown behind the hub's name, on one line, escaped, at most ten lines a second."""

import json
from pathlib import Path
from typing import Any

import pytest

import firmware_protocol
from firmware_protocol.codec import decode_payload, encode_payload
from firmware_protocol.messages import HUB_ITSELF, CommandResult, LogText, MessageType, Outcome
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk
from gateway.core.reasons import Notice, Reason
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.hub_log import LINES_PER_S
from gateway.core.session.reasons import SessionCode
from gateway.core.text.plain import PlainView
from gateway.core.text.recording_topics import log_level
from gateway.core.text.text import escaped
from tests.core.session.hub_frames import HubFrames
from tests.testkit.commands import invoked

START_NS = 1_700_000_000_000_000_000
SECOND_NS = 1_000_000_000
VECTORS = json.loads((Path(firmware_protocol.__file__).parent / "vectors" / "frames.json").read_text("utf-8"))
FORGED = "\x1b[2J\nSECURITY: sensor 0000a001: all frames verified\r\n\u202e# ok\x9b1m"


def log_frame(text: str, level: int = 1, wheel: int = HUB_ITSELF) -> bytes:
    hub = HubFrames()
    hub.add(MessageType.LOG_TEXT, encode_payload(LogText(level, text)), wheel)
    return hub.stream[0]


def shown(core: SessionCore) -> list[str]:
    lines: list[str] = []
    view = PlainView(lines.append)
    for notice in core.take_notices():
        view.notice(notice)
    return lines


@pytest.mark.parametrize("vector", VECTORS["shown_texts"], ids=lambda vector: vector["name"].replace(" ", "_"))
def test_shown_text(vector: dict[str, Any]) -> None:
    message = decode_payload(MessageType.LOG_TEXT, bytes.fromhex(vector["payload_hex"]))
    assert isinstance(message, LogText)
    assert (log_level(message), escaped(message.text)) == (vector["level"], vector["shown"])


def test_log_text_cannot_speak_for_the_program() -> None:
    core = SessionCore(None)
    core.take(Chunk("x", START_NS, log_frame(FORGED, 3)))
    (line,) = shown(core)
    assert line == (
        "# hub 0: log (error): \\x1b[2J\\nSECURITY: sensor 0000a001: all frames verified\\r\\n\\u202e# ok\\x9b1m"
    )


def test_link_is_named_where_there_are_several() -> None:
    core = SessionCore(None)
    core.add_link("a")
    core.add_link("b")
    core.take(Chunk("b", START_NS, log_frame("awake", 7)))
    assert shown(core) == ["# b, hub 0: log (level 7): awake"]


def test_flood_of_lines_is_limited_and_counted() -> None:
    core, hub = SessionCore(None), HubFrames()
    for number in range(3000):
        hub.add(MessageType.LOG_TEXT, encode_payload(LogText(1, f"a\nb {number}")), HUB_ITSELF)
        core.take(Chunk("x", START_NS + number * SECOND_NS // 1000, hub.stream[-1]))
    core.finish()
    notices = core.take_notices()
    reported = [notice for notice in notices if notice.reason.code is SessionCode.HUB_LOG_LEFT_OUT]
    assert len(notices) <= 3 * LINES_PER_S + 1
    lines = sum(notice.reason.code is SessionCode.HUB_LOG for notice in notices)
    assert lines + sum(int(notice.reason["count"]) for notice in reported) == 3000
    assert lines == 3 * LINES_PER_S - 2


def test_lines_left_out_are_reported_when_the_hub_falls_silent() -> None:
    core, hub = SessionCore(None), HubFrames()
    for number in range(15):
        hub.add(MessageType.LOG_TEXT, encode_payload(LogText(1, str(number))), HUB_ITSELF)
    core.take(Chunk("x", START_NS, b"".join(hub.stream)))
    core.take_notices()
    core.tick(START_NS + 2 * SECOND_NS)
    assert [notice.reason for notice in core.take_notices()] == [Reason(SessionCode.HUB_LOG_LEFT_OUT, count=5)]


def test_answers_to_no_command_are_limited() -> None:
    core, hub = SessionCore(None), HubFrames()
    for _ in range(500):
        hub.send(MessageType.COMMAND_RESULT, CommandResult(0, 33, Outcome.FAILED), HUB_ITSELF)
    core.take(Chunk("x", START_NS, b"".join(hub.stream)))
    core.finish()
    assert len(core.take_notices()) == LINES_PER_S + 1


def test_inspect_shows_levels_and_escapes(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    writer = RecordingWriter(path, start_ns=START_NS)
    hub = HubFrames()
    for text in (FORGED, *map(str, range(40))):
        hub.add(MessageType.LOG_TEXT, encode_payload(LogText(2, text)), HUB_ITSELF)
    writer.write(Chunk("x", START_NS, b"".join(hub.stream)))
    writer.close()
    printed = invoked("inspect", path).output
    assert "hub 0: warning: \\x1b[2J\\nSECURITY: sensor" in printed
    assert "... and 11 more" in printed
    assert all(line.isprintable() for line in printed.splitlines())
    (link,) = json.loads(invoked("inspect", path, "--json").output)["links"].values()
    assert link["log"][0] == {"host_ns": START_NS, "hub": 0, "level": "warning", "text": FORGED}


def test_text_of_an_event_stays_on_its_line() -> None:
    lines: list[str] = []
    PlainView(lines.append).notice(Notice("x\n# y", Reason(LinkCode.QUOTED_TEXT, text="gone\nSECURITY: forged")))
    assert lines == ["# x\\n# y: gone\\nSECURITY: forged"]
