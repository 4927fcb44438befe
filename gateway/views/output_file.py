"""Files that commands write: checked before the work, and a report is written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from gateway.errors import OutputError


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[Path | None], *, force: bool = False) -> None:
    """Fail now, before minutes of work, where an output cannot be written or would cost a file that is read.

    Every command that can overwrite asks this first. None stands for what was not given.

    Raises:
        OutputError: as `check_target`; an output is an input, whatever `force` says; two outputs are one file.
    """
    read = [path for path in inputs if path is not None]
    seen: list[Path] = []
    for path in outputs:
        if path is None:
            continue
        if any(_same_file(path, other) for other in read):
            raise OutputError(
                f"'{path}' is one of the files that are read, and would be lost",
                "Choose another name; --force does not overwrite what is read either.",
            )
        if any(_same_file(path, other) for other in seen):
            raise OutputError(f"two outputs would be written to one file, '{path}'", "Give each a name of its own.")
        check_target(path, force=force)
        seen.append(path)


def _same_file(path: Path, other: Path) -> bool:
    """Return whether two paths lead to one file, be it through links; devices and pipes hold nothing to lose."""
    try:
        if path.exists() and not path.is_file():
            return False
        return os.path.realpath(path) == os.path.realpath(other) or (
            path.exists() and other.exists() and path.samefile(other)
        )
    except OSError:
        return False  # what cannot be looked at is told where it is opened


def check_target(path: Path, *, force: bool = False) -> None:
    """Fail now, before minutes of work, where `write_whole` is going to.

    Raises:
        OutputError: the file exists and `force` is not set, or its folder is not there or cannot be written.
    """
    try:
        _check(path, force=force)
    except OSError as error:
        raise OutputError(f"'{path}' cannot be written: {error.strerror}", "Choose another name.") from error


def _check(path: Path, *, force: bool) -> None:
    if path.is_dir():
        raise OutputError(f"'{path}' is a folder", "Name a file in it.")
    if path.exists() and not path.is_file():
        return  # a device or a pipe
    if path.exists() and not force:
        raise OutputError(f"'{path}' exists already", "Choose another name, or overwrite it with --force.")
    folder = path.resolve().parent
    if not folder.is_dir():
        raise OutputError(f"'{path}' cannot be written: there is no folder '{folder}'", f"Make it: mkdir -p '{folder}'")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(
            f"'{path}' cannot be written: the folder '{folder}' is read-only",
            "Check its permissions, or choose another.",
        )


def write_whole(path: Path, text: str, *, force: bool = False) -> None:
    """Write a text file in UTF-8; whatever happens, the file is the old one or the new one, whole.

    Raises:
        OutputError: as `check_target`, or the disk refuses.
    """
    check_target(path, force=force)
    data = text.encode("utf-8", "backslashreplace")
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(data)
            return
        target = path.resolve()  # a link stays a link
        part = target.with_name(f".treadlink-{os.getpid()}.part")
        try:
            part.unlink(missing_ok=True)
            with part.open("xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            part.replace(target)
        except BaseException:
            with suppress(OSError):
                part.unlink()
            raise
    except OSError as error:
        raise OutputError(
            f"'{path}' cannot be written: {error.strerror}", "Free some space, or choose another folder."
        ) from error
