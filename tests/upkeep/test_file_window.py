"""Files read with a window, disturbed from outside, or not regular; files that are no recordings have a remedy."""

import os
import re
import signal
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.errors import RecordingError
from gateway.core.links.source import Chunk
from gateway.core.recording.container import McapOutput
from gateway.core.recording.file_content import read_content
from gateway.core.recording.reader import MEASUREMENT_SUFFIXES, RecordingReader
from gateway.core.recording.recorded_file import open_recorded_file
from gateway.importing.import_map import SUFFIXES
from gateway.upkeep import file_window
from gateway.upkeep.compact import compact_recording
from gateway.upkeep.file_window import FileWindow
from gateway.upkeep.repair import repair_recording
from tests.core.recording import streams

# Changes or kills from within the progress, which is called in the middle of the work.
DISTURBED = """
import os, signal, sys
from pathlib import Path
from gateway.core.errors import RecordingError
from gateway.upkeep.compact import compact_recording
from gateway.upkeep.repair import repair_recording

what, how, path, target = sys.argv[1], sys.argv[2], Path(sys.argv[3]), Path(sys.argv[4])

def disturb(done, total):
    if how == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    os.truncate(path, 4096)

try:
    if what == "repair":
        repair_recording(path, target, disturb)
    else:
        compact_recording(path, target, replace=what == "replace", progress=disturb)
except RecordingError as error:
    print(error)
"""


@pytest.fixture(scope="module")
def long_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("long") / "r.mcap"
    # More than a window follows the first call of the progress.
    items = [Chunk("test:link", 1 + number * 10**6, bytes(3000)) for number in range(7000)]
    return streams.write(path, items).path


def disturbed(what: str, how: str, path: Path, target: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", DISTURBED, what, how, str(path), str(target)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_repair_of_a_file_that_is_cut_meanwhile_says_so(tmp_path: Path, long_recording: Path) -> None:
    path = tmp_path / "r.mcap"
    path.write_bytes(long_recording.read_bytes())
    result = disturbed("repair", "cut", path, tmp_path / "fixed.mcap")
    assert result.returncode == 0, result
    assert "became shorter" in result.stdout
    assert [entry.name for entry in tmp_path.iterdir()] == ["r.mcap"]


@pytest.mark.parametrize("what", ["repair", "compact", "replace"])
def test_killed_work_leaves_a_part_that_the_next_run_replaces(tmp_path: Path, long_recording: Path, what: str) -> None:
    path, target = tmp_path / "r.mcap", tmp_path / "new.mcap"
    path.write_bytes(long_recording.read_bytes())
    for _ in range(2):
        assert disturbed(what, "kill", path, target).returncode == -signal.SIGKILL
        assert sorted(entry.name for entry in tmp_path.iterdir()) == ["new.mcap.part", "r.mcap"]
    before = streams.read(path)
    if what == "repair":
        repair_recording(path, target)
    else:
        compact_recording(path, target, replace=what == "replace")
    names = sorted(entry.name for entry in tmp_path.iterdir())
    assert names == (["r.mcap"] if what == "replace" else ["new.mcap", "r.mcap"])
    assert streams.read(tmp_path / names[0]) == before


def test_part_is_not_written_twice_nor_through_a_link(tmp_path: Path) -> None:
    output = McapOutput(tmp_path / "a.mcap", in_part=True)
    with pytest.raises(RecordingError, match="another command"):
        McapOutput(tmp_path / "a.mcap", in_part=True)
    (tmp_path / "a.mcap").write_bytes(b"precious")
    output.close()
    with pytest.raises(RecordingError, match="already exists"):
        output.publish()
    output.abandon()
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mcap"]
    (tmp_path / "b.mcap.part").symlink_to(tmp_path / "a.mcap")
    with pytest.raises(RecordingError, match="cannot create"):
        McapOutput(tmp_path / "b.mcap", in_part=True)
    assert (tmp_path / "a.mcap").read_bytes() == b"precious"


def test_long_torn_place_takes_bounded_memory(tmp_path: Path) -> None:
    path = streams.write(tmp_path / "r.mcap", [Chunk("test:link", 1, b"x" * 2000)], finish=False).path
    os.truncate(path, path.stat().st_size + (100 << 20))
    tracemalloc.start()
    try:
        repair_recording(path, tmp_path / "fixed.mcap")
        assert tracemalloc.get_traced_memory()[1] < 80 << 20
    finally:
        tracemalloc.stop()


@given(
    data=st.binary(max_size=60),
    places=st.lists(st.tuples(st.integers(0, 70), st.integers(0, 70)), min_size=1, max_size=8),
    window=st.integers(4, 20),
)
def test_window_reads_and_searches_as_the_whole_file(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, places: list[tuple[int, int]], window: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "window"
    path.write_bytes(data)
    pattern = re.compile(rb"[\x00-\x40][\s\S][\x00-\x7f]")
    with pytest.MonkeyPatch.context() as patch, path.open("rb") as file:
        patch.setattr(file_window, "WINDOW_BYTES", window)
        window_of_file = FileWindow(file, path)
        for first, end in places:
            assert bytes(window_of_file.part(first, end)) == data[first:end]
            match = pattern.search(data, first, end)
            assert window_of_file.search(pattern, 3, first, end) == (match.start() if match else None)


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


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no FIFO in folders")
@pytest.mark.parametrize(
    "opens",
    [
        RecordingReader,
        open_recorded_file,
        read_content,
        lambda path: repair_recording(path, path.with_name("fixed.mcap")),
    ],
    ids=["reader", "recorded file", "content", "repair"],
)
@pytest.mark.parametrize("name", ["fifo.mcap", "fifo.bin"])
def test_a_fifo_is_refused(tmp_path: Path, opens: Callable[[Path], object], name: str) -> None:
    path = tmp_path / name
    os.mkfifo(path)
    with pytest.raises(RecordingError, match="is a FIFO or a device") as caught:
        opens(path)
    assert "to a file first" in caught.value.remedy


def test_a_folder_is_refused_with_what_to_name(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="is a folder, not a recording") as caught:
        open_recorded_file(tmp_path)
    assert caught.value.remedy == f"Name its recordings: {tmp_path / '*.mcap'}"
