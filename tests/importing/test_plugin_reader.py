"""A reader of a plug-in can spoil its own import only, and says how."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gateway.errors import ImportDataError
from gateway.importing import file_formats
from gateway.importing.columns import Block, FileFacts, row_places
from gateway.importing.import_map import parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from tests.importing.measurements import simple_map

ROWS = np.random.default_rng(0).normal(size=(4000, 3))


class Sound:
    """A reader that works."""

    facts = FileFacts(("x", "y", "z"))

    def __init__(self, path: Path) -> None:
        pass

    def values(self, names):
        return ROWS[:, : len(names)]

    def blocks(self, names):
        yield Block(0, self.values(names), row_places(0), 1.0)

    def sample(self, names):
        return next(iter(self.blocks(names)))

    def close(self) -> None:
        pass


def raising(error: BaseException) -> Callable[..., None]:
    def fail(*_: object) -> None:
        raise error

    return fail


FAULTS: dict[str, dict[str, object]] = {
    "opening": {"__init__": raising(ValueError("x" * 100_000))},
    "ends the program": {"__init__": raising(SystemExit(0))},
    "facts raise": {"facts": property(raising(ZeroDivisionError()))},
    "facts are none": {"facts": None},
    "blocks raise": {"blocks": raising(RuntimeError("b"))},
    "reading ends the program": {"values": raising(SystemExit(0))},
    "no blocks": {"blocks": lambda _self, _names: None},
    "numbers for blocks": {"blocks": lambda _self, _names: iter([3])},
    "another number of columns": {"values": lambda _self, _names: ROWS[:, :1]},
    "one dimension": {"values": lambda _self, _names: ROWS[:, 0]},
    "texts": {"values": lambda _self, names: np.full((9, len(names)), "x")},
    "complex": {"values": lambda _self, names: ROWS[:, : len(names)] * 1j},
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_of_a_reader_is_a_message(fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reader = type("Faulty", (Sound,), FAULTS[fault])
    monkeypatch.setattr(file_formats, "load", lambda *_: reader)
    (tmp_path / "run.evil").write_bytes(b"1")
    with pytest.raises(ImportDataError, match=r"run\.evil cannot be read") as caught:
        import_file(tmp_path / "run.evil", parse_map(simple_map(), "map"), tmp_path / "out.mcap")
    assert "plug-in" in caught.value.remedy
    assert len(str(caught.value)) < 3000
    assert [path.name for path in tmp_path.iterdir()] == ["run.evil"]


@pytest.mark.parametrize("changes", [{}, {"close": raising(RuntimeError("c"))}], ids=["sound", "close fails"])
def test_sound_reader_is_used(changes: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(file_formats, "load", lambda *_: type("Reader", (Sound,), changes))
    (tmp_path / "run.evil").write_bytes(b"1")
    report = import_file(tmp_path / "run.evil", parse_map(simple_map(), "map"), tmp_path / "out.mcap")
    assert report.samples == len(ROWS)
    assert "rate_hz" in guess_map(tmp_path / "run.evil")
