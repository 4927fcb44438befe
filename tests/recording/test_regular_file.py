"""What cannot be read at several places is refused, and waits for nobody."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.errors import RecordingError
from gateway.recording.file_content import read_content
from gateway.recording.reader import RecordingReader
from gateway.recording.recorded_file import open_recorded_file
from gateway.recording.repair import repair_recording


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
