"""Progress of a command on the terminal of standard error: bars with the remaining time, or a line of text.

Nothing is drawn where standard error is no terminal. What is drawn disappears when the work ends.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Final

from gateway.core.text.text import clean

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.live import Live
    from rich.progress import Progress, TaskID

_DRAWINGS_PER_S: Final = 8
# Smaller steps cannot be seen, and drawing is not free.
_STEP: Final = 0.001
_LABEL_CELLS: Final = 36
_ECHO_CELLS: Final = 3


class Bar:
    """One bar; without a terminal it does nothing."""

    def __init__(self, progress: Progress | None, task: TaskID | None) -> None:
        """Take the task of a `Progress`, None where nothing is drawn."""
        self._progress = progress
        self._task = task
        self._done_share = 0.0
        self._label: str | None = None

    def show(self, share: float, label: str | None = None) -> None:
        """Show the share of the work that is done, 0 to 1, and from now on another label.

        A share below the last one is ignored.
        """
        if self._progress is None or self._task is None:
            return
        if label is not None and label != self._label:
            self._label = label
            self._progress.update(self._task, description=clean(label))
        if share >= self._done_share + _STEP or share >= 1.0 > self._done_share:
            self._done_share = min(share, 1.0)
            self._progress.update(self._task, completed=self._done_share)

    def remove(self) -> None:
        """Draw the bar no more."""
        if self._progress is not None and self._task is not None:
            self._progress.remove_task(self._task)
            self._progress = None


class ProgressView:
    """Bars below each other, or a line of text."""

    def __init__(self, console: Console | None) -> None:
        """Draw on a console; None draws nothing."""
        self._console = console
        self._progress = _bars(console) if console is not None else None
        self._text: str | None = None
        self._live: Live | None = None

    def bar(self, label: str) -> Bar:
        """Add a bar."""
        if self._progress is None:
            return Bar(None, None)
        return Bar(self._progress, self._progress.add_task(clean(label), total=1.0))

    def text(self, line: str) -> None:
        """Show a line of text below the bars."""
        self._text = clean(line)

    @contextmanager
    def hidden(self) -> Iterator[None]:
        """Remove the drawing while other lines are printed; they then stand above it."""
        self._stop()
        try:
            yield
        finally:
            self._start()

    def __enter__(self) -> ProgressView:
        self._start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()

    def _start(self) -> None:
        if self._console is None:
            return
        from rich.live import Live

        self._live = Live(
            console=self._console,
            get_renderable=self._drawing,
            refresh_per_second=_DRAWINGS_PER_S,
            transient=True,
            # Standard output may be a file, which rich would write to the terminal.
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._live.start(refresh=True)

    def _stop(self) -> None:
        live, self._live = self._live, None
        if live is not None:
            with suppress(OSError):  # the terminal may be closed
                live.stop()

    def _drawing(self) -> RenderableType:
        from rich.console import Group
        from rich.constrain import Constrain
        from rich.text import Text

        assert self._console is not None
        assert self._progress is not None
        renderables: list[RenderableType] = [self._progress.get_renderable()] if self._progress.tasks else []
        if self._text is not None:
            renderables.append(Text(self._text, no_wrap=True, overflow="ellipsis"))
        # The terminal echoes Ctrl-C as two characters, which must not begin another line.
        return Constrain(Group(*renderables), self._console.width - _ECHO_CELLS)


def can_move_cursor(environment: Mapping[str, str]) -> bool:
    """Return whether the terminal draws more than line after line; those of editors and scripts do not."""
    if environment.get("TERM", "") in ("dumb", "unknown"):
        return False
    return os.name != "posix" or bool(environment.get("TERM"))


def progress_view() -> ProgressView:
    """Return a view of progress; used as a context manager, it is drawn in its block."""
    if not (sys.stderr.isatty() and can_move_cursor(os.environ)):
        return ProgressView(None)
    from rich.console import Console

    return ProgressView(Console(stderr=True))


@contextmanager
def progress_bar(label: str) -> Iterator[Bar]:
    """Draw a single bar in a block of code."""
    with progress_view() as view:
        yield view.bar(label)


def _bars(console: Console) -> Progress:
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
    from rich.table import Column

    label = Column(no_wrap=True, overflow="ellipsis", min_width=_LABEL_CELLS // 2, max_width=_LABEL_CELLS)
    return Progress(
        TextColumn("{task.description}", markup=False, table_column=label),
        BarColumn(bar_width=None),
        TaskProgressColumn("[progress.percentage]{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
        console=console,
        auto_refresh=False,
        expand=True,
    )
