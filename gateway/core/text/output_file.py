"""Output files: checked before the work, written completely or not at all."""

import errno
import os
import re
import shutil
import sys
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from io import BufferedWriter, FileIO
from pathlib import Path
from typing import IO, Final, Self

from gateway.core.errors import OutputError
from gateway.core.writing_lock import is_being_written, lock_for_writing, process_runs

_LONGEST_NAME: Final = 200
_LOCK: Final = "lock"
_UNFINISHED: Final = re.compile(r"\.(?P<name>.+)\.(?P<process>\d{1,9})\.(?P<kind>part|scratch)", re.DOTALL)


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[Path | None], *, force: bool = False) -> None:
    """Fail early, before minutes of work, if an output cannot be written or would overwrite an input.

    Every command that can overwrite files calls this first. None stands for an option that was not given.

    Raises:
        OutputError: as `check_target`; an output is an input, whatever `force` says; two outputs are one file.
    """
    input_paths = [path for path in inputs if path is not None]
    targets: list[Path] = []
    for path in outputs:
        if path is None:
            continue
        if is_stdout(path):
            if any(map(is_stdout, targets)):
                raise OutputError(
                    "two outputs would be written to standard output", "Give '-' once, and a file for the other."
                )
            targets.append(path)
            continue
        if any(_same_file(path, source) for source in input_paths):
            raise OutputError(
                f"'{path}' is an input and would be overwritten",
                "Choose another name; --force does not overwrite inputs.",
            )
        if any(_same_file(path, target) for target in targets):
            raise OutputError(f"two outputs would be written to one file, '{path}'", "Give each a name of its own.")
        check_target(path, force=force)
        targets.append(path)


def is_stdout(path: Path | None) -> bool:
    """Return whether an output is standard output, which is written `-`."""
    return path is not None and str(path) == "-"


def _same_file(path: Path, other_path: Path) -> bool:
    """Return whether two paths lead to one file, directly or through links; False for devices and pipes."""
    try:
        if path.exists() and not path.is_file():
            return False
        return os.path.realpath(path) == os.path.realpath(other_path) or (
            path.exists() and other_path.exists() and path.samefile(other_path)
        )
    except OSError:
        return False  # opening the file reports the error


def check_target(path: Path, *, force: bool = False) -> None:
    """Fail early, before minutes of work, if writing would fail.

    Raises:
        OutputError: the file exists and `force` is not set, or its folder does not exist or cannot be written.
    """
    if is_stdout(path):
        return
    try:
        _check(path, force=force)
    except OSError as error:
        raise OutputError(f"'{path}' cannot be written: {error.strerror}", "Choose another name.") from error


def _check(path: Path, *, force: bool) -> None:
    if path.is_dir():
        raise OutputError(f"'{path}' is a folder", "Give the name of a file.")
    if path.exists() and not path.is_file():
        return  # a device or a pipe
    if path.exists() and not force:
        raise OutputError(f"'{path}' already exists", "Choose another name, or overwrite it with --force.")
    try:
        path.stat()
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OutputError(f"'{path}' is a loop of symbolic links", "Remove it, or choose another name.") from error
    folder = path.resolve().parent
    if not folder.is_dir():
        raise OutputError(
            f"'{path}' cannot be written: there is no folder '{folder}'", f"Create it: mkdir -p '{folder}'"
        )
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(
            f"'{path}' cannot be written: the folder '{folder}' is read-only",
            "Check its permissions, or choose another folder.",
        )


class WholeOutput(ABC):
    """An output that is there when it is complete, or not at all.

    As a context manager it closes, and after an error, of closing too, it discards.
    """

    @abstractmethod
    def close(self) -> None:
        """Finish the output."""

    @abstractmethod
    def discard(self) -> None:
        """Leave everything as it was before."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self.discard()
            return
        try:
            self.close()
        except BaseException:
            self.discard()
            raise


class OutputFile(WholeOutput):
    """A file that appears under its name when it is complete, or not at all.

    It is written under another name in the same folder. Devices, pipes and standard output (`-`) are written directly.

    Attributes:
        path: its name.
        file: binary file to write to; `close` and `discard` close it.
    """

    def __init__(self, path: Path, *, force: bool = False) -> None:
        """Open the file; `force` allows to replace an existing one.

        Raises:
            OutputError: as `check_target`, or the file cannot be created.
        """
        self.path = path
        self.file: IO[bytes]
        self._force = force
        self._part: Path | None = None
        self._is_open = True
        if is_stdout(path):
            self.file = sys.stdout.buffer
            return
        check_target(path, force=force)
        with self.explained():
            if path.exists() and not path.is_file():
                self.file = path.open("wb")
                return
            self._target = path.resolve()  # keeps a symbolic link
            self._part = self._target.with_name(f".{self._target.name[:_LONGEST_NAME]}.{os.getpid()}.part")
            _remove_abandoned(self._target.parent, self._target.name)
            self._part.unlink(missing_ok=True)
            file = FileIO(self._part, "xb")
            lock_for_writing(file)
            self.file = BufferedWriter(file)

    def close(self) -> None:
        """Write the data through to the disk and give the file its name. May be called twice.

        Raises:
            OutputError: the disk refuses, or another program has created the file meanwhile; the old file is unchanged.
        """
        if not self._is_open:
            return
        self._is_open = False
        try:
            with self.explained():
                self.file.flush()
                if self._part is None:
                    if not is_stdout(self.path):
                        self.file.close()
                    return
                os.fsync(self.file.fileno())
                self.file.close()
                if not self._force and self._target.exists():
                    raise FileExistsError(errno.EEXIST, "it was created by another program meanwhile")
                self._part.replace(self._target)
        except BaseException:
            self._remove_part()
            raise

    def discard(self) -> None:
        """Leave everything as it was before, as far as it was not written directly."""
        if self._is_open:
            self._is_open = False
            self._remove_part()

    def _remove_part(self) -> None:
        if is_stdout(self.path):
            return
        with suppress(OSError):
            self.file.close()
        if self._part is not None:
            with suppress(OSError):
                self._part.unlink()

    @contextmanager
    def explained(self) -> Iterator[None]:
        """Raise OutputError for errors of the system while writing to `file`."""
        try:
            yield
        except BrokenPipeError:
            raise  # the reader is gone; no fault of the output
        except OSError as error:
            raise OutputError(
                f"'{self.path}' cannot be written: {error.strerror}", "Free some space, or choose another folder."
            ) from error


@contextmanager
def scratch_folder(target: Path) -> Iterator[Path]:
    """Yield a new folder beside an output, for temporary files on the same disk; it is removed at the end.

    What killed processes have left of it is removed too.
    """
    folder = target.resolve().parent
    _remove_abandoned(folder, target.name)
    scratch = folder / f".{target.name[:_LONGEST_NAME]}.{os.getpid()}.scratch"
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(mode=0o700)
    try:
        with FileIO(scratch / _LOCK, "xb") as lock:
            lock_for_writing(lock)
            yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _remove_abandoned(folder: Path, name: str) -> None:
    """Remove what killed processes have left of an output: their process is gone, and parts are not locked."""
    for path in folder.iterdir():
        match = _UNFINISHED.fullmatch(path.name)
        if match is None or match["name"] != name[:_LONGEST_NAME] or process_runs(int(match["process"])):
            continue
        with suppress(OSError):
            if match["kind"] == "part":
                if not _is_locked(path):
                    path.unlink()
            elif not (path / _LOCK).exists() or not _is_locked(path / _LOCK):
                shutil.rmtree(path)


def _is_locked(path: Path) -> bool:
    """Return whether a process, perhaps of another container or computer, writes a file."""
    # Opened without waiting: somebody may have put a FIFO there.
    with os.fdopen(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
        return is_being_written(file)


def write_whole(path: Path, content: str | bytes, *, force: bool = False) -> None:
    """Write a file atomically, text in UTF-8: after a failure the old file is unchanged. `-` is standard output.

    Raises:
        OutputError: as `check_target`, or the disk refuses.
    """
    data = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    with OutputFile(path, force=force) as output, output.explained():
        output.file.write(data)
