"""TCP through pyserial's socket:// on loopback."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gateway.clock import ManualClock
from gateway.errors import SourceError
from gateway.io.source import LinkEvent, LinkEventKind, Source, open_source
from tests.testkit.hub_ends import Reader, TcpHub

Read = Callable[[Source], Reader]


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
    assert "refused" in str(reader.error)
    assert "socket://" not in str(reader.error)


@pytest.mark.parametrize("uri", ["tcp://localhost", "tcp://host:0", "tcp://host:70000", "tcp://a:b:c", "tcp://h:1?x=1"])
def test_wrong_addresses_are_refused(uri: str) -> None:
    with pytest.raises(SourceError) as caught:
        open_source(uri, ManualClock())
    assert "tcp://host:port" in caught.value.remedy
