"""Summary on standard output beside files: its reader may leave early, as `head` does, and it quotes names of files."""

import click

from gateway.views.text import escaped


class SummaryOutput:
    """Printer of lines that goes on silently when their reader has left, so that the files are still written.

    Everything unprintable is escaped: names from files must not control the terminal.
    """

    def __init__(self, *, err: bool = False) -> None:
        """Print to standard output, or to standard error."""
        self._err = err
        self._is_left = False

    def __call__(self, line: str = "") -> None:
        """Print a line where there is a reader."""
        if self._is_left:
            return
        try:
            click.echo(escaped(line), err=self._err)
        except BrokenPipeError:
            self._is_left = True

    def finish(self) -> None:
        """End the command as one whose reader has left, where it has.

        Raises:
            BrokenPipeError: the reader has left.
        """
        if self._is_left:
            raise BrokenPipeError
