"""Fixtures: a serial port, a TCP hub, and a thread that reads a source."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gateway.io.source import Source
from tests.testkit.hub_ends import PtyPort, Reader, TcpHub


@pytest.fixture
def pty_port(tmp_path: Path) -> Iterator[PtyPort]:
    port = PtyPort(tmp_path / "ttyHUB")
    yield port
    port.close()


@pytest.fixture
def tcp_hub() -> Iterator[TcpHub]:
    hub = TcpHub()
    yield hub
    hub.close()


@pytest.fixture
def read() -> Iterator[Callable[[Source], Reader]]:
    readers: list[Reader] = []

    def start(source: Source) -> Reader:
        readers.append(Reader(source))
        return readers[-1]

    yield start
    for reader in readers:
        reader.finish()
        reader.source.close()
