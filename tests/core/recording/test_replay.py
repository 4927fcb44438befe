"""Replay yields the recorded chunks, times and events at any speed."""

import itertools
import threading
from pathlib import Path

import numpy as np
import pytest

from gateway.core.clock import ManualClock
from gateway.core.errors import SourceError
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem, open_source
from gateway.core.text import wording
from tests.core.recording import streams

LINK = "serial:/dev/ttyUSB0"


@pytest.fixture
def recording(tmp_path: Path) -> tuple[Path, list[LinkItem]]:
    rng = np.random.default_rng(4)
    items: list[LinkItem] = [*streams.chunks(rng, b"".join(streams.frames(rng, 200)), LINK)]
    items[40:40] = streams.some_events(LINK)
    return streams.write(tmp_path / "r.mcap", items, topics=True).path, items


@pytest.mark.parametrize("option", ["", "?speed=1", "?speed=10", "?speed=0.5", "?speed=max"])
def test_items_are_identical_at_any_speed(recording: tuple[Path, list[LinkItem]], option: str) -> None:
    path, items = recording
    got = streams.replay(f"replay:{path}{option}")
    assert got[:-1] == items
    end = got[-1]
    assert isinstance(end, LinkEvent)
    assert (end.kind, end.host_ns) == (LinkEventKind.ENDED, items[-1].host_ns)


@pytest.mark.parametrize(("speed", "factor"), [("1", 1.0), ("10", 10.0), ("0.25", 0.25)])
def test_pace_follows_an_absolute_schedule(recording: tuple[Path, list[LinkItem]], speed: str, factor: float) -> None:
    path, items = recording
    clock = ManualClock(5_000_000_000)
    source = open_source(f"replay:{path}?speed={speed}", clock)
    earliest = 0
    for item in itertools.islice(source.items(threading.Event()), len(items)):
        due = (item.host_ns - items[0].host_ns) / factor
        assert clock.now_ns() - 5_000_000_000 == pytest.approx(max(due, earliest), abs=2)
        clock.advance_ns(123_456)  # the consumer takes time; the schedule must not move
        earliest = clock.now_ns() - 5_000_000_000


def test_full_speed_never_waits(recording: tuple[Path, list[LinkItem]]) -> None:
    clock = ManualClock(7)
    list(open_source(f"replay:{recording[0]}?speed=max", clock).items(threading.Event()))
    assert clock.now_ns() == 7


def test_replay_provides_configuration_and_link(recording: tuple[Path, list[LinkItem]]) -> None:
    source = open_source(f"replay:{recording[0]}", ManualClock())
    assert source.vehicle_toml == streams.TOML
    assert source.link == LINK


def test_recording_a_replay_gives_the_same_recording(recording: tuple[Path, list[LinkItem]], tmp_path: Path) -> None:
    once = streams.replay(f"replay:{recording[0]}?speed=max")
    twice_path = streams.write(tmp_path / "twice.mcap", once).path
    assert streams.replay(f"replay:{twice_path}?speed=max") == once


def test_last_item_reports_damage(recording: tuple[Path, list[LinkItem]], tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(recording[0].read_bytes()[:20_000])
    end = streams.replay(f"replay:{path}?speed=max")[-1]
    assert isinstance(end, LinkEvent)
    assert [detail.code for detail in end.details] == [LinkCode.RECORDING_CUT_OFF]
    assert "treadlink repair" in wording.text(end.reason)
    # The event survives a recording of the replay.
    again = streams.write(tmp_path / "again.mcap", [end]).path
    assert streams.replay(f"replay:{again}?speed=max") == [end]


def test_close_ends_a_waiting_replay(recording: tuple[Path, list[LinkItem]]) -> None:
    source = open_source(f"replay:{recording[0]}", ManualClock())
    items = source.items(threading.Event())
    next(items)
    source.close()
    assert list(items) == []


def test_dump_with_a_rate(tmp_path: Path) -> None:
    data = np.random.default_rng(5).bytes(50_001)
    path = tmp_path / "hub.bin"
    path.write_bytes(data)
    items = streams.replay(f"replay:{path}?rate=100000")
    chunks = [item for item in items if isinstance(item, Chunk)]
    assert b"".join(chunk.data for chunk in chunks) == data
    assert chunks[0].host_ns == 10_000_000
    assert chunks[-1].host_ns == 500_010_000
    assert {chunk.link for chunk in chunks} == {"dump:hub.bin"}


def test_dump_without_a_rate_does_not_wait(tmp_path: Path) -> None:
    path = tmp_path / "hub.bin"
    path.write_bytes(bytes(10_000))
    chunks = [item for item in streams.replay(f"replay:{path}") if isinstance(item, Chunk)]
    assert sum(len(chunk.data) for chunk in chunks) == 10_000
    assert {chunk.host_ns for chunk in chunks} == {0}


@pytest.mark.parametrize("option", ["speed=fast", "speed=0", "speed=-1", "speed=nan", "speed=inf", "rate=5", "sped=1"])
def test_invalid_options_are_rejected(recording: tuple[Path, list[LinkItem]], option: str) -> None:
    with pytest.raises(SourceError) as caught:
        open_source(f"replay:{recording[0]}?{option}", ManualClock())
    assert option.split("=")[0] in str(caught.value)
    assert caught.value.remedy


def test_missing_and_other_files_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="does not exist"):
        open_source(f"replay:{tmp_path}/none.mcap", ManualClock())
    (tmp_path / "text.mcap").write_text("hello")
    with pytest.raises(SourceError, match="is not a recording"):
        open_source(f"replay:{tmp_path}/text.mcap", ManualClock())
