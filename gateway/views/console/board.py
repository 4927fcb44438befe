"""The widget of the console: rows of text, of which only changed ones are repainted."""

from collections.abc import Sequence
from typing import Final

from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from gateway.views.console.styled_rows import Role, Row

# Colours of the terminal's own palette follow the user's theme and take the fewest bytes.
STYLES: Final[dict[Role, Style]] = {
    Role.TEXT: Style(),
    Role.LABEL: Style(dim=True),
    Role.VALUE: Style(bold=True),
    Role.TITLE: Style(bold=True),
    Role.GOOD: Style(color="green"),
    Role.WARNING: Style(color="yellow"),
    Role.ALARM: Style(color="red", bold=True, reverse=True),
    Role.BAR: Style(),
    Role.FRAME: Style(dim=True),
    Role.SELECTED_FRAME: Style(color="cyan"),
    Role.LAST: Style(bold=True),
    Role.AVERAGE: Style(color="cyan"),
}


class Board(Widget, can_focus=True):
    """Rows of styled text, one per terminal line."""

    DEFAULT_CSS = "Board { height: 1fr; width: 1fr; background: ansi_default; }"

    def __init__(self) -> None:
        """Start empty."""
        super().__init__()
        self._rows: tuple[Row, ...] = ()

    @property
    def rows(self) -> tuple[Row, ...]:
        """The rows shown now."""
        return self._rows

    def show(self, rows: Sequence[Row]) -> None:
        """Show rows; unchanged lines are not repainted."""
        old, self._rows = self._rows, tuple(rows)
        if len(old) != len(self._rows):
            self.refresh()
            return
        width = self.size.width
        changed = [
            Region(0, y, width, 1) for y, (before, now) in enumerate(zip(old, self._rows, strict=True)) if before != now
        ]
        if changed:
            self.refresh(*changed)

    def render_line(self, y: int) -> Strip:
        """Return line `y`; textual calls this for refreshed lines only."""
        if y >= len(self._rows):
            return Strip.blank(self.size.width)
        return Strip([Segment(text, STYLES[role]) for text, role in self._rows[y] if text], self.size.width)
