"""Log output of a command: to standard error, or to a file; held back while the live screen is shown."""

import logging
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, TextIO

from gateway.core.errors import OutputError
from gateway.core.text.text import escaped

_FORMAT: Final = "%(asctime)s %(levelname)-7s %(name)s: %(message)s"
_LEVELS: Final = (logging.WARNING, logging.INFO, logging.DEBUG)
_PACKAGES: Final = ("gateway", "firmware_protocol")
_HELD_RECORDS: Final = 1000
# Different records whose repetitions are counted.
_MAX_KINDS: Final = 1000
# A record that comes again after this time is no repetition.
_REPEAT_S: Final = 10.0
_HANDLER_NAME: Final = "treadlink"


class _Repeats(logging.Filter):
    """Passes a record that repeats another one soon when it is the first, tenth, hundredth, ..., with its number.

    What repeats has the same place in the code, level and kind of error; a traceback is printed with the first only.
    """

    def __init__(self) -> None:
        super().__init__()
        # Number and time of the last by kind.
        self._counts: dict[tuple[object, ...], tuple[int, float]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        error = record.exc_info[1] if record.exc_info else None
        if error is None and record.levelno < logging.WARNING:
            return True
        key = (record.name, record.lineno, record.levelno, str(record.msg), str(record.args), type(error))
        if len(self._counts) >= _MAX_KINDS and key not in self._counts:
            self._counts.clear()
        count, last_s = self._counts.get(key, (0, 0.0))
        count = count + 1 if record.created - last_s < _REPEAT_S else 1
        self._counts[key] = count, record.created
        if count == 1:
            return True
        if str(count).strip("0") != "1":
            return False
        record.msg, record.args = f"{record.getMessage()} ({count} times)", ()
        record.exc_info = record.exc_text = None
        return True


class _Formatter(logging.Formatter):
    """Writes what is unprintable as escapes: errors of others may hold the codes of a terminal."""

    def format(self, record: logging.LogRecord) -> str:
        return "\n".join(map(escaped, super().format(record).split("\n")))


class _StderrHandler(logging.StreamHandler):  # type: ignore[type-arg]  # generic in type stubs only
    """Handler for standard error that can hold its records back, the latest ones if there are too many."""

    def __init__(self) -> None:
        logging.Handler.__init__(self)
        self.holding = False
        self._pending_records: deque[logging.LogRecord] = deque(maxlen=_HELD_RECORDS)

    @property
    def stream(self) -> TextIO:  # standard error changes at the end of a command
        return sys.stderr

    def emit(self, record: logging.LogRecord) -> None:
        if self.holding:
            self._pending_records.append(record)
        else:
            super().emit(record)

    def emit_held(self) -> None:
        """Emit the held records and hold no more."""
        self.holding = False
        while self._pending_records:
            super().emit(self._pending_records.popleft())


def configure_logging(verbosity: int, log_file: Path | None) -> None:
    """Send log records of this program to standard error, or to `log_file` when given.

    Args:
        verbosity: 0 for warnings, 1 for information, 2 or more for debugging; other packages log warnings only.
        log_file: file to append to.

    Raises:
        OutputError: the file cannot be opened.
    """
    handler = _StderrHandler() if log_file is None else _file_handler(log_file)
    if log_file is None and verbosity == 0:
        # What the views show is not repeated beside them.
        handler.addFilter(lambda record: not getattr(record, "is_shown", False))
    handler.addFilter(_Repeats())
    handler.setFormatter(_Formatter(_FORMAT))
    root = logging.getLogger()
    # A second command in one process, as in tests, replaces the handler of the first.
    for former in [former for former in root.handlers if former.name == _HANDLER_NAME]:
        root.removeHandler(former)
        former.close()
    handler.name = _HANDLER_NAME
    root.addHandler(handler)
    for name in _PACKAGES:
        logging.getLogger(name).setLevel(_LEVELS[min(verbosity, len(_LEVELS) - 1)])


@contextmanager
def held_back() -> Iterator[None]:
    """Hold records for standard error back while something else draws on the terminal, then emit them."""
    handlers = [handler for handler in logging.getLogger().handlers if isinstance(handler, _StderrHandler)]
    for handler in handlers:
        handler.holding = True
    try:
        yield
    finally:
        for handler in handlers:
            handler.emit_held()


def _file_handler(path: Path) -> logging.Handler:
    try:
        return logging.FileHandler(path, encoding="utf-8")
    except OSError as error:
        raise OutputError(
            f"cannot write the log '{path}': {error.strerror}", "Choose another file for --log."
        ) from error
