"""Summary on standard output beside files, for a reader that may leave early, such as `head`."""

from __future__ import annotations

import click


class SummaryOutput:
    """Printer of lines that goes on silently when their reader has left, so that the files are still written."""

    def __init__(self, *, err: bool = False) -> None:
        """Print to standard output, or to standard error."""
        self._err = err
        self._is_left = False

    def __call__(self, line: str = "") -> None:
        """Print a line where there is a reader."""
        if self._is_left:
            return
        try:
            click.echo(line, err=self._err)
        except BrokenPipeError:
            self._is_left = True

    def finish(self) -> None:
        """End the command as one whose reader has left, where it has.

        Raises:
            BrokenPipeError: the reader has left.
        """
        if self._is_left:
            raise BrokenPipeError
