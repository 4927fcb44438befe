"""Descriptions of runs: in the metadata, with notes beside the recording, and as conditions to select by."""

import json
import shutil
from pathlib import Path
from unittest.mock import Mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.errors import RecordingError
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.run_description import (
    NO_DESCRIPTION,
    Note,
    RunDescription,
    RunFilter,
    TireIdentity,
    add_note,
    copy_notes,
    notes_path,
    parse_description,
    read_notes,
)
from gateway.core.recording.writer import RecordingWriter

_TEXT = st.text(st.characters(blacklist_categories=("Cs",)), max_size=30)
_LENGTH = st.none() | st.floats(0.0, 1e6)
_TIRE = st.builds(TireIdentity, _TEXT, _TEXT, _LENGTH, _LENGTH)
_RUN = st.builds(
    RunDescription,
    _TEXT,
    _TEXT,
    _TEXT,
    st.lists(_TEXT.filter(bool), unique=True).map(tuple),
    st.dictionaries(st.sampled_from(["FL", "FR"]), _TIRE.filter(lambda tire: tire != TireIdentity())),
)
WET = RunDescription("Braking 3", "Ada", "gusts", ("wet", "abs"), {"FL": TireIdentity("Acme", "3524")})


def test_notes_with_other_line_separators_are_read(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    notes = tuple(Note("2026-01-01T00:00:00.000Z", f"dry{separator}wet") for separator in "\u2028\u2029\x85\r\n")
    for note in notes:
        add_note(path, note)
    file = notes_path(path)
    file.write_bytes(file.read_bytes().replace(b"\n", b"\r\n"))  # as an editor of Windows leaves them
    assert read_notes(path) == notes


@given(st.integers(0, 60))
def test_a_note_after_half_a_note_is_read(tmp_path_factory: pytest.TempPathFactory, cut: int) -> None:
    path = tmp_path_factory.mktemp("notes") / "drive.mcap"
    add_note(path, first := Note("2026-01-01T00:00:00.000Z", "rain", ()))
    add_note(path, Note("2026-01-01T00:01:00.000Z", "half of it is written"))
    file = notes_path(path)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) - 1 - cut])
    add_note(path, last := Note("2026-01-01T00:02:00.000Z", "sun"))
    notes = read_notes(path)
    assert (notes[0], notes[-1]) == (first, last)
    assert len(notes) == (3 if cut == 0 else 2)  # without its newline alone a note is whole


@given(_RUN)
def test_description_reads_back(run: RunDescription) -> None:
    assert parse_description(run.to_json()) == run


def test_text_that_utf8_cannot_encode_reads_back(tmp_path: Path) -> None:
    path, run = tmp_path / "drive.mcap", RunDescription(comment="M\udcfcller", tags=("\ud83d",))
    note = Note("2026-01-01T00:00:00.000Z", "M\udcfcller", ("\ud83d",))
    RecordingWriter(path, start_ns=0, run=run).close()
    add_note(path, note)
    assert RecordingReader(path).info.run == run
    assert read_notes(path) == (note,)


@given(st.text() | st.recursive(st.none() | st.integers(), lambda inner: st.dictionaries(_TEXT, inner)).map(json.dumps))
def test_what_is_no_description_is_empty_or_read(text: str) -> None:
    assert isinstance(parse_description(text), RunDescription)


def test_damaged_fields_are_left_out() -> None:
    text = json.dumps({"test": 3, "driver": "Ada", "tags": ["a", 1], "tires": {"FL": {"wear_m": "x"}, "FR": 2}})
    assert parse_description(text) == RunDescription(driver="Ada", tags=("a",), tires={"FL": TireIdentity()})


def test_a_note_leaves_the_recording_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    RecordingWriter(path, start_ns=0, run=WET).close()
    before = path.read_bytes()
    add_note(path, Note("2026-01-01T00:00:00.000Z", "rain", ("rain", "wet")))
    add_note(path, Note("2026-01-01T00:01:00.000Z", "dry again"))
    info = RecordingReader(path).info
    assert path.read_bytes() == before
    assert info.run == WET
    described = info.described_run()
    assert described.comment.splitlines() == ["gusts", "rain", "dry again"]
    assert described.tags == ("wet", "abs", "rain")


def test_notes_that_are_not_copied_whole_leave_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    add_note(tmp_path / "drive.mcap", Note("2026-01-01T00:00:00.000Z", "rain"))
    before = list(tmp_path.iterdir())
    for error, raised in ((OSError(28, "no space"), RecordingError), (KeyboardInterrupt(), KeyboardInterrupt)):
        monkeypatch.setattr(shutil, "copyfileobj", Mock(side_effect=error))
        with pytest.raises(raised):
            copy_notes(tmp_path / "drive.mcap", tmp_path / "copy.mcap")
        assert list(tmp_path.iterdir()) == before


@pytest.mark.parametrize("line", [b"{}\n", b"no json\n", b"[1]\n", b'{"utc": \xff}\n'])
def test_a_damaged_note_is_named(tmp_path: Path, line: bytes) -> None:
    notes_path(tmp_path / "drive.mcap").write_bytes(b'{"utc": "2026", "comment": "a"}\n' + line)
    with pytest.raises(RecordingError, match=r"notes\.jsonl") as error:
        read_notes(tmp_path / "drive.mcap")
    assert error.value.remedy


@pytest.mark.parametrize(
    ("conditions", "position", "fits"),
    [
        ((), None, True),
        ((("test", "braking*"),), None, True),
        ((("test", "braking"),), None, False),
        ((("tag", "abs"), ("driver", "ada")), None, True),
        ((("tag", "dry"),), None, False),
        ((("maker", "acme"),), None, True),
        ((("maker", "acme"),), "FL", True),
        ((("maker", "acme"),), "FR", False),
        ((("maker", ""),), "FR", True),
        ((("comment", "*ust*"), ("dot", "3?24")), "FL", True),
    ],
)
def test_conditions_select_runs(conditions: tuple[tuple[str, str], ...], position: str | None, fits: bool) -> None:
    assert RunFilter(conditions).matches(WET, position) is fits


def test_no_condition_with_a_value_fits_what_is_not_described() -> None:
    assert not RunFilter((("tag", "wet"),)).matches(NO_DESCRIPTION)
    assert RunFilter((("tag", ""),)).matches(NO_DESCRIPTION)
