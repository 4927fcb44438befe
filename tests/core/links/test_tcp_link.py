"""TCP links on loopback."""

import errno
import socket
import struct
from collections.abc import Callable

import numpy as np
import pytest

from gateway.core.clock import ManualClock
from gateway.core.errors import LinkLostError, SourceError
from gateway.core.links import tcp_link
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem, Source, open_source
from gateway.core.links.tcp_link import HostPort, Keepalive, TcpLink
from tests.testkit.hub_ends import TIMEOUT_S, Reader, TcpHub

Read = Callable[[Source], Reader]
# Linux: a socket in repair mode closes without a word to its peer, as a hub without power does.
TCP_REPAIR = 19


def items_until(reader: Reader, count: int) -> list[LinkItem]:
    """Return items until they hold `count` bytes."""
    items: list[LinkItem] = []
    while sum(len(item.data) for item in items if isinstance(item, Chunk)) < count:
        item = reader.next()
        assert item is not None, reader.error
        items.append(item)
    return items


def test_bytes_sent_at_accept_are_kept_on_every_connection(tcp_hub: TcpHub, read: Read) -> None:
    generator = np.random.default_rng(3)
    greetings = [generator.bytes(int(size)) for size in generator.integers(1, 100_000, 12)]
    tcp_hub.greet(*greetings)
    reader = read(open_source(f"tcp://127.0.0.1:{tcp_hub.port}", ManualClock()))
    items = items_until(reader, sum(map(len, greetings)))
    assert b"".join(item.data for item in items if isinstance(item, Chunk)) == b"".join(greetings)
    kinds = [item.kind for item in items if isinstance(item, LinkEvent)]
    assert kinds == [LinkEventKind.CONNECTED, *[LinkEventKind.LOST, LinkEventKind.RESTORED] * 11]


def test_ipv6_address_is_connected(read: Read) -> None:
    try:
        hub = TcpHub("::1")
    except OSError:
        pytest.skip("this system has no IPv6")
    try:
        hub.greet(b"hello")
        source = open_source(f"tcp://[::1]:{hub.port}", ManualClock())
        assert source.link == f"tcp:[::1]:{hub.port}"
        reader = read(source)
        reader.event(LinkEventKind.CONNECTED)
        assert b"".join(chunk.data for chunk in reader.bytes(5)) == b"hello"
    finally:
        hub.close()


def test_reset_connection_is_a_lost_link(tcp_hub: TcpHub, read: Read) -> None:
    reader = read(open_source(f"tcp://127.0.0.1:{tcp_hub.port}", ManualClock()))
    hub = tcp_hub.accept()
    reader.event(LinkEventKind.CONNECTED)
    hub.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    hub.close()
    assert "broke the connection: Connection reset" in reader.event(LinkEventKind.LOST).text


def test_vanished_peer_is_found_by_keepalive(tcp_hub: TcpHub) -> None:
    link = TcpLink(HostPort("127.0.0.1", tcp_hub.port), Keepalive(idle_s=1, interval_s=1, probes=1))
    link.open()
    hub = tcp_hub.accept()
    try:
        hub.setsockopt(socket.IPPROTO_TCP, TCP_REPAIR, 1)
    except OSError:
        hub.close()
        link.close()
        pytest.skip("only root on Linux may make a peer vanish")
    hub.close()
    assert link.read(0.05) == b"", "the peer said goodbye"
    with pytest.raises(LinkLostError, match=r"broke the connection|does not answer any more"):
        link.read(TIMEOUT_S)
    link.close()


def test_peer_without_answers_is_a_lost_link(monkeypatch: pytest.MonkeyPatch) -> None:
    class Unanswered(socket.socket):
        def recv(self, *_: object) -> bytes:  # type: ignore[override]
            raise OSError(errno.ETIMEDOUT, "Connection timed out")

    link = TcpLink(HostPort("h", 1))
    with Unanswered() as unanswered:
        monkeypatch.setattr(tcp_link, "connect", lambda *_: unanswered)
        link.open()
        with pytest.raises(LinkLostError, match="does not answer any more"):
            link.read(0.05)


def test_idle_connections_are_probed(tcp_hub: TcpHub, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[socket.socket] = []
    connect = tcp_link.connect
    monkeypatch.setattr(tcp_link, "connect", lambda *place: opened.append(connect(*place)) or opened[0])
    link = TcpLink(HostPort("127.0.0.1", tcp_hub.port))
    link.open()
    assert opened[0].getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
    if hasattr(socket, "TCP_KEEPIDLE"):
        assert opened[0].getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) == Keepalive().idle_s
    link.close()


def test_unknown_host_is_named(monkeypatch: pytest.MonkeyPatch, read: Read) -> None:
    def unknown(*_: object, **__: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    for name in ("no..host", "hub"):  # the first one is no name at all
        reader = read(open_source(f"tcp://{name}:5000", ManualClock()))
        assert reader.next() is None
        assert str(reader.error) == f"cannot connect to {name}:5000: there is no host '{name}'"
        assert isinstance(reader.error, SourceError)
        monkeypatch.setattr(socket, "getaddrinfo", unknown)


def test_silent_host_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    def silent(*_: object) -> None:
        raise TimeoutError("timed out")

    monkeypatch.setattr(socket, "create_connection", silent)
    with pytest.raises(SourceError, match="no answer for 5 s") as caught:
        TcpLink(HostPort("10.0.0.1", 5000)).open()
    assert caught.value.cause == errno.ETIMEDOUT


def test_closing_peer_is_a_lost_link(tcp_hub: TcpHub, read: Read) -> None:
    data = np.random.default_rng(2).integers(0, 256, 200_000, dtype=np.uint8).tobytes()
    reader = read(open_source(f"tcp://127.0.0.1:{tcp_hub.port}", ManualClock()))
    with tcp_hub.accept() as hub:
        reader.event(LinkEventKind.CONNECTED)
        hub.sendall(data)
        assert b"".join(chunk.data for chunk in reader.bytes(len(data))) == data
        hub.sendall(b"last words")
    assert b"".join(chunk.data for chunk in reader.bytes(10)) == b"last words"
    lost = reader.event(LinkEventKind.LOST)
    assert f"127.0.0.1:{tcp_hub.port} closed the connection" in lost.text
    with tcp_hub.accept() as hub:
        reader.event(LinkEventKind.RESTORED)
        hub.sendall(b"again")
        assert b"".join(chunk.data for chunk in reader.bytes(5)) == b"again"


def test_peer_that_accepts_and_closes_is_reported_once_and_back_when_it_sends(tcp_hub: TcpHub, read: Read) -> None:
    reader = read(open_source(f"tcp://127.0.0.1:{tcp_hub.port}", ManualClock()))
    with tcp_hub.accept() as hub:
        reader.event(LinkEventKind.CONNECTED)
        hub.sendall(b"data")
        assert b"".join(chunk.data for chunk in reader.bytes(4)) == b"data"
    reader.event(LinkEventKind.LOST)
    for _ in range(20):
        tcp_hub.accept().close()
    with tcp_hub.accept() as hub:
        hub.sendall(b"again")
        items = items_until(reader, 5)
        kinds = [item.kind for item in items if isinstance(item, LinkEvent)]
        assert kinds == [LinkEventKind.RESTORED, LinkEventKind.LOST] * 2 + [LinkEventKind.RESTORED]


def test_peer_that_keeps_the_connection_and_sends_nothing_is_connected_again(tcp_hub: TcpHub, read: Read) -> None:
    clock = ManualClock()
    reader = read(open_source(f"tcp://127.0.0.1:{tcp_hub.port}?silence=4", clock))
    with tcp_hub.accept() as stopped:
        reader.event(LinkEventKind.CONNECTED)
        stopped.sendall(b"data")
        assert b"".join(chunk.data for chunk in reader.bytes(4)) == b"data"
        clock.advance_ns(4_000_000_000)
        assert "silent for 4 s" in reader.event(LinkEventKind.LOST).text
        with tcp_hub.accept() as hub:
            reader.event(LinkEventKind.RESTORED)
            hub.sendall(b"again")
            assert b"".join(chunk.data for chunk in reader.bytes(5)) == b"again"


def test_switched_off_hub_is_retried(tcp_hub: TcpHub, read: Read) -> None:
    reader = read(open_source(f"tcp://127.0.0.1:{tcp_hub.port}", ManualClock()))
    hub = tcp_hub.accept()
    reader.event(LinkEventKind.CONNECTED)
    tcp_hub.close()
    hub.close()
    reader.event(LinkEventKind.LOST)
    retrying = reader.next()
    assert isinstance(retrying, LinkEvent)
    assert "cannot connect to 127.0.0.1" in retrying.text
    assert "refused" in retrying.text


def test_refused_connection_raises_at_once(tcp_hub: TcpHub, read: Read) -> None:
    tcp_hub.close()
    reader = read(open_source(f"tcp://127.0.0.1:{tcp_hub.port}", ManualClock()))
    assert reader.next() is None
    assert isinstance(reader.error, SourceError)
    assert str(reader.error) == f"cannot connect to 127.0.0.1:{tcp_hub.port}: Connection refused"
    assert reader.error.cause == errno.ECONNREFUSED


@pytest.mark.parametrize("target", ["localhost", "host:0", "host:70000", "a:b:c"])
def test_wrong_addresses_are_refused(target: str) -> None:
    with pytest.raises(SourceError) as caught:
        open_source(f"tcp://{target}", ManualClock())
    assert "tcp://host:port" in caught.value.remedy
