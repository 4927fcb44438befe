"""Errors for the user: each names the thing that failed and the remedy."""

import errno
from collections.abc import Mapping
from typing import Final

_LONGEST_LINE: Final = 2000
# What the system says of a file that cannot be read, where permissions do not help.
_READING_REMEDIES: Final = {
    errno.ELOOP: "The links of this path lead back to themselves: correct them.",
    errno.ENAMETOOLONG: "Give a shorter path.",
    errno.ENOTDIR: "Check the path: a file stands where a folder is needed.",
    errno.EISDIR: "Give a file in this folder.",
    errno.EINVAL: "Give a regular file.",
    errno.EIO: "Copy it from another place: the disk may be failing.",
}


def reading_remedy(error: OSError) -> str:
    """Return what helps where the system refuses to read a file."""
    return _READING_REMEDIES.get(error.errno or 0, "Check its permissions.")


class TreadlinkError(Exception):
    """Base of every error shown to the user without a traceback.

    Attributes:
        remedy: what the user can do about it, one sentence, or an empty string.
    """

    def __init__(self, message: str, remedy: str = "") -> None:
        """Store message and remedy separately, so that views can lay them out.

        Both may quote a file or a device, so characters that a terminal would act on are escaped here.
        """
        super().__init__(_presentable(message))
        self.remedy = _presentable(remedy)
        if self.remedy:
            self.add_note(self.remedy)  # a traceback shows it below the message


def _presentable(text: str) -> str:
    """Return text with control characters escaped and very long lines shortened."""
    if len(text) <= _LONGEST_LINE and text.replace("\n", "").isprintable():
        return text
    lines = []
    for line in text.split("\n"):
        shortened = (
            line if len(line) <= _LONGEST_LINE else f"{line[: _LONGEST_LINE // 2]} ... {line[-_LONGEST_LINE // 4 :]}"
        )
        lines.append("".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in shortened))
    return "\n".join(lines)


class SourceError(TreadlinkError):
    """A source cannot be opened at all: unknown scheme, missing file, bad option.

    Attributes:
        cause: identifies why, for comparing errors: the number of the system's error or a name; empty when neither is
            known.
    """

    def __init__(self, message: str, remedy: str = "", *, cause: int | str = "") -> None:
        """Store message, remedy and cause."""
        super().__init__(message, remedy)
        self.cause = cause


class LinkLostError(TreadlinkError):
    """An open link broke; the reconnecting source opens it again.

    Attributes:
        cause: identifies why, for comparing errors; the message where no other name is given.
    """

    def __init__(self, message: str, remedy: str = "", *, cause: str = "") -> None:
        """Store message, remedy and cause."""
        super().__init__(message, remedy)
        self.cause = cause or message


class RecordingError(TreadlinkError):
    """A recording cannot be read, written or repaired."""


class ConfigError(TreadlinkError):
    """A configuration, scenario or import map has errors; the message lists all of them."""


class ImportDataError(TreadlinkError):
    """A foreign measurement file does not match its map."""


class OutputError(TreadlinkError):
    """A result file cannot be written: it exists, its format needs a missing package, or the disk refuses."""


class PluginError(TreadlinkError):
    """A plug-in that was asked for cannot be imported or does not fit its registry."""

    def __init__(self, name: str, package: str, reason: Mapping[str, object]) -> None:
        """Name the plug-in and its package, and the values of the reason, which may name another one."""
        values = ", ".join(f"{key} {value}" for key, value in reason.items())
        super().__init__(
            f"plug-in '{name}' of package '{package}' cannot be used{f' ({values})' if values else ''}",
            "Run `treadlink doctor`: it shows the reason.",
        )


class CalibrationError(TreadlinkError):
    """Measurements do not determine a calibration, or contradict each other."""
