"""Fixture: a serial port."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.testkit.hub_ends import PtyPort


@pytest.fixture
def pty_port(tmp_path: Path) -> Iterator[PtyPort]:
    port = PtyPort(tmp_path / "ttyHUB")
    yield port
    port.close()
