"""Contract of the protocol `Source`, for every source."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from gateway.core.clock import ManualClock
from gateway.core.errors import SourceError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem, Source, open_source
from gateway.core.recording.writer import RecordingWriter
from gateway.makers.read_ahead import ReadAheadSource
from tests.testkit.hub_ends import TIMEOUT_S, PtyPort, Reader, TcpHub

Opened = tuple[Source, Callable[[], None]]
"""A source, and what makes its hub send; to be called when it is connected."""

STREAM = np.random.default_rng(7).bytes(400_000)
ENOUGH_CHUNKS = 3


def nothing() -> None:
    return None


@pytest.fixture(params=["serial", "tcp", "tcp read ahead", "replay", "dump", "sim"])
def opened(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Opened]:
    clock = ManualClock()
    closing: list[Callable[[], object]] = []
    hang_up = nothing
    if request.param == "serial":
        port = PtyPort(tmp_path / "ttyHUB")
        closing.append(port.close)
        hang_up = port.hang_up

        def send() -> None:
            port.send(STREAM)

        source = open_source(f"serial:{port.path}", clock)
    elif request.param.startswith("tcp"):
        hub = TcpHub()
        closing.append(hub.close)

        def send() -> None:
            connection = hub.accept()
            closing.append(connection.close)
            with contextlib.suppress(OSError):  # the gateway may have closed
                connection.sendall(STREAM)

        source = open_source(f"tcp://127.0.0.1:{hub.port}", clock)
        source = source if request.param == "tcp" else ReadAheadSource(source)
    elif request.param == "replay":
        writer = RecordingWriter(tmp_path / "r.mcap", start_ns=0)
        for number in range(60):
            writer.write(Chunk("serial:/dev/x", number * 10**7, STREAM[number * 1000 : (number + 1) * 1000]))
        writer.close()
        source, send = open_source(f"replay:{writer.path}", clock), nothing
    elif request.param == "dump":
        (tmp_path / "d.bin").write_bytes(STREAM)
        source, send = open_source(f"replay:{tmp_path}/d.bin?rate=100000", clock), nothing
    else:
        source, send = open_source("sim:demo?seed=1", clock), nothing
    sender = threading.Thread(target=send)
    yield source, sender.start
    source.close()
    hang_up()
    if sender.ident is not None:
        sender.join(TIMEOUT_S)
        assert not sender.is_alive(), "the hub's end does not let go"
    for close in closing:
        close()


def read_some(source: Source, send: Callable[[], None], reader: Reader) -> list[LinkItem]:
    """Return items up to the third chunk; the hub sends as soon as the link is open."""
    items: list[LinkItem] = []
    while sum(isinstance(item, Chunk) for item in items) < ENOUGH_CHUNKS:
        item = reader.next()
        assert item is not None, f"ended early: {reader.error}"
        items.append(item)
        if isinstance(item, LinkEvent) and item.kind is LinkEventKind.CONNECTED:
            send()
    return items


def test_chunks_are_ordered_and_not_empty(opened: Opened, read: Callable[[Source], Reader]) -> None:
    source, send = opened
    name = source.link
    items = read_some(source, send, read(source))
    assert name
    assert {item.link for item in items} == {name} == {source.link}
    chunks = [item for item in items if isinstance(item, Chunk)]
    assert all(chunk.data and isinstance(chunk.data, bytes) for chunk in chunks)
    times = [item.host_ns for item in items]
    assert times == sorted(times)
    assert source.vehicle_toml is None or "[vehicle]" in source.vehicle_toml


def test_stop_ends_items(opened: Opened, read: Callable[[Source], Reader]) -> None:
    source, send = opened
    reader = read(source)
    read_some(source, send, reader)
    reader.finish()
    assert reader.error is None


def test_stop_before_start_ends_items(opened: Opened) -> None:
    source, _ = opened
    stop = threading.Event()
    stop.set()
    assert not [item for item in source.items(stop) if isinstance(item, Chunk)]


def test_close_from_another_thread_ends_items(opened: Opened, read: Callable[[Source], Reader]) -> None:
    source, send = opened
    reader = read(source)
    read_some(source, send, reader)
    source.close()
    source.close()
    while reader.next() is not None:
        pass
    assert reader.error is None


def test_closed_source_gives_no_chunk(opened: Opened) -> None:
    source, _ = opened
    source.close()
    source.close()
    assert not [item for item in source.items(threading.Event()) if isinstance(item, Chunk)]


@pytest.mark.parametrize(
    "uri",
    [
        *(f"serial:/dev/x?{option}" for option in ("baudrate=fast", "baudrate=0", "baudrate=-1", "exclusive=maybe")),
        "serial:/dev/x?parity=x",
        *(f"ble://X?{option}" for option in ("scan=no", "scan=0", "silence=-1", "rate=1999", "notify=loudly")),
        *(
            f"{link}?silence={limit}"
            for link in ("tcp://127.0.0.1:1", "serial:/dev/x")
            for limit in (-1, "x", "nan", 4000)
        ),
        *(f"sim:demo?receiver={rate_hz}" for rate_hz in (1000, "no")),
    ],
)
def test_wrong_value_is_named_with_a_remedy(uri: str) -> None:
    with pytest.raises(SourceError, match=uri.partition("?")[2]) as caught:
        open_source(uri, ManualClock())
    assert caught.value.remedy.startswith("Give ")


@pytest.mark.parametrize(
    ("uri", "option", "remedy"),
    [
        ("serial:/dev/x?baud=9600", "baud", "Did you mean baudrate?"),
        ("ble://X?adaptor=hci1", "adaptor", "Did you mean adapter?"),
        ("nmea:/dev/ttyX?baud=1", "baud", "Did you mean baudrate?"),
        ("nmea:localhost:2947?rate=9600", "rate", "Options are silence."),
        ("tcp://h:1?x=1", "x", "Options are rate, silence."),
    ],
)
def test_unknown_option_is_named_with_those_that_there_are(uri: str, option: str, remedy: str) -> None:
    with pytest.raises(SourceError, match=f"no option '{option}'") as caught:
        open_source(uri, ManualClock())
    assert remedy in caught.value.remedy
