"""Parts of the console around the wheels: header, alarms, links, notices, keys, help."""

from collections.abc import Sequence
from typing import Final

from gateway.console.styled_rows import Role, Row, Run, fill_while_fitting, fit, spread
from gateway.console.waveform import Zoom
from gateway.core.estimates.results import (
    LinkSnapshot,
    SessionSnapshot,
    SinkSnapshot,
    SinkState,
    WheelSnapshot,
    WheelState,
)
from gateway.core.links.reasons import LinkCode
from gateway.core.reasons import Notice
from gateway.core.text.numbers import MISSING, age, duration, fixed, percent
from gateway.core.text.text import clean, crop_middle, file_size, pad
from gateway.core.text.wording import notice_text
from gateway.core.text.wording import text as reason_text

_LOSS_WARNING_PERCENT: Final = 1.0
_WIDE_CELLS: Final = 110
_VERIFIED: Final = "verified"
_HELP: Final = (
    ("space", "pause: a replay stops; of a live hub only the view freezes"),
    ("m", "mark an event in the recording at the time of the key press"),
    ("r", "record: asks for test, driver, tire, comment and tags, then begins"),
    ("a", "acknowledge the alarms that stand; the recording has when"),
    ("tab  1-8  arrows", "switch wheel"),
    ("z", "waveform: whole revolution or ±90° around the contact"),
    ("t  , .", "trend of the last three minutes in place of the waveform; previous, next quantity"),
    ("u", "units: kPa, bar, or mph and psi; [vehicle] units of the vehicle file keeps them"),
    ("?", "this help"),
    ("q  ctrl+c", "quit, with a summary"),
    ("", ""),
    ("value ± error", "one standard error; no mark: valid"),
    ("~", "provisional: the reason is below the numbers"),
    ("x  —", "invalid or unknown: the reason is below the numbers"),
    ("waveform", "radial axis; solid: last revolution, dots: running average"),
    ("▲", "contact begins and ends: angle from its middle, begins° and ends° of the list"),
    ("Bs Cw Rs Ts", "numbers for bending, contact width, radial and tangential stiffness"),
    ("stated  230.0s", "from the vehicle file, not measured"),
    ("overwritten", "data that arrived but was not processed in time"),
    ("lag", "delay of the newest samples relative to the smallest so far"),
    ("SILENT", "nothing arrives any more, with the time since; its numbers are gone"),
)


def header(snapshot: SessionSnapshot, paused_at_s: float | None, cells: int) -> Row:
    """Return the header: clock, number of rolling wheels, recording, and whether the view is paused or has ended."""
    rolling = sum(wheel.state is WheelState.ROLLING for wheel in snapshot.wheels)
    left_runs: list[Run] = [
        (" treadlink ", Role.TITLE),
        (f" {duration(snapshot.elapsed_s)} ", Role.BAR),
        *([] if snapshot.ended else [(f" {rolling}/{len(snapshot.wheels)} rolling ", Role.BAR)]),
    ]
    silent = sum(wheel.silence is not None for wheel in snapshot.wheels)
    if silent:
        left_runs.append((f" {silent} SILENT ", Role.ALARM))
    right_runs: list[Run] = []
    if paused_at_s is not None:
        right_runs.append((f" PAUSED at {duration(paused_at_s)} ", Role.ALARM))
    if snapshot.ended:
        right_runs.append((" ENDED ", Role.ALARM))
    room = cells - sum(len(text) for text, _ in (*left_runs, *right_runs))
    if snapshot.recording:
        size = f" {file_size(snapshot.recorded_bytes)} "
        path = crop_middle(clean(snapshot.recording), max(room - len(size) - 6, 8))
        left_runs += [(" REC ", Role.GOOD), (path + size, Role.BAR)]
    else:
        left_runs.append((" not recording ", Role.BAR))
    return spread(tuple(left_runs), tuple(right_runs), cells, Role.BAR)


def alarms(snapshot: SessionSnapshot, cells: int, rows: int) -> list[Row]:
    """Return one prominent row per alarm, acknowledged ones last; the last row names those without room.

    The first names the key that acknowledges them, as long as there is something to acknowledge.
    """
    present = sorted(snapshot.alarms, key=snapshot.is_acknowledged)
    visible = present if len(present) <= rows else present[: rows - 1]
    hidden = present[len(visible) :]
    texts = [
        f" ALARM  {alarm.position}: {reason_text(alarm.reason)}{' (acknowledged)' * snapshot.is_acknowledged(alarm)}"
        for alarm in visible
    ]
    if hidden:
        texts.append(f" ALARM  {len(hidden)} more: " + ", ".join(f"{alarm.position} {alarm.name}" for alarm in hidden))
    if present and not snapshot.is_acknowledged(present[0]):
        texts[0] += "   (a: acknowledge)"
    return [fit(((clean(text), Role.ALARM),), cells, Role.ALARM) for text in texts]


def links(all_links: Sequence[LinkSnapshot], cells: int, rows: int) -> list[Row]:
    """Return one row per link; without room for all, those with problems come first and the rest is counted."""
    visible = list(all_links)
    hidden_count = 0
    if len(visible) > rows:
        visible.sort(key=lambda link: (link.connected, -link.frames_lost / max(link.frames, 1)))
        hidden_count = len(visible) - rows + 1
        connected = sum(link.connected for link in visible[rows - 1 :])
        visible = visible[: rows - 1]
    name_width = min(max((len(link.link) for link in visible), default=0), cells // 4 if cells >= _WIDE_CELLS else 16)
    result = [fit(link_row(link, name_width, cells), cells) for link in visible]
    if hidden_count:
        result.append(fit(((f"{hidden_count} more links, {connected} of them connected", Role.LABEL),), cells))
    return result


def sinks(outputs: Sequence[SinkSnapshot], cells: int, rows: int) -> list[Row]:
    """Return one row per live output; without room for all, those with problems come first and the rest is counted."""
    visible = list(outputs)
    hidden_count = 0
    if len(visible) > rows:
        visible.sort(key=lambda sink: (sink.state is SinkState.UP, -sink.dropped))
        hidden_count = len(visible) - rows + 1
        visible = visible[: rows - 1]
    name_width = min(max((len(sink.sink) for sink in visible), default=0), cells // 4 if cells >= _WIDE_CELLS else 16)
    result = [fit(sink_row(sink, name_width, cells), cells) for sink in visible]
    if hidden_count:
        result.append(fit(((f"{hidden_count} more live outputs", Role.LABEL),), cells))
    return result


def sink_row(sink: SinkSnapshot, name_width: int, cells: int) -> Row:
    """Return name, state and counts of a live output, as far as `cells` cells reach."""
    name = pad(crop_middle(clean(sink.sink), name_width), name_width)
    is_up = sink.state in (SinkState.UP, SinkState.CONNECTING)
    state: Run = (str(sink.state), Role.GOOD)
    if not is_up:
        state = (f" {str(sink.state).upper()} {age(sink.since_s)} ", Role.ALARM)
    fields: list[Run] = [
        (f"published {sink.published}", Role.TEXT),
        (f"dropped {sink.dropped}", Role.WARNING if sink.dropped else Role.TEXT),
        *([(f"waiting {sink.waiting}", Role.WARNING)] if sink.waiting and not is_up else []),
        *([] if is_up else [(clean(reason_text(sink.note)), Role.WARNING)]),
    ]
    return fill_while_fitting(((f"{name} ", Role.LABEL), state), fields, cells, "  " if cells >= _WIDE_CELLS else " ")


def link_row(link: LinkSnapshot, name_width: int, cells: int) -> Row:
    """Return name, state, losses, values of the hub and totals of a link, as far as `cells` cells reach."""
    is_wide = cells >= _WIDE_CELLS
    name = pad(crop_middle(clean(link.link), name_width), name_width)
    state: Run = ("connected" if is_wide else "up", Role.GOOD)
    if not link.connected:
        # A link that has ended as it should stays so.
        silent_s = link.silent_s if link.note.code is not LinkCode.LINK_ENDED else None
        state = (f" DOWN {age(silent_s)} " if silent_s is not None else " DOWN ", Role.ALARM)
    elif link.silent_s is not None:
        state = (f" SILENT {age(link.silent_s)} ", Role.ALARM)
    fields = [*_losses(link, is_wide), *_hub_values(link, " " if is_wide else ""), *_totals(link)]
    note = clean(reason_text(link.note))
    if not link.connected:
        fields.insert(0, (note, Role.WARNING))
    elif link.note.code is not LinkCode.LINK_CONNECTED:
        fields.append((note, Role.LABEL))
    return fill_while_fitting(((f"{name} ", Role.LABEL), state), fields, cells, "  " if is_wide else " ")


def _losses(link: LinkSnapshot, is_wide: bool) -> list[Run]:
    expected = link.frames + link.frames_lost
    overwritten = sum(link.queue_dropped.values())
    high_loss = 100.0 * link.frames_lost > _LOSS_WARNING_PERCENT * expected
    # Nothing is known of the loss while nothing arrives.
    loss = percent(link.frames_lost, expected) if is_heard(link) else MISSING
    return [
        (f"loss {loss}", Role.WARNING if high_loss else Role.TEXT),
        (f"crc {link.crc_errors}", Role.WARNING if link.crc_errors else Role.TEXT),
        (f"{'overwritten' if is_wide else 'overwr'} {overwritten}", Role.WARNING if overwritten else Role.TEXT),
    ]


def is_heard(link: LinkSnapshot) -> bool:
    """Return whether frames arrive on a link now."""
    return link.connected and link.silent_s is None


def _hub_values(link: LinkSnapshot, blank: str) -> list[Run]:
    """Return delay, battery, supply and signal as far as known; `blank` precedes units other than percent.

    Those of a link that is down or silent are old, and left out.
    """
    fields: list[Run] = []
    if not is_heard(link):
        return fields
    if link.latency_s is not None:
        fields.append((f"lag {fixed(link.latency_s, 0, 1e3)}{blank}ms", Role.TEXT))
    if link.battery_percent is not None:
        fields.append((f"bat {link.battery_percent} %", Role.TEXT))
    if link.supply_w is not None:
        fields.append((f"{fixed(link.supply_w, 2)}{blank}W", Role.TEXT))
    if link.rssi_dbm is not None:
        fields.append((f"{link.rssi_dbm}{blank}dBm", Role.TEXT))
    return fields


def _totals(link: LinkSnapshot) -> list[Run]:
    """Return frames and bytes, and the counts of anything unusual that are not 0."""
    unusual: dict[str, int | str] = {
        "noise": file_size(link.noise_bytes) if link.noise_bytes else 0,
        "duplicate": link.duplicates,
        "reordered": link.reordered,
        "skipped": link.skipped,
        **{verdict: count for verdict, count in link.judged.items() if verdict != _VERIFIED},
    }
    texts = [f"{link.frames} frames", file_size(link.bytes_received)]
    texts += [f"{name} {value}" for name, value in unusual.items() if value]
    return [(text, Role.LABEL) for text in texts]


def overwritten_samples(wheels: Sequence[WheelSnapshot], cells: int) -> list[Row]:
    """Return a warning when samples were overwritten before use, else nothing."""
    affected = [
        f"{clean(w.position)} {w.counters.samples_overwritten}" for w in wheels if w.counters.samples_overwritten > 0
    ]
    if not affected:
        return []
    return [fit(((f"samples overwritten before use: {', '.join(affected)}", Role.WARNING),), cells)]


def notices(latest: Sequence[Notice], cells: int, rows: int) -> list[Row]:
    """Return the latest notices, newest last."""
    visible = latest[-rows:] if rows > 0 else ()
    return [fit(((f"· {clean(notice_text(notice))}", Role.TEXT),), cells) for notice in visible]


def keys(
    wheels: int, zoom: Zoom, paused: bool, cells: int, *, has_trend: bool = False, may_record: bool = False
) -> Row:
    """Return the line of keys; that of a recording only where there is room for all."""
    zoom_label = "whole turn" if zoom is Zoom.CONTACT else "±90°"
    entries: tuple[tuple[str, str], ...] = (
        ("space", "resume" if paused else "pause"),
        ("m", "mark"),
        (f"tab 1-{wheels}" if wheels > 1 else "tab", "wheel"),
        ("z", zoom_label),
        ("t", "waveform" if has_trend else "trend"),
        ("?", "help"),
        ("q", "quit"),
    )
    if may_record:
        longer = (*entries[:2], ("r", "record"), *entries[2:])
        if sum(len(key) + len(action) + 3 for key, action in longer) <= cells:
            entries = longer
    row: list[Run] = []
    for key, action in entries:
        row += [(f" {key}", Role.TITLE), (f" {action} ", Role.BAR)]
    return fit(tuple(row), cells, Role.BAR)


def help_rows(cells: int, height: int) -> list[Row]:
    """Return the help page."""
    rows: list[Row] = [(("Help: ? or Escape goes back", Role.TITLE),), ()]
    rows += [((f"{key:>17}  ", Role.VALUE), (text, Role.TEXT)) for key, text in _HELP]
    return [fit(rows[i] if i < len(rows) else (), cells) for i in range(height)]
