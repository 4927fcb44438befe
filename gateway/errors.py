"""Errors the user is meant to read: each names the thing that failed and the remedy."""


class TreadlinkError(Exception):
    """Base of every error shown to the user without a traceback.

    Attributes:
        remedy: what the user can do about it, one sentence, or an empty string.
    """

    def __init__(self, message: str, remedy: str = "") -> None:
        """Keep the message and the remedy apart so that views can lay them out."""
        super().__init__(message)
        self.remedy = remedy


class SourceError(TreadlinkError):
    """A source cannot be opened at all: unknown scheme, missing file, bad option."""


class LinkLostError(TreadlinkError):
    """A link that was open broke; the reconnecting source retries it."""


class RecordingError(TreadlinkError):
    """A recording cannot be read, written or repaired."""


class ConfigError(TreadlinkError):
    """A configuration, scenario or import map has faults; the message lists all of them."""


class ImportDataError(TreadlinkError):
    """A foreign measurement file does not match its map."""


class OutputError(TreadlinkError):
    """A result file cannot be written: it exists, its format needs a missing package, or the disk refuses."""
