"""Files that the user or a configuration names: only regular ones of bounded size are read."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.core.bounded_input import MAX_DBC_BYTES
from gateway.core.cli import main
from gateway.core.clock import SystemClock
from gateway.core.config.validation import read_text
from gateway.core.config.vehicle import load_vehicle, parse_vehicle
from gateway.core.errors import TreadlinkError
from gateway.core.links.source import open_source
from gateway.fleet.dataset import DESCRIPTION, read_description
from gateway.fleet.history_reading import read_odometer
from gateway.vehicle.signal_decoding import open_decoder

VEHICLE = """
[tire]
radius_mm = 320
[[wheel]]
position = "FL"
hub = 0
wheel = 0
[vehicle_signals]
dbc = "the file"
[[vehicle_signals.signal]]
quantity = "vehicle_speed"
message = "M"
signal = "S"
"""


def read_vehicle_dbc(path: Path) -> object:
    vehicle = parse_vehicle(VEHICLE.replace("the file", str(path)), "car.toml")
    return open_decoder(vehicle, path.parent / "car.toml", [], [])


def read_source_dbc(path: Path) -> object:
    pytest.importorskip("can")
    return open_source(f"can:virtual:0?dbc={path}", SystemClock())


READERS: dict[str, Callable[[Path], object]] = {
    "vehicle": load_vehicle,
    "document": lambda path: read_text(path, "the document"),
    "dbc of the vehicle": read_vehicle_dbc,
    "dbc of a source": read_source_dbc,
    "odometer": read_odometer,
}


def fifo(folder: Path) -> Path:
    os.mkfifo(folder / "fifo")
    return folder / "fifo"


def loop(folder: Path) -> Path:
    (folder / "loop").symlink_to(folder / "loop")
    return folder / "loop"


def too_large(folder: Path) -> Path:
    with (folder / "large").open("wb") as file:
        file.truncate(MAX_DBC_BYTES + 1)
    return folder / "large"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs FIFOs")
@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(
    "make",
    [fifo, loop, too_large, lambda _: Path("/dev/zero"), lambda folder: folder, lambda folder: folder / ("n" * 260)],
    ids=["fifo", "loop", "too large", "device", "folder", "long name"],
)
def test_file_that_cannot_be_read_whole_is_refused(reader: str, make: Callable[[Path], Path], tmp_path: Path) -> None:
    path = make(tmp_path)
    with pytest.raises(TreadlinkError) as refused:
        READERS[reader](path)
    assert path.name in str(refused.value)
    assert refused.value.remedy


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs FIFOs")
@pytest.mark.parametrize("content", [None, b"[" * 100_000, b'{"rows": ' + b"9" * 20_000 + b"}", b"\xff"])
def test_description_of_a_dataset_that_is_none_is_refused(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / DESCRIPTION
    if content is None:
        os.mkfifo(path)
    else:
        path.write_bytes(content)
    with pytest.raises(TreadlinkError, match=DESCRIPTION):
        read_description(tmp_path)


@pytest.mark.parametrize(
    "line", ["simulate {name} --out o.mcap", "inspect {name}", "diagnose {name}", "import {name} --guess"]
)
def test_a_name_that_no_file_can_have_is_a_message(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("gateway.core.cli.stop_signals.install", lambda: None)
    monkeypatch.setattr(sys, "argv", ["treadlink", *line.format(name="n" * 260).split()])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (1, 2)
    assert "nnnn" in capsys.readouterr().err
