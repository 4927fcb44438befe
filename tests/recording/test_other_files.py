"""Files that are no recordings: the remedy is the command that takes them."""

from pathlib import Path

import pytest

from gateway.errors import RecordingError
from gateway.importing.import_map import SUFFIXES
from gateway.recording.reader import MEASUREMENT_SUFFIXES, RecordingReader


def test_suffixes_are_those_of_the_import() -> None:
    assert set(SUFFIXES) == MEASUREMENT_SUFFIXES


@pytest.mark.parametrize("rows", [2, 3000])
@pytest.mark.parametrize("name", ["x.csv", "X.TXT", "run.dat", "run.mf4", "a.parquet"])
def test_measurement_is_imported(tmp_path: Path, name: str, rows: int) -> None:
    path = tmp_path / name
    path.write_text("t,z\n" + "0.1,2.5\n" * rows)
    with pytest.raises(RecordingError, match="is not a recording") as caught:
        list(RecordingReader(path).items())
    assert f"treadlink import --guess '{path}'" in caught.value.remedy


@pytest.mark.parametrize("start", [b"\x89HDF\r\n\x1a\n", b"MATLAB 5.0 MAT-file", b"MDF     4.10", b"PAR1"])
def test_measurement_without_its_suffix_is_known_by_its_first_bytes(tmp_path: Path, start: bytes) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(start + bytes(5000))
    with pytest.raises(RecordingError) as caught:
        list(RecordingReader(path).items())
    assert "treadlink import --guess" in caught.value.remedy


def test_recording_whose_beginning_is_lost_is_repaired(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(bytes(5000))
    with pytest.raises(RecordingError) as caught:
        list(RecordingReader(path).items())
    assert "treadlink repair" in caught.value.remedy
    path.rename(tmp_path / "notes.bin")
    with pytest.raises(RecordingError) as caught:
        list(RecordingReader(tmp_path / "notes.bin").items())
    assert "treadlink repair" not in caught.value.remedy
