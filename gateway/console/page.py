"""Layout of the console: the rows of each block, as a pure function of snapshot, view state and size."""

from dataclasses import dataclass, field
from typing import Final

from gateway.console import status
from gateway.console.overview import overview
from gateway.console.styled_rows import Role, Row, fit
from gateway.console.waveform import Zoom
from gateway.console.wheel_panel import PANEL_MIN_HEIGHT, PANEL_MIN_WIDTH, Plots, details, panel
from gateway.core.estimates.results import SessionSnapshot

_VALUE_ROWS: Final = 7  # of a panel, above its waveform


@dataclass(slots=True)
class ViewState:
    """Settings of the user.

    Attributes:
        selected: index of the wheel shown in detail.
        zoom: angle range of the waveforms.
        paused_at_s: session time at which the view was frozen, None when it is live.
        help_shown: whether the help page covers the wheels.
        plots: waveforms or trends.
        addresses: of the page in a browser.
        may_record: whether a recording can be begun.
    """

    selected: int = 0
    zoom: Zoom = Zoom.WHOLE
    paused_at_s: float | None = None
    help_shown: bool = False
    plots: Plots = field(default_factory=Plots)
    addresses: tuple[str, ...] = ()
    may_record: bool = False


def panel_grid(wheels: int, cells: int, height: int) -> tuple[int, int] | None:
    """Return the (columns, rows) of panels with the best shape that fits, None when no panel fits."""
    best_grid: tuple[float, int, int] | None = None
    for columns in range(1, wheels + 1):
        rows = -(-wheels // columns)
        panel_width, panel_height = cells // columns, height // rows
        if panel_width < PANEL_MIN_WIDTH or panel_height < PANEL_MIN_HEIGHT:
            continue
        # The waveform fills the rest; it should be about twice as wide as high, and cells are half as wide as high.
        score = min(panel_width / 4.0, panel_height - _VALUE_ROWS)
        if best_grid is None or score > best_grid[0]:
            best_grid = (score, columns, rows)
    return None if best_grid is None else best_grid[1:]


def compose(
    snapshot: SessionSnapshot, view: ViewState, cells: int, height: int, live: SessionSnapshot | None = None
) -> list[Row]:
    """Return exactly `height` rows of exactly `cells` cells.

    Args:
        snapshot: to show.
        view: settings of the user.
        cells: width of the terminal.
        height: number of its rows.
        live: the present state while the view is paused: clock, recording, alarms and notices never freeze.
    """
    live = live or snapshot
    view.plots.elapsed_s = snapshot.elapsed_s
    alarm_rows = 2 if height < 30 else 4
    link_rows = 2 if height < 30 else 4
    notice_rows = 1 if height < 30 else 3 if height < 50 else 6
    top = [status.header(live, view.paused_at_s, cells), *status.alarms(live, cells, alarm_rows)]
    bottom = [
        *status.links(snapshot.links, cells, link_rows),
        *status.sinks(live.sinks, cells, link_rows),
        *status.overwritten_samples(snapshot.wheels, cells),
        *status.notices(live.notices, cells, notice_rows),
        *[fit(((f"page: {address}", Role.LABEL),), cells) for address in view.addresses],
        status.keys(
            len(snapshot.wheels),
            view.zoom,
            view.paused_at_s is not None,
            cells,
            has_trend=view.plots.trend is not None,
            may_record=view.may_record and not live.recording,
        ),
    ]
    room = max(height - len(top) - len(bottom), 0)
    middle = status.help_rows(cells, room) if view.help_shown else _wheels(snapshot, view, cells, room)
    blank = fit((), cells)
    middle = [*middle[:room], *([blank] * (room - len(middle)))]
    # A tiny terminal shows header and alarms rather than the last rows.
    return [*top, *middle, *bottom][:height]


def _wheels(snapshot: SessionSnapshot, view: ViewState, cells: int, height: int) -> list[Row]:
    wheels = snapshot.wheels
    if not wheels:
        return [fit((("No wheel yet: waiting for the first hello of a hub.", Role.LABEL),), cells)]
    selected = min(view.selected, len(wheels) - 1)
    alarmed = frozenset(alarm.position for alarm in snapshot.alarms)
    grid = panel_grid(len(wheels), cells, height)
    if grid is None:
        table = overview(wheels, selected, alarmed, cells)
        detail_rows = details(wheels[selected], selected + 1, cells, height - len(table), view.zoom, view.plots)
        return [*table, *(fit(row, cells) for row in detail_rows)]
    columns, grid_rows = grid
    rows: list[Row] = []
    for start in range(0, len(wheels), columns):
        blocks = []
        # The last row and column of panels take the remainder of the division.
        panel_height = height // grid_rows + (height % grid_rows if start + columns >= len(wheels) else 0)
        for i, wheel in enumerate(wheels[start : start + columns], start):
            panel_width = cells // columns + (cells % columns if i - start == columns - 1 else 0)
            blocks.append(
                panel(
                    wheel,
                    i + 1,
                    panel_width,
                    panel_height,
                    selected=i == selected and len(wheels) > 1,
                    alarm=wheel.position in alarmed,
                    zoom=view.zoom,
                    plots=view.plots,
                )
            )
        rows += [fit(tuple(run for row in line for run in row), cells) for line in zip(*blocks, strict=True)]
    return rows
