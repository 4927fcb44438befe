"""What a recording was made of: the test's name, driver, tires, comment and tags; and notes added afterwards.

The description is an entry of the session's metadata. Notes are lines of JSON in a file beside the recording, so that
its bytes, and with them its identity, stay as they were.
"""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final, NamedTuple

from gateway.core.bounded_input import read_bounded
from gateway.core.errors import RecordingError
from gateway.core.nearest_name import did_you_mean
from gateway.core.recording.regular_file import open_regular
from gateway.core.storable_text import storable

MAX_TEXT_CHARS: Final = 2000
"""Largest number of characters of a text of a description."""
NOTES_SUFFIX: Final = ".notes.jsonl"
_MAX_NOTES_BYTES: Final = 4 << 20


@dataclass(frozen=True, slots=True)
class TireIdentity:
    """A tire as its sidewall and its user state it.

    Attributes:
        maker: maker and model.
        dot: DOT code, or the part of it that is stated.
        wear_m: tread worn off since it was new, None when not stated.
        run_in_m: distance driven before, None when not stated.
    """

    maker: str = ""
    dot: str = ""
    wear_m: float | None = None
    run_in_m: float | None = None


@dataclass(frozen=True, slots=True)
class RunDescription:
    """Description of a test run; what is not stated is empty.

    Attributes:
        test: name of the test.
        driver: who drove.
        comment: free text; later comments are further lines.
        tags: words to select by.
        tires: stated tires by position.
    """

    test: str = ""
    driver: str = ""
    comment: str = ""
    tags: tuple[str, ...] = ()
    tires: Mapping[str, TireIdentity] = field(default_factory=dict)

    def __bool__(self) -> bool:
        """Return whether anything is stated."""
        return self != NO_DESCRIPTION

    def overridden_by(self, other: RunDescription) -> RunDescription:
        """Return this description with what `other` states instead; tags and tires are those of both."""
        no_identity = TireIdentity()
        return RunDescription(
            other.test or self.test,
            other.driver or self.driver,
            other.comment or self.comment,
            tuple(dict.fromkeys((*self.tags, *other.tags))),
            {
                position: _merged(self.tires.get(position, no_identity), other.tires.get(position, no_identity))
                for position in dict.fromkeys((*self.tires, *other.tires))
            },
        )

    def with_notes(self, notes: tuple[Note, ...]) -> RunDescription:
        """Return this description with comments and tags that were added afterwards."""
        comments = dict.fromkeys((*self.comment.splitlines(), *(note.comment for note in notes)))
        tags = dict.fromkeys((*self.tags, *(tag for note in notes for tag in note.tags)))
        return replace(self, comment="\n".join(filter(None, comments)), tags=tuple(tags))

    def lines(self) -> list[str]:
        """Return what is stated as lines `what: value`, for people."""
        comments = [f"comment: {line}" for line in self.comment.splitlines()]
        plain = [("test", self.test), ("driver", self.driver), ("tags", ", ".join(self.tags))]
        tires = []
        for position, tire in self.tires.items():
            parts = [tire.maker, f"DOT {tire.dot}" if tire.dot else ""]
            parts.append("" if tire.wear_m is None else f"worn {tire.wear_m * 1e3:g} mm")
            parts.append("" if tire.run_in_m is None else f"run in {tire.run_in_m * 1e-3:g} km")
            tires.append(f"tire {position}: {', '.join(filter(None, parts))}")
        return [*(f"{label}: {value}" for label, value in plain if value), *tires, *comments]

    def to_json(self) -> str:
        """Return the description as JSON, without what is not stated."""
        return storable(json.dumps(self.as_dict(), ensure_ascii=False, sort_keys=True))

    def as_dict(self) -> dict[str, Any]:
        """Return what is stated as plain values in SI units."""
        plain = {"test": self.test, "driver": self.driver, "comment": self.comment, "tags": list(self.tags)}
        tires = {
            position: {name: value for name, value in _items(tire) if value not in ("", None)}
            for position, tire in self.tires.items()
        }
        return {name: value for name, value in {**plain, "tires": tires}.items() if value}


NO_DESCRIPTION: Final = RunDescription()


class Note(NamedTuple):
    """A line added to a recording afterwards: its time in UTC, a comment and tags."""

    utc: str
    comment: str
    tags: tuple[str, ...] = ()


def parse_description(text: str) -> RunDescription:
    """Return the description in a recording's metadata; what is damaged or of a later version is left out."""
    try:
        entries = json.loads(text)
    except (ValueError, RecursionError):
        return RunDescription()
    if not isinstance(entries, dict):
        return RunDescription()
    tires = entries.get("tires")
    return RunDescription(
        test=_text(entries.get("test")),
        driver=_text(entries.get("driver")),
        comment=_text(entries.get("comment")),
        tags=_tags(entries.get("tags")),
        tires={
            str(position): TireIdentity(
                _text(tire.get("maker")), _text(tire.get("dot")), _number(tire, "wear_m"), _number(tire, "run_in_m")
            )
            for position, tire in (tires.items() if isinstance(tires, dict) else ())
            if isinstance(tire, dict)
        },
    )


def notes_path(recording: Path) -> Path:
    """Return the file of a recording's notes."""
    return recording.with_name(recording.name + NOTES_SUFFIX)


def read_notes(recording: Path) -> tuple[Note, ...]:
    """Return the notes beside a recording, none without a file of notes.

    Raises:
        RecordingError: the file cannot be read, or a line is no note.
    """
    path = notes_path(recording)
    try:
        data = read_bounded(path, _MAX_NOTES_BYTES)
        lines = data[: data.rfind(b"\n") + 1 or None].decode().split("\n")
    except FileNotFoundError:
        return ()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"the notes '{path}' cannot be read: {error}", "Correct or remove the file.") from error
    notes = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            entries = json.loads(line)
            notes.append(Note(str(entries["utc"]), _text(entries.get("comment")), _tags(entries.get("tags"))))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise RecordingError(f"line {number} of '{path}' is no note", "Correct or remove the line.") from error
    return tuple(notes)


def add_note(recording: Path, note: Note) -> None:
    """Add a note to a recording. Half a line, which a killed command has left at the end, is removed.

    Raises:
        RecordingError: the notes cannot be written.
    """
    path = notes_path(recording)
    try:
        with path.open("a+b") as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - _MAX_NOTES_BYTES))
            last = file.read().rpartition(b"\n")[2]
            if last and _is_json(last):  # an editor has left out the end of the line
                file.write(b"\n")
            elif last:
                file.truncate(file.tell() - len(last))
            file.write(_line(note))
    except OSError as error:
        raise _not_written(path, error) from error


def _is_json(line: bytes) -> bool:
    try:
        json.loads(line)
    except (ValueError, RecursionError):
        return False
    return True


def copy_notes(recording: Path, copy: Path) -> None:
    """Give the copy of a recording its notes, all or none of them, before the copy appears under its name.

    Raises:
        RecordingError: they cannot be read or written.
    """
    source, target = notes_path(recording), notes_path(copy)
    if target.exists():
        return
    part = target.with_name(f"{target.name}.part")
    try:
        with open_regular(source) as notes:
            part.unlink(missing_ok=True)
            with part.open("xb") as file:
                shutil.copyfileobj(notes, file)
        part.replace(target)
    except FileNotFoundError:
        return
    except OSError as error:
        raise _not_written(target, error) from error
    finally:
        part.unlink(missing_ok=True)


def _line(note: Note) -> bytes:
    entries = {"utc": note.utc, "comment": note.comment, "tags": list(note.tags)}
    return storable(json.dumps(entries, ensure_ascii=False)).encode() + b"\n"


def _not_written(path: Path, error: OSError) -> RecordingError:
    return RecordingError(
        f"the note cannot be written to '{path}': {error.strerror}", "Check the folder's permissions and space."
    )


# Key of a tire in options and forms -> field, and factor to SI with the largest value; None for a text.
TIRE_KEYS: Final[Mapping[str, tuple[str, float | None, float]]] = {
    "maker": ("maker", None, 0.0),
    "dot": ("dot", None, 0.0),
    "wear_mm": ("wear_m", 1e-3, 60.0),
    "run_in_km": ("run_in_m", 1e3, 1e6),
}


def parse_tire(text: str) -> tuple[str, TireIdentity]:
    """Return position and tire of `FL:maker=Acme,dot=3524,wear_mm=1.5,run_in_km=300`.

    Raises:
        ValueError: it is none; the text says why.
    """
    position, colon, entries = text.partition(":")
    if not colon or not position.strip():
        raise ValueError(f"'{text}' is not POSITION:KEY=VALUE. Give for example FL:maker=Acme,dot=3524.")
    values: dict[str, Any] = {}
    for entry in entries.split(","):
        key, equals, value = (part.strip() for part in entry.partition("="))
        if key not in TIRE_KEYS or not value:
            fault = f"a tire has no key '{key}'" if equals and value else f"'{entry}' is not KEY=VALUE"
            raise ValueError(f"{fault}. {did_you_mean(key, TIRE_KEYS)}Keys: {', '.join(TIRE_KEYS)}.")
        name, factor, largest = TIRE_KEYS[key]
        values[name] = value[:MAX_TEXT_CHARS] if factor is None else _tire_number(entry, value, largest) * factor
    return position.strip(), TireIdentity(**values)


def _tire_number(entry: str, text: str, largest: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= largest:
        raise ValueError(f"'{entry}' is no number from 0 to {largest:g}.")
    return value


def form_of(run: RunDescription) -> dict[str, str]:
    """Return the fields of a form with what is stated of a run; tires are added to those stated."""
    comment = " ".join(run.comment.split())
    return {"test": run.test, "driver": run.driver, "tire": "", "comment": comment, "tags": ", ".join(run.tags)}


def filled_in(run: RunDescription, fields: Mapping[str, str]) -> RunDescription:
    """Return a description with what a form says instead; fields that it lacks stay, its tires are added.

    Raises:
        RecordingError: a tire is wrong.
    """
    values: dict[str, Any] = {
        name: fields[name].strip()[:MAX_TEXT_CHARS] for name in ("test", "driver", "comment") if name in fields
    }
    if "tags" in fields:
        values["tags"] = tuple(dict.fromkeys(tag for part in fields["tags"].split(",") if (tag := _text(part.strip()))))
    run = replace(run, **values)
    for text in filter(None, (part.strip() for part in fields.get("tire", "").split(";"))):
        try:
            position, tire = parse_tire(text)
        except ValueError as error:
            raise RecordingError(f"tire: {error}") from error
        if tire.wear_m is not None:
            raise RecordingError(
                "the wear of a tire changes estimates that have begun", "Give it with --tire, or in the vehicle file."
            )
        run = run.overridden_by(RunDescription(tires={position: tire}))
    return run


class RunFilter(NamedTuple):
    """Conditions that a run must all meet: pairs of a key of KEYS and a pattern with `*` and `?`."""

    conditions: tuple[tuple[str, str], ...] = ()

    def matches(self, run: RunDescription, position: str | None = None) -> bool:
        """Return whether a run meets the conditions, with the tire at `position`, or any of its tires."""
        tires = [tire for wheel, tire in run.tires.items() if position in (None, wheel)]
        return all(
            any(fnmatchcase(value.casefold(), pattern.casefold()) for value in KEYS[key](run, tires))
            for key, pattern in self.conditions
        )

    def __str__(self) -> str:
        """Return the conditions as they are given on a command line."""
        return " ".join(f"{key}={pattern}" for key, pattern in self.conditions)


KEYS: Final[Mapping[str, Callable[[RunDescription, list[TireIdentity]], tuple[str, ...]]]] = {
    "test": lambda run, _: (run.test,),
    "driver": lambda run, _: (run.driver,),
    "tag": lambda run, _: run.tags or ("",),
    "comment": lambda run, _: tuple(run.comment.splitlines()) or ("",),
    "maker": lambda _, tires: tuple(tire.maker for tire in tires) or ("",),
    "dot": lambda _, tires: tuple(tire.dot for tire in tires) or ("",),
}
"""What runs are selected by: the values of a run and of its tires that a pattern is compared with."""


EVERY_RUN: Final = RunFilter()


def _merged(tire: TireIdentity, override: TireIdentity) -> TireIdentity:
    return replace(tire, **{name: value for name, value in _items(override) if value not in ("", None)})


def _items(tire: TireIdentity) -> list[tuple[str, Any]]:
    return [(entry.name, getattr(tire, entry.name)) for entry in fields(tire)]


def _text(value: object) -> str:
    return value[:MAX_TEXT_CHARS] if isinstance(value, str) else ""


def _tags(value: object) -> tuple[str, ...]:
    return tuple(_text(tag) for tag in value if _text(tag)) if isinstance(value, list) else ()


def _number(entries: Mapping[str, Any], name: str) -> float | None:
    value = entries.get(name)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
