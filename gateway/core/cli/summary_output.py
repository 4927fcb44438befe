"""Summary on standard output beside files: its reader may leave early, as `head` does, and it quotes names of files."""

from collections.abc import Iterable
from pathlib import Path

import click

from gateway.core.text.aligned_table import for_terminal
from gateway.core.text.output_file import is_stdout
from gateway.core.text.text import escaped


class SummaryOutput:
    """Printer of lines that goes on silently when their reader has left, so that the files are still written.

    Everything unprintable is escaped: names from files must not control the terminal.
    """

    def __init__(self, outputs: Iterable[Path | None] = ()) -> None:
        """Print to standard output, or to standard error where one of the outputs is standard output."""
        self.err = any(map(is_stdout, outputs))
        self._has_reader_left = False

    def __call__(self, line: str = "") -> None:
        """Print a line where there is a reader."""
        if self._has_reader_left:
            return
        try:
            click.echo(for_terminal(escaped(line), on_err=self.err), err=self.err)
        except BrokenPipeError:
            self._has_reader_left = True

    def written(self, path: Path | None, remark: str = "") -> None:
        """Print that an output was written, with a remark; nothing of none, and of standard output."""
        if path is not None and not is_stdout(path):
            self(f"written: {path}{remark}")

    def finish(self) -> None:
        """End the command as one whose reader has left, where it has.

        Raises:
            BrokenPipeError: the reader has left.
        """
        if self._has_reader_left:
            raise BrokenPipeError
