"""Dataset of a campaign on disk: files named by content, added and replaced as a whole.

    DATASET/
      treadlink-dataset.json                                    settings that all rows share
      recordings/vehicle=NAME/day=2026-01-31/KEY.parquet        one row per recording and wheel
      revolutions/vehicle=NAME/day=2026-01-31/KEY.parquet       one row per revolution that is kept
      diagnoses/vehicle=NAME/day=2026-01-31/KEY.parquet         one row per effect and tire
      failures/KEY.parquet                                      one row per recording without results
      .incoming/                                                parts that are being written

KEY is PATH-CONTENT-SETTINGS: identities of the file's path, its content, and the settings with the estimators' version.
One process at a time changes a dataset. A recording is there when its file in `recordings` is. The old file is removed
before the new one appears, so that a crash leaves no recording twice; what it loses is estimated again.
"""

import json
import os
import re
import socket
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, Self
from urllib.parse import quote

import numpy as np

from gateway import __version__
from gateway.core.bounded_input import read_bounded
from gateway.core.errors import OutputError
from gateway.core.nearest_name import missing_path_remedy
from gateway.core.reasons import Reason
from gateway.core.recording.file_content import FileContent
from gateway.core.storable_text import storable
from gateway.core.table_columns import FAILURE_COLUMNS
from gateway.core.text.output_file import write_whole
from gateway.core.text.wording import as_json, text
from gateway.core.trust.reasons import TrustCode
from gateway.fleet.content_keys import path_key
from gateway.fleet.parquet_parts import FORMAT, PartFile, read_rows
from gateway.fleet.recording_estimation import RECORDINGS, REVOLUTIONS, Failure
from gateway.fleet.trends.trend_result import UNKNOWN_VEHICLE

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

DESCRIPTION: Final = "treadlink-dataset.json"
DIAGNOSES: Final = "diagnoses"
FAILURES: Final = "failures"
INCOMING: Final = ".incoming"
_LOCK: Final = ".lock"
_FINAL, _RETRYABLE = "final", "again"
_OF_WHEELS: Final = ("position", "revolutions", "missing", "alarms", "damage")
_NO_REVOLUTIONS: Final = "none"
_LONGEST_NAME: Final = 80
_MAX_DESCRIPTION_BYTES: Final = 1 << 20
_NULL_PARTITION: Final = "__HIVE_DEFAULT_PARTITION__"


_KEY_NAME: Final = re.compile(rf"(\w+)-(\w+)-(\w+)(?:\.(?:{_FINAL}|{_RETRYABLE}))?\.parquet", re.ASCII)


class Key(NamedTuple):
    """Name of a recording's files, without their end.

    Attributes:
        path: identity of the path.
        recording_id: identity of the content.
        settings: identity of settings and code.
    """

    path: str
    recording_id: str
    settings: str

    def __str__(self) -> str:
        return "-".join(self)

    @classmethod
    def of_name(cls, name: str) -> Self | None:
        """Return the key in the name of a file, None when it is not one, as of a copy such as `KEY (1).parquet`."""
        match = _KEY_NAME.fullmatch(name)
        return cls(*match.groups()) if match else None


@dataclass(frozen=True, slots=True)
class RecordedWheel:
    """What the rows of a recording say of one of its wheels.

    Attributes:
        position: of the wheel.
        missing: why it has no revolution; empty where it has.
        alarms: names of its alarms.
        is_damaged: whether a part of the recording could not be read.
    """

    position: str
    missing: str
    alarms: tuple[str, ...]
    is_damaged: bool


@dataclass(frozen=True, slots=True)
class Description:
    """Settings that all rows of a dataset share.

    Attributes:
        estimators: names of the estimators.
        estimates: names of the estimates that have columns.
        rows: revolutions that are kept.
    """

    estimators: tuple[str, ...]
    estimates: tuple[str, ...]
    rows: str


class Dataset:
    """A dataset that this process may change; `opened` makes one.

    Attributes:
        root: its folder.
        description: of its rows.
        incoming: folder for parts that are being written.
    """

    def __init__(self, root: Path, description: Description) -> None:
        self.root = root
        self.description = description
        self.incoming = root.resolve() / INCOMING  # workers have other working folders
        self._done: dict[str, Key] = {}
        self._of_path: dict[str, set[str]] = {}
        self._failed: dict[str, tuple[Key, bool]] = {}
        self._places: dict[tuple[str, Key], Path] = {}
        self._scan_tables()

    def done(self, recording_id: str, settings: str) -> bool:
        """Return whether a content has its rows under these settings."""
        key = self._done.get(recording_id)
        return key is not None and key.settings == settings

    def wheels(self, recording_id: str) -> tuple[RecordedWheel, ...] | None:
        """Return what the rows of a content say of its wheels; None where a file of it is missing or damaged."""
        key = self._done[recording_id]
        path = self._places.get((RECORDINGS, key))
        rows = read_rows(path, _OF_WHEELS) if path is not None else None
        if rows is None:
            return None
        if self.description.rows != _NO_REVOLUTIONS and any(row["revolutions"] for row in rows):
            revolutions_path = self._places.get((REVOLUTIONS, key))
            if revolutions_path is None or not _is_readable(revolutions_path):
                return None
        return tuple(_recorded_wheel(row) for row in rows)

    def failed(self, content: FileContent, settings: str) -> bool:
        """Return whether a content has failed under these settings for a reason that lasts."""
        failure = self._failed.get(path_key(content.path))
        return failure is not None and failure[1] and failure[0][1:] == (content.recording_id, settings)

    def replaced_by(self, content: FileContent) -> frozenset[str]:
        """Return the other contents that the file at this path has had; a new one replaces their rows."""
        return frozenset(self._of_path.get(path_key(content.path), set()) - {content.recording_id})

    def keep(self, content: FileContent) -> None:
        """Note that a content with rows is found at another path, so that a change of the first does not remove it."""
        old = self._done[content.recording_id]
        content_path = path_key(content.path)
        if old.path == content_path:
            return
        new = old._replace(path=content_path)
        with _explained(self.root):
            for table in (REVOLUTIONS, RECORDINGS):
                for path in self._files(table, old):
                    self._places[table, new] = path.replace(path.with_name(f"{new}.parquet"))
        self._forget(old)
        self._remember(new)

    def follow(self, content: FileContent, copy_keys: Collection[str]) -> None:
        """Note the path at which a content was found, unless its old one is, by its identity, that of a copy."""
        key = self._done.get(content.recording_id)
        if key is not None and key.path not in copy_keys:
            self.keep(content)

    def commit(
        self, content: FileContent, settings: str, parts: Mapping[str, Path], vehicle: str, start_ns: int
    ) -> None:
        """Give the finished parts of a recording their place, instead of all that they replace.

        Args:
            content: the recording.
            settings: identity of the settings.
            parts: file of each table, in `incoming`.
            vehicle: name, empty when unknown.
            start_ns: start of the recording, which decides about its day (UTC).

        Raises:
            OutputError: the disk refuses, or a part is elsewhere; the recording is then not in the dataset.
        """
        foreign = [part for part in parts.values() if part.parent != self.incoming]
        if foreign:
            raise OutputError(f"a worker names '{foreign[0]}' as its part", "Use a scheduler and workers of your own.")
        key = Key(path_key(content.path), content.recording_id, settings)
        with _explained(self.root):
            for old in (self._done.get(identity) for identity in (content.recording_id, *self.replaced_by(content))):
                if old is not None:
                    self._remove(old)
            self.clear_failure(content)
            # The file of the recordings is the last: what is without it does not count, and is removed.
            for table in (REVOLUTIONS, RECORDINGS):
                if table in parts:
                    self._places[table, key] = self._move_part(parts[table], table, vehicle, start_ns, f"{key}.parquet")
        self._remember(key)

    def fail(self, path: Path, content: FileContent | None, settings: str, failure: Failure, now_ns: int) -> None:
        """Add or replace the failure of a recording, and remove the rows of what the file was before.

        Raises:
            OutputError: the disk refuses.
        """
        recording_id = content.recording_id if content is not None else path_key(path)
        key = Key(path_key(path), recording_id, settings)
        if content is not None:
            with _explained(self.root):
                for old in (self._done.get(identity) for identity in self.replaced_by(content)):
                    if old is not None:
                        self._remove(old)
        self._drop_failure(key.path)
        folder = self.root / FAILURES
        with _explained(self.root):
            folder.mkdir(exist_ok=True)
        reason = failure.reason
        target = folder / f"{key}.{_FINAL if failure.is_final else _RETRYABLE}.parquet"
        with PartFile(target, FAILURE_COLUMNS, FAILURES) as part:
            part.row(
                {
                    "recording_id": content.recording_id if content is not None else None,
                    "recording": storable(path.name),
                    "path": storable(str(path)),
                    "code": str(reason.code),
                    "text": text(reason),
                    "values": json.dumps(as_json(reason)["values"], ensure_ascii=False),
                    "remedy": failure.remedy,
                    "attempts": failure.attempts,
                    "is_final": failure.is_final,
                    "failed_utc": now_ns,
                    "size_bytes": content.size_bytes if content is not None else None,
                    "version": __version__,
                }
            )
        self._failed[key.path] = key, failure.is_final

    def clear_failure(self, content: FileContent) -> None:
        """Remove the failure of a path, and those of the same content at others, as after it was estimated."""
        content_path = path_key(content.path)
        for path, (key, _) in list(self._failed.items()):
            if path == content_path or key.recording_id == content.recording_id:
                self._drop_failure(path)

    def replace_files(self, table: str, parts: Sequence[tuple[Path, str, int, str]], old: Sequence[Path]) -> None:
        """Give (part, vehicle, time in ns, name) their places in another table, instead of old files.

        Raises:
            OutputError: the disk refuses.
        """
        with _explained(self.root):
            for path in old:
                path.unlink(missing_ok=True)
            for part, vehicle, start_ns, name in parts:
                self._move_part(part, table, vehicle, start_ns, name)

    def _move_part(self, part: Path, table: str, vehicle: str, start_ns: int, name: str) -> Path:
        folder = self.root / table / partition(vehicle, start_ns)
        folder.mkdir(parents=True, exist_ok=True)
        return part.replace(folder / name)

    def clear_incoming(self) -> None:
        """Remove parts that no campaign writes any more."""
        with suppress(OSError):
            for path in self.incoming.iterdir():
                path.unlink(missing_ok=True)

    def _scan_tables(self) -> None:
        """Find what is done, and remove what a killed campaign has left unfinished."""
        with _explained(self.root):
            self.incoming.mkdir(exist_ok=True)
            self.clear_incoming()
            for path in sorted((self.root / RECORDINGS).rglob("*.parquet")):
                key = Key.of_name(path.name)
                if key is None:
                    continue
                if key.recording_id in self._done:
                    path.unlink(missing_ok=True)  # two campaigns without a common lock, or a copied file
                else:
                    self._remember(key)
                    self._places[RECORDINGS, key] = path
            for path in (self.root / REVOLUTIONS).rglob("*.parquet"):
                key = Key.of_name(path.name)
                if key is not None and self._done.get(key.recording_id) != key:
                    path.unlink(missing_ok=True)
                elif key is not None:
                    self._places[REVOLUTIONS, key] = path
            for path in sorted((self.root / FAILURES).glob("*.parquet")):
                key = Key.of_name(path.name)
                if key is None:
                    continue
                if key.path in self._failed or self.done(key.recording_id, key.settings):
                    path.unlink(missing_ok=True)
                else:
                    self._failed[key.path] = key, path.name.split(".")[1] == _FINAL

    def _files(self, table: str, key: Key) -> Iterator[Path]:
        return (self.root / table).glob(f"*/*/{key}.parquet")

    def _remember(self, key: Key) -> None:
        self._done[key.recording_id] = key
        self._of_path.setdefault(key.path, set()).add(key.recording_id)

    def _forget(self, key: Key) -> None:
        self._done.pop(key.recording_id, None)
        for table in (RECORDINGS, REVOLUTIONS):
            self._places.pop((table, key), None)
        self._of_path.get(key.path, set()).discard(key.recording_id)

    def _remove(self, key: Key) -> None:
        for table in (RECORDINGS, REVOLUTIONS):
            for path in self._files(table, key):
                path.unlink(missing_ok=True)
        self._forget(key)

    def _drop_failure(self, path: str) -> None:
        failure = self._failed.pop(path, None)
        if failure is not None:
            for file in (self.root / FAILURES).glob(f"{failure[0]}.*.parquet"):
                file.unlink(missing_ok=True)


def _is_readable(path: Path) -> bool:
    """Return whether the footer of a Parquet file can be read."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        pq.read_metadata(path)
    except (OSError, ValueError, pa.ArrowException):
        return False
    return True


def _recorded_wheel(row: Mapping[str, Any]) -> RecordedWheel:
    missing = ""
    if not row["revolutions"]:
        missing = json.loads(row["missing"])["text"] if row["missing"] else text(Reason(TrustCode.NO_REVOLUTION_YET))
    alarms = json.loads(row["alarms"] or "[]")
    names = tuple(str(alarm["name"]) for alarm in alarms)
    return RecordedWheel(str(row["position"]), missing, names, bool(row["damage"]))


@contextmanager
def opened(root: Path, description: Description, waiting: Callable[[str], bool]) -> Iterator[Dataset]:
    """Make or open a dataset, for this process alone.

    Args:
        root: its folder; a missing one is made.
        description: wanted; an existing dataset must have the same.
        waiting: called every 0.2 s, with a text about the process, while another process has the dataset; it waits, and
            returns whether to go on waiting.

    Raises:
        OutputError: the folder is not a dataset, has other settings, or cannot be written.
        TimeoutError: `waiting` has returned False.
    """
    with _explained(root):
        if root.is_dir() and not (root / DESCRIPTION).is_file():
            # What a process leaves that is killed while it makes the dataset.
            unfinished = f".{DESCRIPTION}."
            others = [
                entry.name
                for entry in root.iterdir()
                if entry.name not in (_LOCK, INCOMING) and not entry.name.startswith(unfinished)
            ]
            if others:
                raise OutputError(
                    f"'{root}' is not a dataset, but contains files such as '{sorted(others)[0]}'",
                    "Choose a new or an empty folder.",
                )
        root.mkdir(parents=True, exist_ok=True)
    with _locked(root, waiting):
        path = root / DESCRIPTION
        if path.is_file():
            present = read_description(root)
            if present != description:
                raise _difference(root, present, description)
        else:
            entries = {"treadlink": __version__, "format": FORMAT, "time_zone": "UTC"}
            entries |= asdict(description)
            write_whole(path, json.dumps(entries, indent=2, ensure_ascii=False) + "\n", force=True)
        dataset = Dataset(root, description)
        try:
            yield dataset
        finally:
            dataset.clear_incoming()
            with suppress(OSError):
                dataset.incoming.rmdir()


def read_description(root: Path) -> Description:
    """Return the settings of a dataset.

    Raises:
        OutputError: there is no dataset, or its description is not one.
    """
    path = root / DESCRIPTION
    try:
        entries = json.loads(read_bounded(path, _MAX_DESCRIPTION_BYTES))
        return Description(
            tuple(map(str, entries["estimators"])), tuple(map(str, entries["estimates"])), str(entries["rows"])
        )
    except (FileNotFoundError, NotADirectoryError) as error:
        if not root.exists():
            raise OutputError(f"dataset '{root}' does not exist", missing_path_remedy(root)) from error
        fault = f"it has no file {DESCRIPTION}" if root.is_dir() else "it is no folder"
        raise OutputError(
            f"'{root}' is not a dataset: {fault}", "Make one: treadlink campaign PATH... --out DATASET"
        ) from error
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise OutputError(f"'{path}' cannot be read: {error}", "Restore it, or choose a new folder.") from error


def is_identified(vehicle: str, sensor_id: str) -> bool:
    """Return whether recordings of one wheel position are known to be of one tire.

    A sensor stays in its tire, and a vehicle has one tire at a position. Recordings with neither may be of any vehicle.

    Args:
        vehicle: name of the partition.
        sensor_id: empty when it was not sent.
    """
    return bool(sensor_id) or vehicle != UNKNOWN_VEHICLE


def partition_name(vehicle: str) -> str:
    """Return the name of a vehicle in a dataset: a long one is cut, and has a digest of the whole behind it."""
    name = vehicle.strip() or UNKNOWN_VEHICLE
    return name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}~{path_key(Path(name))}"


def partition(vehicle: str, start_ns: int) -> Path:
    """Return `vehicle=NAME/day=YYYY-MM-DD`, NAME as other programs of Parquet read it back, the day in UTC."""
    name = partition_name(vehicle)
    encoded = quote(storable(name), safe=" ")
    if name == _NULL_PARTITION:
        encoded = encoded.replace("_", "%5F", 1)
    day = np.datetime_as_string(np.datetime64(start_ns, "ns"), unit="D")
    return Path(f"vehicle={encoded}") / f"day={day}"


def _difference(root: Path, present: Description, requested: Description) -> OutputError:
    for name, word in (("estimators", "estimators"), ("rows", "kept rows")):
        old, new = getattr(present, name), getattr(requested, name)
        if old != new:
            texts = [", ".join(setting) if isinstance(setting, tuple) else setting for setting in (old, new)]
            return OutputError(
                f"the dataset '{root}' was made with other {word}: {texts[0]}; now: {texts[1]}",
                "Choose a new folder, or the same options.",
            )
    # The estimators are the same, so their code is another: an older or a newer treadlink made the dataset.
    lacking = [name for name in requested.estimates if name not in present.estimates]
    unknown = [name for name in present.estimates if name not in requested.estimates]
    parts = [
        f"{word} {', '.join(names)}"
        for word, names in (("it has no columns for", lacking), ("this version gives no", unknown))
        if names
    ]
    return OutputError(
        f"the dataset '{root}' was made by another version of treadlink, with other columns"
        + (f": {'; '.join(parts)}" if parts else " in another order"),
        "Run the same command with a new folder. Columns cannot be added to a dataset; `treadlink trends` reads it as "
        "it is.",
    )


@contextmanager
def _locked(root: Path, waiting: Callable[[str], bool]) -> Iterator[None]:
    """Hold the dataset's lock, which ends with the process whatever ends it."""
    with _explained(root):
        descriptor = os.open(root / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        while not _try_lock(descriptor):
            holder = os.pread(descriptor, 200, 0).decode("utf-8", "replace") if sys.platform != "win32" else ""
            if not waiting(holder):
                raise TimeoutError
        with suppress(OSError):
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode())
        yield
    finally:
        os.close(descriptor)


def _try_lock(descriptor: int) -> bool:
    try:
        if sys.platform == "win32":
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    return True


@contextmanager
def _explained(root: Path) -> Iterator[None]:
    """Raise OutputError for errors of the system at the dataset."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"the dataset '{root}' cannot be written: {error.strerror or error}",
            "Free some space or check the permissions, then run the same command again.",
        ) from error
