"""Files that only their owner may read: mode 0600, replaced as a whole or not at all."""

import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from gateway.core.clock import SystemClock
from gateway.security.cmac import SecurityError

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl
    import resource

_HAS_MODES: Final = os.name == "posix"
_LOCK_WAIT_NS: Final = 5_000_000_000
_LOCK_RETRY_NS: Final = 10_000_000


def read_private(path: Path, most_bytes: int) -> str | None:
    """Return the text of a private file, None when there is no such file.

    Raises:
        SecurityError: it cannot be read, is not a regular file, is too long, or is not private.
    """
    try:
        # Opened first and checked then, so that the file checked is the file read; a pipe must not block.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise SecurityError(f"'{path}' cannot be read: {error.strerror}", "Check its owner and mode.") from error
    try:
        _check(path, os.fstat(descriptor))
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            data = file.read(most_bytes + 1)
    except OSError as error:
        raise SecurityError(f"'{path}' cannot be read: {error.strerror}", "Check the disk.") from error
    finally:
        os.close(descriptor)
    if len(data) > most_bytes:
        raise SecurityError(f"'{path}' is too large", "Give the right file.")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise SecurityError(f"'{path}' is not UTF-8 text", "Give the right file.") from error


def _check(path: Path, status: os.stat_result) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise SecurityError(f"'{path}' is not a regular file", "Give a key file, or the name of a new one.")
    if _HAS_MODES and status.st_mode & 0o077:
        raise SecurityError(
            f"'{path}' can be read or changed by others (mode {stat.S_IMODE(status.st_mode):04o})",
            f"Make it private: chmod 600 '{path}'. If others may have read it, make new keys.",
        )
    if _HAS_MODES and status.st_uid not in (os.getuid(), 0):
        raise SecurityError(f"'{path}' belongs to another user", "Use a file of your own.")


def keep_from_core_dumps() -> None:
    """Make a crash of this process, and of those it starts, leave no core file: it would contain the keys."""
    if sys.platform != "win32":
        _, hard_limit = resource.getrlimit(resource.RLIMIT_CORE)
        resource.setrlimit(resource.RLIMIT_CORE, (0, hard_limit))


def write_private(path: Path, text: str) -> None:
    """Replace a private file, `locked` by the caller; a crash leaves either the old or the new one complete.

    A symbolic link stays one, and its target is replaced. Mode and owner of an existing file are kept.

    Raises:
        SecurityError: it cannot be written.
    """
    target = _target(path)
    try:
        _make_folder(target)
        part = target.with_name(f".{target.name}.part")
        part.unlink(missing_ok=True)  # of a killed process: it has keys
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
        descriptor = os.open(part, flags, 0o600)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(text.encode())
                file.flush()
                _keep_mode_and_owner(target, file.fileno())
                os.fsync(file.fileno())
            part.replace(target)
        except BaseException:
            with suppress(OSError):
                part.unlink()
            raise
    except OSError as error:
        raise SecurityError(f"'{path}' cannot be written: {error.strerror}", "Check folder and disk.") from error


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Exclude other processes that change a private file, from reading it to writing it.

    The lock is a file of its own beside it, since the private file is replaced as a whole. It is removed at the end.

    Raises:
        SecurityError: another process holds the lock for long, or the folder cannot be written.
    """
    lock = _target(path).with_name(_target(path).name + ".lock")
    clock = SystemClock()
    until_ns = clock.now_ns() + _LOCK_WAIT_NS
    try:
        _make_folder(lock)
        descriptor = _acquired(lock)
        while descriptor is None:
            if clock.now_ns() > until_ns:
                raise SecurityError(
                    f"'{path}' is being changed by another process",
                    f"Try again when it has ended. '{lock}' is its lock.",
                )
            clock.sleep_until_ns(clock.now_ns() + _LOCK_RETRY_NS)
            descriptor = _acquired(lock)
    except OSError as error:
        raise SecurityError(f"'{path}' cannot be locked: {error.strerror}", "Check folder and disk.") from error
    try:
        yield
    finally:
        # Removed while it is held: whoever waits for it finds that its name is gone, and starts again. Windows does not
        # remove open files; there the empty file stays.
        with suppress(OSError):
            lock.unlink()
        os.close(descriptor)


def _acquired(lock: Path) -> int | None:
    """Return the descriptor of the lock file, locked; None when another process holds it or has just removed it."""
    descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        if sys.platform == "win32":
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(descriptor), lock.stat()):
            return descriptor
    except (BlockingIOError, PermissionError, FileNotFoundError):
        pass
    except BaseException:
        os.close(descriptor)
        raise
    os.close(descriptor)
    return None


def _target(path: Path) -> Path:
    """Return the file behind symbolic links."""
    return Path(os.path.realpath(path))


def _make_folder(path: Path) -> None:
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)


def _keep_mode_and_owner(target: Path, descriptor: int) -> None:
    if sys.platform == "win32" or not target.exists():
        return
    status = target.stat()
    os.fchmod(descriptor, stat.S_IMODE(status.st_mode) & 0o700)
    if (status.st_uid, status.st_gid) != (os.geteuid(), os.getegid()):
        with suppress(PermissionError):  # only root can give a file away
            os.fchown(descriptor, status.st_uid, status.st_gid)
