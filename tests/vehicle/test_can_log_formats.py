"""Logs of a CAN bus as loggers write them, packed ones included: all give the same frames."""

import threading
from pathlib import Path

import pytest

from gateway.core.clock import ManualClock
from gateway.core.links.bus_frames import unpack
from gateway.core.links.source import BusFrames, is_live, open_source

can = pytest.importorskip("can")
FRAMES = [(0.01 * k, 0x123, bytes([k] * 8)) for k in range(50)]


@pytest.mark.parametrize("suffix", ["blf", "asc", "asc.gz", "log", "log.gz", "csv.gz", "trc.gz", "mf4"])
def test_log_of_each_format_is_read(tmp_path: Path, suffix: str) -> None:
    if suffix == "mf4":
        pytest.importorskip("asammdf")
    path = tmp_path / f"drive #1.{suffix}"
    with can.Logger(path) as log:
        for time_s, number, data in FRAMES:
            log.on_message_received(
                can.Message(timestamp=1.7e9 + time_s, arbitration_id=number, data=data, is_extended_id=False)
            )
    assert not is_live(f"can:{path}")
    items = open_source(f"can:{path}?speed=max", ManualClock()).items(threading.Event())
    frames = [frame for item in items if isinstance(item, BusFrames) for frame in unpack(item.data, item.host_ns)]
    assert [(frame.can_id, frame.data) for frame in frames] == [(number, data) for _, number, data in FRAMES]
