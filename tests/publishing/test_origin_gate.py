"""Web pages connect to the Foxglove server only from an allowed origin."""

import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from gateway.publishing.foxglove_server import FoxgloveSink
from gateway.publishing.origin_gate import is_admitted

ALLOWED = "https://viewer.example"


@pytest.mark.parametrize("origin", ["https://evil.example", "null", "http://localhost:8765", ALLOWED + ".evil"])
def test_server_refuses_other_web_pages(origin: str) -> None:
    sink = FoxgloveSink("127.0.0.1", 0, frozenset((ALLOWED,)))
    sink.open(threading.Event())
    try:
        address = f"ws://127.0.0.1:{sink.port}"
        with pytest.raises(InvalidStatus, match="403"):
            connect(address, subprotocols=["foxglove.sdk.v1"], origin=origin)
        for admitted in (ALLOWED, None):
            with connect(address, subprotocols=["foxglove.sdk.v1"], origin=admitted) as viewer:
                assert "serverInfo" in str(viewer.recv(10.0))
    finally:
        sink.close()


NAMES = st.sampled_from(["Origin", "ORIGIN", "origin ", " origin", "oRiGiN"])


@given(st.lists(st.tuples(NAMES, st.text(st.characters(codec="latin-1", exclude_characters="\r\n"))), min_size=1))
def test_only_the_allowed_origin_alone_is_admitted(origins: list[tuple[str, str]]) -> None:
    lines = ["GET / HTTP/1.1", "Upgrade: websocket", *(f"{name}: {value}" for name, value in origins)]
    stated = [value.strip() for _, value in origins]
    assert is_admitted("\r\n".join(lines).encode("latin-1"), frozenset((ALLOWED,))) == (stated == [ALLOWED])


def test_what_is_no_websocket_is_refused() -> None:
    assert not is_admitted(b"GET / HTTP/1.1\r\nHost: x", frozenset())
    assert not is_admitted(b"POST / HTTP/1.1\r\nUpgrade: websocket", frozenset())
