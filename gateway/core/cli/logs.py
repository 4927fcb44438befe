"""Log output of a command: to standard error, or to a file; held back while the live screen is shown."""

import logging
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, TextIO

from gateway.core.errors import OutputError

_FORMAT: Final = "%(asctime)s %(levelname)-7s %(name)s: %(message)s"
_LEVELS: Final = (logging.WARNING, logging.INFO, logging.DEBUG)
_PACKAGES: Final = ("gateway", "firmware_protocol")
_HELD_RECORDS: Final = 1000
_HANDLER_NAME: Final = "treadlink"


class _StderrHandler(logging.StreamHandler):  # type: ignore[type-arg]  # generic in type stubs only
    """Handler for standard error that can hold its records back, the latest ones if there are too many."""

    def __init__(self) -> None:
        logging.Handler.__init__(self)
        self.holding = False
        self._held: deque[logging.LogRecord] = deque(maxlen=_HELD_RECORDS)

    @property
    def stream(self) -> TextIO:  # standard error changes at the end of a command
        return sys.stderr

    def emit(self, record: logging.LogRecord) -> None:
        if self.holding:
            self._held.append(record)
        else:
            super().emit(record)

    def emit_held(self) -> None:
        """Emit the held records and hold no more."""
        self.holding = False
        while self._held:
            super().emit(self._held.popleft())


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
    handler.setFormatter(logging.Formatter(_FORMAT))
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
