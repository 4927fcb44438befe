"""References in recordings that were compacted or repaired, and damaged ones."""

from pathlib import Path

import pytest

from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.importing.reference_topic import RecordedReferences, reference_topic
from gateway.upkeep.compact import compact_recording
from gateway.upkeep.repair import repair_recording

START_NS = 1_700_000_000_000_000_000


def recording(path: Path) -> Path:
    writer = RecordingWriter(path, start_ns=START_NS)
    for number in range(20):
        payload = {"quantity": "speed", "time_s": number * 0.1, "value": 20.0 + number, "value_std": 0.5}
        writer.write_topic(reference_topic("FL", "drum"), START_NS + number * 10**8, payload)
    bad = {"quantity": "weight", "time_s": 0.0, "value": 1.0}
    writer.write_topic(reference_topic("FL", "other"), START_NS, bad)
    writer.close()
    return path


def assert_kept(path: Path) -> None:
    reader = RecordingReader(path)
    references = RecordedReferences(reader)
    assert list(reader.items()) == []
    (result,) = references.references()
    assert (result.position, result.name, result.quantity, result.value_std) == ("FL", "drum", "speed", 0.5)
    assert result.values == [20.0 + number for number in range(20)]
    assert result.times_s == pytest.approx([0.1 * number for number in range(20)])


def test_compaction_and_repair_keep_references(tmp_path: Path) -> None:
    path = recording(tmp_path / "r.mcap")
    assert_kept(path)
    compact_recording(path, tmp_path / "c.mcap")
    assert_kept(tmp_path / "c.mcap")
    repair_recording(path, tmp_path / "f.mcap")
    assert_kept(tmp_path / "f.mcap")
