"""The live console, drawn from snapshots ten times a second, never per frame or revolution."""

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Final

from rich.segment import Segment
from rich.style import Style
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.events import Resize
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget
from textual.widgets import Input

from gateway.console.page import ViewState, compose
from gateway.console.styled_rows import Role, Row
from gateway.console.waveform import Zoom
from gateway.core.errors import TreadlinkError
from gateway.core.estimates.results import SessionSnapshot
from gateway.core.shown_units import ShownUnits, shown_in
from gateway.core.text.session_control import ShownSession

DRAW_INTERVAL_S: Final = 0.1
_SHORT_MARK: Final = "mark"
_CLEARED: Final = "-"
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
            Region(0, y, width, 1) for y, (prior, row) in enumerate(zip(old, self._rows, strict=True)) if prior != row
        ]
        if changed:
            self.refresh(*changed)

    def render_line(self, y: int) -> Strip:
        """Return line `y`; textual calls this for refreshed lines only."""
        if y >= len(self._rows):
            return Strip.blank(self.size.width)
        return Strip([Segment(text, STYLES[role]) for text, role in self._rows[y] if text], self.size.width)


class WheelBoard(Board):
    """The board with the keys that switch wheels, which the input line of a mark must not have."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab,right,down", "app.switch(1)"),
        Binding("shift+tab,left,up", "app.switch(-1)"),
        *(Binding(str(number), f"app.select({number})") for number in range(1, 10)),
    ]


class MarkInput(Input):
    """The input line for the text of a mark; Tab does not leave it."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab,shift+tab", "ignore"),
        Binding("escape", "app.leave"),
    ]

    def action_ignore(self) -> None:
        """Keep the focus here."""


class ConsoleApp(App[None]):
    """The console of one session, until it ends, its time is up, or the user quits."""

    ENABLE_COMMAND_PALETTE = False
    CSS = """
    Screen { background: ansi_default; }
    MarkInput { display: none; height: 1; border: none; padding: 0 1; background: ansi_default; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+c,ctrl+q", "quit_session", priority=True),
        Binding("q,Q", "quit_session"),
        Binding("space", "pause"),
        Binding("m", "mark"),
        Binding("a", "acknowledge"),
        Binding("r", "record"),
        Binding("u", "units"),
        Binding("z", "zoom"),
        Binding("t", "trend"),
        Binding("comma", "quantity(-1)"),
        Binding("full_stop", "quantity(1)"),
        Binding("question_mark", "help"),
        Binding("escape", "leave"),
    ]

    def __init__(
        self, session: ShownSession, time_is_up: Callable[[], bool] = lambda: False, addresses: tuple[str, ...] = ()
    ) -> None:
        """Set the session to show, what says that it is to stop, and the addresses of its page."""
        super().__init__(ansi_color=True)
        self._session = session
        self._time_is_up = time_is_up
        self._live = session.snapshot()
        self._frozen: SessionSnapshot | None = None
        self._mark_at_s = 0.0
        self._form: dict[str, str] | None = None
        self._unanswered: list[str] = []
        self._leaving = False
        self.view = ViewState(addresses=addresses, may_record=session.may_record)
        self._board = WheelBoard()
        self._input = MarkInput()

    def compose(self) -> ComposeResult:
        """Put the board on the screen and, hidden below it, the input line of a mark."""
        yield self._board
        yield self._input

    def on_mount(self) -> None:
        """Start drawing."""
        self._board.focus()
        self.set_interval(DRAW_INTERVAL_S, self.tick)

    def on_resize(self, event: Resize) -> None:  # noqa: ARG002 - textual's signature
        """Draw for the new size once the board has it."""
        self.call_after_refresh(self._draw)

    def tick(self) -> None:
        """Take a snapshot and draw it; leave when the session has ended or its time is up."""
        if self._leaving:
            return
        self._live = self._session.snapshot()
        for result in self._session.results():
            self.view.plots.take(result, self._live.elapsed_s)
        self._leaving = self._live.ended or self._time_is_up()
        if self._leaving:
            # The screen ends with the last state, even when the view was paused.
            self._frozen, self.view.paused_at_s = None, None
        self._draw()
        if self._leaving:
            self._session.request_stop()
            self.call_after_refresh(self.exit)

    def _draw(self) -> None:
        size = self._board.size
        with shown_in(self._live.units):
            rows = compose(self._frozen or self._live, self.view, size.width, size.height, self._live)
        self._board.show(rows)

    def action_quit_session(self) -> None:
        """Ask the session to stop and leave."""
        self._session.request_stop()
        self.exit()

    def action_pause(self) -> None:
        """Stop a replay and freeze the view, or go on; of live hubs only the view freezes."""
        self._frozen = None if self._frozen else self._live
        self._session.pause(self._frozen is not None)
        self.view.paused_at_s = self._frozen.elapsed_s if self._frozen else None
        self._draw()

    def action_switch(self, step: int) -> None:
        """Select the next or the previous wheel."""
        wheels = len((self._frozen or self._live).wheels)
        if wheels:
            self.view.selected = (self.view.selected + step) % wheels
            self._draw()

    def action_select(self, number: int) -> None:
        """Select a wheel by its number."""
        if number <= len((self._frozen or self._live).wheels):
            self.view.selected = number - 1
            self._draw()

    def action_zoom(self) -> None:
        """Switch between the whole revolution and the surroundings of the contact."""
        self.view.zoom = Zoom.CONTACT if self.view.zoom is Zoom.WHOLE else Zoom.WHOLE
        self._draw()

    def action_trend(self) -> None:
        """Switch between the waveform and the trend of a quantity, the speed first."""
        plots = self.view.plots
        quantities = plots.history.quantities()
        plots.trend = quantities[0] if plots.trend is None and quantities else None
        self._draw()

    def action_quantity(self, step: int) -> None:
        """Show the trend of the next or the previous quantity."""
        plots = self.view.plots
        quantities = plots.history.quantities()
        if quantities:
            names = [quantity.name for quantity in quantities]
            index = names.index(plots.trend.name) if plots.trend is not None else -1
            plots.trend = quantities[(index + step) % len(quantities)]
            self._draw()

    def action_help(self) -> None:
        """Show or hide the help page."""
        self.view.help_shown = not self.view.help_shown
        self._draw()

    def action_leave(self) -> None:
        """Leave the input line or the help page."""
        self.view.help_shown = False
        self._close_input()
        self._draw()

    def action_mark(self) -> None:
        """Ask for the text of a mark; it gets the time of this key press."""
        self._mark_at_s = self._session.snapshot().elapsed_s
        self._open_input("text of the mark; Enter sets it, Escape cancels")

    def action_record(self) -> None:
        """Ask for the description of the run, field by field, and begin a recording; none while one runs."""
        if self._live.recording or not self._session.may_record:
            self._form, self._unanswered = {}, []
            recording = self._live.recording
            message = f"{recording} is being recorded" if recording else "this session cannot begin a recording"
            self._open_input(f"{message}; Enter or Escape goes back")
            return
        self._form = self._session.run_form
        self._unanswered = list(self._form)
        self._ask_next()

    def _ask_next(self) -> None:
        if self._form is not None and self._unanswered:
            name = self._unanswered[0]
            current = self._form[name]
            keeps = f"Enter keeps '{current}', {_CLEARED} clears it" if current else "Enter leaves it out"
            self._open_input(f"record, {name}: {keeps}, Escape cancels")

    def action_units(self) -> None:
        """Show numbers in the next units, here and on the pages."""
        units = list(ShownUnits)
        self._session.show_in(units[(units.index(self._live.units) + 1) % len(units)])

    def action_acknowledge(self) -> None:
        """Acknowledge the alarms that stand."""
        self._session.acknowledge()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Set the mark, with the time of its key press; or take a field of the form, and record after the last."""
        if self._form is not None:
            if not self._unanswered:  # what went wrong was read
                self._close_input()
                return
            name, answer = self._unanswered.pop(0), event.value.strip()
            if answer:
                self._form[name] = "" if answer == _CLEARED else answer
            if self._unanswered:
                self._ask_next()
            else:
                self._begin_recording(self._form)
            return
        text = event.value.strip() or _SHORT_MARK
        self._close_input()
        self._session.mark(f"{text} (key pressed at {self._mark_at_s:.1f} s)")

    def _begin_recording(self, form: Mapping[str, str]) -> None:
        try:
            self._session.start_recording(form)
        except TreadlinkError as error:
            self._open_input(f"not recorded: {error}. {error.remedy}".strip())
        else:
            self._close_input()

    def _open_input(self, placeholder: str) -> None:
        self._input.value = ""
        self._input.placeholder = placeholder
        self._input.display = True
        self._input.focus()

    def _close_input(self) -> None:
        self._form = None
        self._input.display = False
        self._board.focus()


def run_console(session: ShownSession, time_is_up: Callable[[], bool], addresses: tuple[str, ...]) -> None:
    """Show the session on the terminal until the user quits, its time is up, or it has ended.

    The session is stopped unless it has ended already.
    """
    # Without mouse support in the application, the terminal's own selection can copy values.
    ConsoleApp(session, time_is_up, addresses).run(mouse=False)
