"""Running of `treadlink protocol check` and `treadlink protocol dump`."""

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from firmware_protocol.decoder import FrameDecoder
from gateway.core.cli.stop_signals import StopRequest, stop_request
from gateway.core.clock import Clock
from gateway.core.errors import LinkLostError, SourceError, TreadlinkError
from gateway.core.links.source import (
    DEFAULT_BAUDRATE,
    Chunk,
    LinkEvent,
    LinkEventKind,
    LinkItem,
    TwoWaySource,
    is_live,
    open_source,
    parse_source_uri,
)
from gateway.core.links.time_limit import limited
from gateway.core.reasons import Reason
from gateway.core.recording.recorded_file import open_recorded_file
from gateway.core.text.text import escaped
from gateway.core.text.wording import text
from gateway.makers.check.clauses import CheckReport
from gateway.makers.check.command_trial import CLAUSES, CommandTrial
from gateway.makers.check.firmware_check import FirmwareCheck
from gateway.makers.read_ahead import ReadAheadSource
from gateway.makers.reasons import FirmwareCode
from gateway.makers.views.frame_lines import FrameLines
from gateway.security.cmac import Key

# A serial byte takes ten bits: a start bit and a stop bit beside its own.
_BITS_PER_BYTE: Final = 10
# A silent link is waited for a little longer than a speaking one.
_GRACE_S: Final = 0.5


def check_link(
    source: str,
    *,
    for_s: float | None,
    keys: Mapping[str, Key],
    radius_m: float,
    sends_commands: bool,
    clock: Clock,
    say: Callable[[str], None],
) -> list[CheckReport]:
    """Check the firmware behind a URI, or a recording or raw dump.

    A signal, or a link that breaks, ends it with a report of what there was; a file goes on with its other links.

    Returns:
        Reports by link; of a file, by connection.

    Raises:
        SourceError: the source cannot be opened.
        RecordingError: the file cannot be read.
        LinkLostError: the link of a URI broke before anything arrived.
    """
    checks: dict[str, FirmwareCheck] = {}
    ended: list[FirmwareCheck] = []
    capacity = _capacity_bytes_per_s(source)

    def link_check(link: str) -> FirmwareCheck:
        if link not in checks:
            checks[link] = FirmwareCheck(link, keys, radius_m=radius_m, capacity_bytes_per_s=capacity)
        return checks[link]

    trial: CommandTrial | None = None
    with stop_request() as stop, _items(source, for_s, clock, stop, reads_ahead=True) as (items, two_way):
        for item in items:
            if isinstance(item, LinkEvent) and item.kind is LinkEventKind.LOST:
                if not checks and not is_file(source):
                    raise LinkLostError(item.text, "Is the firmware running?")
                say(f"{escaped(item.link)}: {text(item.reason)}")
                if not is_file(source):
                    break
                # What is not received until it connects again is no fault of the firmware.
                ended += filter(None, [checks.pop(item.link, None)])
            if isinstance(item, LinkEvent) and item.kind is LinkEventKind.CONNECTED and two_way and sends_commands:
                trial = CommandTrial(link_check(item.link).ledger, keys)
            if not isinstance(item, Chunk):
                continue
            check = link_check(item.link)
            frames = check.chunk(item)
            if trial is not None and two_way is not None:
                _try_out(trial, two_way, trial.step(frames, item.host_ns), check, clock)
    ended += checks.values()
    if trial is not None:
        trial.finish()
    else:
        reason = Reason(FirmwareCode.CHECK_NOT_DONE, why="no_commands" if sends_commands else "no_commands_wanted")
        for check in ended:
            for clause in CLAUSES:
                check.ledger.leave(clause, reason)
    return [check.finish() for check in ended or [link_check(source)]]


def _try_out(trial: CommandTrial, source: TwoWaySource, data: bytes, check: FirmwareCheck, clock: Clock) -> None:
    """Send a trial's bytes; a link that takes none is one whose hub takes no commands."""
    if trial.pausing is not None:
        check.may_pause(trial.pausing)
        trial.pausing = None
    if data:
        try:
            source.send(data)
            trial.sent(clock.now_ns())
        except (LinkLostError, SourceError):
            trial.finish()


def dump_frames(source: str, *, for_s: float | None, clock: Clock, write: Callable[[str], None]) -> None:
    """Write the frames of a source as lines, while they arrive, until a signal comes.

    Raises:
        SourceError: the source cannot be opened.
        RecordingError: the file cannot be read.
    """
    lines: dict[str, tuple[FrameDecoder, FrameLines]] = {}
    with stop_request() as stop, _items(source, for_s, clock, stop) as (items, _):
        for item in items:
            if not isinstance(item, Chunk):
                continue
            if item.link not in lines:
                lines[item.link] = FrameDecoder(), FrameLines()
            decoder, frame_lines = lines[item.link]
            frames = decoder.feed(item.data)
            for line in frame_lines.lines(frames, decoder.counters, item.host_ns):
                write(line)


@contextmanager
def _items(
    source: str, for_s: float | None, clock: Clock, stop: StopRequest, *, reads_ahead: bool = False
) -> Iterator[tuple[Iterator[LinkItem], TwoWaySource | None]]:
    """Yield the items of a URI or a file, and where commands can be sent to.

    What writes every frame does not read ahead: a reader that stops, such as a pager, would let the memory grow.
    """
    if is_file(source):
        recorded = open_recorded_file(source)
        yield _until(recorded.items(), for_s, stop), None
        return
    opened_source = open_source(source, clock)
    two_way = opened_source if isinstance(opened_source, TwoWaySource) else None
    timer: threading.Timer | None = None
    if for_s is not None and is_live(source):
        # A silent link yields no item that could end it.
        timer = threading.Timer(for_s + _GRACE_S, stop.set)
        timer.daemon = True
        timer.start()
    buffered = ReadAheadSource(opened_source) if reads_ahead and is_live(source) else opened_source
    time_limited = buffered if for_s is None else limited(buffered, for_s)
    try:
        yield time_limited.items(stop), two_way
    finally:
        if timer is not None:
            timer.cancel()
        opened_source.close()


def _until(items: Iterator[LinkItem], for_s: float | None, stop: StopRequest) -> Iterator[LinkItem]:
    begin_ns: int | None = None
    for item in items:
        begin_ns = item.host_ns if begin_ns is None else begin_ns
        if stop.is_set() or (for_s is not None and (item.host_ns - begin_ns) * 1e-9 > for_s):
            return
        yield item


def _capacity_bytes_per_s(source: str) -> float | None:
    """Return what a serial port carries; None where that is not known."""
    if is_file(source):
        return None
    address = parse_source_uri(source)
    if address.scheme != "serial":
        return None
    try:
        return float(address.options.get("baudrate", DEFAULT_BAUDRATE)) / _BITS_PER_BYTE
    except ValueError as error:
        raise SourceError(f"'{source}' has no baud rate", "Give a number, for example ?baudrate=115200.") from error


def is_file(source: str) -> bool:
    """Return whether a source is the name of a file rather than a URI."""
    return Path(source).is_file() or ":" not in source


def duration_s(shown: str) -> float:
    """Return the seconds of a duration such as `60s`, `2min` or `90`.

    Raises:
        TreadlinkError: it is none.
    """
    for unit, seconds in (("min", 60.0), ("s", 1.0), ("", 1.0)):
        number = shown.removesuffix(unit)
        if shown.endswith(unit) and number.replace(".", "", 1).isdigit() and float(number) > 0.0:
            return float(number) * seconds
    raise TreadlinkError(f"'{shown}' is no duration", "Give seconds or minutes, for example 60s or 2min.")
