"""A command that finds no memory ends with a message and status 1, wherever it fails."""

import errno
import os
import sys
from pathlib import Path

import pytest

from gateway.cli import main

MAPPED = "libgfortran-8f1e9814.so.5.0.0: failed to map segment from shared object"
SHORTAGES = {
    "array": MemoryError("Unable to allocate 9.00 GiB for an array with shape (1,)"),
    "library": ImportError(MAPPED),
    "library of numpy": ImportError(f"IMPORTANT\n\nOriginal error was: {MAPPED}\n"),
    "process": OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)),
}


def ended(monkeypatch: pytest.MonkeyPatch, path: Path, error: Exception) -> pytest.ExceptionInfo[BaseException]:
    """Return how `treadlink repair` ends when its work fails with an error."""

    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("gateway.recording.repair.repair_recording", fail)
    monkeypatch.setattr("gateway.cli.stop_signals.install", lambda: None)
    monkeypatch.setattr(sys, "argv", ["treadlink", "repair", str(path)])
    with pytest.raises(BaseException) as raised:
        main()
    return raised


@pytest.mark.parametrize("shortage", SHORTAGES)
def test_no_memory_is_a_message(monkeypatch, capsys, tmp_path, shortage):
    (tmp_path / "drive.mcap").touch()
    raised = ended(monkeypatch, tmp_path / "drive.mcap", SHORTAGES[shortage])
    assert isinstance(raised.value, SystemExit)
    assert raised.value.code == 1
    printed = capsys.readouterr().err
    assert "there is not enough memory" in printed
    assert "ulimit -v" in printed


def test_a_missing_module_remains_a_fault_of_the_program(monkeypatch, tmp_path):
    (tmp_path / "drive.mcap").touch()
    raised = ended(monkeypatch, tmp_path / "drive.mcap", ImportError("cannot import name 'x' from 'y'"))
    assert isinstance(raised.value, ImportError)
