"""Commands to hubs with keys, to hubs of older protocols, and over serial ports and TCP."""

import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    HUB_ITSELF,
    CommandResult,
    Frame,
    MessageType,
    Outcome,
    SetRate,
    SetStream,
    SetTime,
)
from firmware_protocol.signing import is_signed, sign
from gateway.core.clock import ManualClock, SystemClock
from gateway.core.errors import SourceError
from gateway.core.links.source import Chunk, LinkItem, TwoWaySource, open_source
from gateway.core.session.core import SessionCore
from gateway.core.session.reasons import SessionCode
from gateway.core.text.wording import text
from gateway.security.cmac import Key, mac
from gateway.security.command_signing import command_frame
from gateway.security.freshness import Ledger
from gateway.security.guard import ConfiguredWheel, Guard
from gateway.security.hub_commands import CommandedSource, Executed, execute
from gateway.security.key_file import hub_identity, sensor_identity
from tests.testkit.hub_ends import TIMEOUT_S, PtyPort, TcpHub
from tests.testkit.signing_hub import HUB_ID, KEYS, SECONDS, SENSOR_ID, SENSOR_KEY, Hub, hello_message
from tests.testkit.waiting import HeldClock, until


def run(hub: Hub, keys: dict[str, Key] = KEYS) -> Executed:
    return execute(hub, SetStream(False), HeldClock(SECONDS * 10**9), keys=keys, timeout_s=TIMEOUT_S)


def test_command_to_signing_hub_is_signed() -> None:
    hub = Hub()
    assert run(hub) == Executed(0, True, "1.1")
    assert hub.executed == [(2, SetStream(False))]


def test_command_continues_behind_the_counter_of_the_hub() -> None:
    hub = Hub(highest=1000)
    assert run(hub).signed
    assert hub.executed == [(1002, SetStream(False))]
    assert len(hub.received) == 2


def test_exhausted_counter_is_reported() -> None:
    hub = Hub(highest=2**32 - 1)
    with pytest.raises(SourceError, match="command was repeated: its counter is not above"):
        run(hub)
    assert hub.executed == []
    assert len(hub.received) == 1


def test_reply_that_is_not_genuine_does_not_count() -> None:
    for forgery in (lambda frame: frame, lambda frame: sign(frame, HUB_ID, 41, lambda data: mac(SENSOR_KEY, data))):
        hub = Hub()
        hub.replies = forgery
        with pytest.raises(SourceError, match="did not reply"):
            run(hub)


@pytest.mark.parametrize(("signs", "minor"), [(True, 0), (False, 0), (False, 1)])
def test_command_goes_out_unsigned_only_when_asked(signs: bool, minor: int) -> None:
    hub = Hub(signs=signs, minor=minor)
    with pytest.raises(SourceError, match="the command was not sent") as refused:
        run(hub)
    assert "--unsigned" in refused.value.remedy
    assert hub.received == []
    asked = execute(
        Hub(signs=signs, minor=minor),
        SetStream(False),
        HeldClock(0),
        keys=KEYS,
        may_be_unsigned=True,
        timeout_s=TIMEOUT_S,
    )
    assert asked == Executed(0, False, f"1.{minor}")


def test_command_to_a_signing_hub_is_signed_also_where_it_need_not_be() -> None:
    clock = HeldClock(0)
    assert execute(Hub(), SetStream(False), clock, keys=KEYS, may_be_unsigned=True, timeout_s=TIMEOUT_S).signed


def test_without_keys_the_command_is_unsigned() -> None:
    assert run(Hub(signs=False), keys={}).hub == 0


def test_signing_hub_refuses_without_keys() -> None:
    hub = Hub()
    with pytest.raises(SourceError, match="command is not signed, or signed with another key") as refused:
        run(hub, keys={})
    assert "--keys" in refused.value.remedy
    assert hub.executed == []


class MuteHub(Hub):
    """A hub that takes commands and never replies; when it has nothing to send, a second passes."""

    def __init__(self, clock: HeldClock) -> None:
        super().__init__(signs=False)
        self._clock = clock
        self._sent = threading.Semaphore(0)

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        yield from super().items(stop)
        until(lambda: self._sent.acquire(blocking=False))
        while not stop.is_set():
            self._clock.advance_ns(10**9)
            until(lambda: stop.is_set() or self._sent.acquire(blocking=False))

    def send(self, data: bytes) -> None:
        self.received.append(data)
        self._sent.release()


def test_command_without_a_reply_is_sent_each_second_until_its_time_is_over() -> None:
    clock = HeldClock()
    begin_ns, hub = clock.now_ns(), MuteHub(clock)
    with pytest.raises(SourceError, match="did not reply to the command, sent 5 times"):
        execute(hub, SetTime(0), clock, timeout_s=5.0)
    sent = FrameDecoder().feed(b"".join(hub.received))
    assert [frame.seq for frame in sent] == list(range(5))
    times_ns = [frame.message.host_ns - begin_ns for frame in sent if isinstance(frame.message, SetTime)]
    assert times_ns == [10**9 * k for k in range(5)], "a clock is set to the time of sending"


def test_missing_key_of_the_hub_is_named() -> None:
    with pytest.raises(SourceError, match="there is no key for it") as missing:
        run(Hub(), keys={sensor_identity(SENSOR_ID): SENSOR_KEY})
    assert hub_identity(HUB_ID) in missing.value.remedy


def test_command_that_waits_for_a_hub_with_another_key_was_not_sent() -> None:
    hub = Hub()
    with pytest.raises(SourceError, match="did not reply to the challenge .*; the command was not sent") as refused:
        run(hub, keys={**KEYS, hub_identity(HUB_ID): SENSOR_KEY})
    assert "treadlink keys list" in refused.value.remedy
    assert hub.executed == []


def commanded(hub: Hub) -> None:
    source = CommandedSource(hub, ManualClock(SECONDS * 10**9), KEYS)
    assert len(list(source.items(threading.Event()))) > 2


def test_settings_are_signed_after_each_start_of_a_hub() -> None:
    hub = Hub()
    hub.rate_hz = 4800.0
    hub.waiting.append(hub.hello())
    commanded(hub)
    wanted = [SetTime(SECONDS * 10**9), SetRate(4800.0), SetStream(True)]
    assert [command for _, command in hub.executed] == wanted
    hub.boot_count, hub.highest = 42, 0
    hub.executed.clear()
    hub.waiting.append(hub.hello())
    commanded(hub)
    assert [seq for seq, _ in hub.executed] == [2, 3, 4]


def test_unsigned_hello_does_not_lower_the_protection() -> None:
    hub = Hub()
    bare = encode_frame(Frame(MessageType.HELLO, 0, 0, 9, 0, hello_message(99, 0)))
    hub.waiting.append(bare)
    commanded(hub)
    assert [is_signed(data) for data in hub.received] == [False, True, True]  # the challenge and two settings
    assert len(hub.executed) == 2


def test_older_protocol_is_reported_once() -> None:
    hub, core = Hub(minor=0, signs=False), SessionCore(None)
    for _ in range(3):
        core.take(Chunk("test", 1, hub.hello()))
    results = [
        notice.reason for notice in core.take_notices() if notice.reason.kind == (SessionCode.PROTOCOL_DIFFERS, "older")
    ]
    assert list(map(text, results)) == [
        "it takes only unsigned commands: its firmware uses protocol 1.0, older than treadlink's 1.1"
    ]


def test_reflected_command_is_no_frame_of_the_hub() -> None:
    """A command is signed with the same key; returned to the gateway it must not use up a counter."""
    hub = Hub()
    guard = Guard({(0, 0): ConfiguredWheel("FL", sensor_identity(SENSOR_ID))}, KEYS, Ledger(), requires=True)
    gate = guard.gate("test")
    assert gate(hub.hello())
    reflected = hub.sign(command_frame(SetStream(False), 5, 0))
    assert not gate(reflected)
    status = encode_frame(Frame(MessageType.COMMAND_RESULT, 0, HUB_ITSELF, 5, 0, CommandResult(5, 32, 0)))
    assert gate(hub.sign(status))


def reply_to(data: bytes) -> bytes:
    (frame,) = FrameDecoder().feed(data)
    result = CommandResult(frame.seq, frame.type, Outcome.DONE)
    return encode_frame(Frame(MessageType.COMMAND_RESULT, 3, HUB_ITSELF, 0, 0, result))


def test_command_over_tcp(tcp_hub: TcpHub) -> None:
    def hub() -> None:
        connection = tcp_hub.accept()
        with connection:
            connection.sendall(reply_to(connection.recv(100)))
            while connection.recv(100):  # repetitions on a slow computer
                pass

    thread = threading.Thread(target=hub)
    thread.start()
    source = open_source(f"tcp://127.0.0.1:{tcp_hub.port}", SystemClock())
    assert isinstance(source, TwoWaySource)
    assert execute(source, SetTime(5), SystemClock(), timeout_s=TIMEOUT_S).hub == 3
    thread.join(TIMEOUT_S)


def test_command_over_a_serial_port(tmp_path: Path) -> None:
    port = PtyPort(tmp_path / "tty")
    held = os.open(port.path, os.O_RDWR | os.O_NOCTTY)  # without a reader the hub's end cannot wait
    thread = threading.Thread(target=lambda: port.send(reply_to(os.read(port._master, 100))))
    thread.start()
    source = open_source(f"serial:{port.path}", SystemClock())
    assert isinstance(source, TwoWaySource)
    assert execute(source, SetTime(5), SystemClock(), timeout_s=TIMEOUT_S).hub == 3
    thread.join(TIMEOUT_S)
    os.close(held)
    port.close()


@pytest.mark.parametrize("scheme", ["tcp://127.0.0.1:9", "serial:/dev/ttyX"])
def test_rate_is_an_option_of_every_live_source(scheme: str) -> None:
    source = open_source(f"{scheme}?rate=4800", ManualClock())
    assert isinstance(source, TwoWaySource)
    assert source.rate_hz == 4800.0
    with pytest.raises(SourceError, match="rate=1 is not allowed"):
        open_source(f"{scheme}?rate=1", ManualClock())
