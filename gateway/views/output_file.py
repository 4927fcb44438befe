"""Output files: checked before the work, written completely or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from gateway.errors import OutputError


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[Path | None], *, force: bool = False) -> None:
    """Fail early, before minutes of work, if an output cannot be written or would overwrite an input.

    Every command that can overwrite files calls this first. None stands for an option that was not given.

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
                f"'{path}' is an input and would be overwritten",
                "Choose another name; --force does not overwrite inputs.",
            )
        if any(_same_file(path, other) for other in seen):
            raise OutputError(f"two outputs would be written to one file, '{path}'", "Give each a name of its own.")
        check_target(path, force=force)
        seen.append(path)


def _same_file(path: Path, other: Path) -> bool:
    """Return whether two paths lead to one file, directly or through links; False for devices and pipes."""
    try:
        if path.exists() and not path.is_file():
            return False
        return os.path.realpath(path) == os.path.realpath(other) or (
            path.exists() and other.exists() and path.samefile(other)
        )
    except OSError:
        return False  # opening the file reports the error


def check_target(path: Path, *, force: bool = False) -> None:
    """Fail early, before minutes of work, if `write_whole` would fail.

    Raises:
        OutputError: the file exists and `force` is not set, or its folder does not exist or cannot be written.
    """
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
        raise OutputError(f"'{path}' exists already", "Choose another name, or overwrite it with --force.")
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


def write_whole(path: Path, text: str, *, force: bool = False) -> None:
    """Write a text file in UTF-8 atomically: after a failure the old file is unchanged.

    Raises:
        OutputError: as `check_target`, or the disk refuses.
    """
    check_target(path, force=force)
    data = text.encode("utf-8", "backslashreplace")
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(data)
            return
        target = path.resolve()  # keeps a symbolic link
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
