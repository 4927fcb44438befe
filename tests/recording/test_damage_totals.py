"""The stated damage is all of what is not read, and commands say so where nothing is left."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gateway.cli import treadlink
from gateway.errors import TreadlinkError
from gateway.reasons import Code
from gateway.recording.mcap_layout import link_items
from gateway.recording.reader import RecordingReader
from gateway.views.wording import text
from tests.testkit.campaign_recordings import write_recording


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tables = "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 80\n"
    return write_recording(tmp_path_factory.mktemp("whole") / "whole.mcap", tables, duration_s=12.0)


def changed(whole: Path, path: Path, start: int, size: int) -> Path:
    """Write a copy of a recording with some bytes set to zero."""
    content = bytearray(whole.read_bytes())
    content[start : start + size] = bytes(size)
    path.write_bytes(content)
    return path


def read(reader: RecordingReader) -> int:
    """Return the number of link items that a pass gives."""
    return sum(1 for message in reader.messages() for _ in link_items(message))


def test_the_rest_behind_a_gap_counts(whole: Path, tmp_path: Path) -> None:
    size = whole.stat().st_size
    reader = RecordingReader(changed(whole, tmp_path / "zeros.mcap", size // 4, 60_000))
    read(reader)
    damage = reader.damage
    assert damage is not None
    assert damage.code is Code.RECORDING_PARTS_DAMAGED
    assert damage["at_byte"] <= size // 4
    assert damage["unread_bytes"] + damage["at_byte"] == pytest.approx(size, abs=2000)
    assert damage["size_bytes"] == size
    assert "treadlink repair" in text(damage)


def test_all_damaged_chunks_count(whole: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    content = bytearray(whole.read_bytes())
    for position in rng.integers(5_000, len(content) - 5_000, 40).tolist():
        content[position] ^= 1
    path = tmp_path / "flip.mcap"
    path.write_bytes(content)
    reader = RecordingReader(path)
    lost = 1.0 - read(reader) / read(RecordingReader(whole))
    assert reader.damage is not None
    assert reader.damage.code is Code.RECORDING_PARTS_DAMAGED
    assert reader.damage["unread_bytes"] / len(content) == pytest.approx(lost, abs=0.1)


def test_a_pass_forgets_the_damage_of_the_one_before(whole: Path, tmp_path: Path) -> None:
    reader = RecordingReader(changed(whole, tmp_path / "zeros.mcap", whole.stat().st_size // 2, 60_000))
    read(reader)
    first = reader.damage
    read(reader)
    assert reader.damage == first


def test_one_damaged_part_keeps_its_own_words(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole.read_bytes()[: whole.stat().st_size * 3 // 4])
    reader = RecordingReader(path)
    read(reader)
    assert reader.damage is not None
    assert reader.damage.code is Code.RECORDING_CUT_OFF


def test_export_of_a_file_whose_readable_part_is_empty_names_the_damage(whole: Path, tmp_path: Path) -> None:
    path = changed(whole, tmp_path / "zeros.mcap", 3_000, 60_000)
    result = CliRunner().invoke(treadlink, ["export", str(path), str(tmp_path / "out.csv")])
    assert isinstance(result.exception, TreadlinkError)
    assert "bytes are not read" in str(result.exception)
    assert "treadlink repair" in result.exception.remedy
