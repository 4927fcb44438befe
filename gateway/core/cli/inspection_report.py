"""Report of an inspected recording, as lines and as JSON."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any, Final

from firmware_protocol.messages import HUB_ITSELF, Axis, Hello
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.links.nmea_sentences import Fix, can_read_sentences
from gateway.core.reasons import CoreCode, Notice, Reason
from gateway.core.recording.inspection import AlarmSpan, Inspection, LinkInspection, ReceiverInspection, WheelInspection
from gateway.core.recording.reader import RecordingInfo
from gateway.core.recording.writer import utc_text
from gateway.core.text.numbers import duration, fixed, percent
from gateway.core.text.recording_topics import log_level
from gateway.core.text.text import escaped, file_size
from gateway.core.text.wording import as_json, notice_text, text

_BARS: Final = " ▁▂▃▄▅▆▇█"
_LINE_CELLS: Final = 64
_SECOND_NS: Final = 1_000_000_000
_EVENTS_SHOWN: Final = 30
_BOOTS_SHOWN: Final = 10


def inspection_lines(inspection: Inspection, notices: Sequence[Notice]) -> Iterator[str]:
    """Yield the lines of one recording."""
    info = inspection.info
    begin, end = inspection.span_ns
    yield f"{info.path}"
    yield f"  {file_size(info.size_bytes)}, {duration((end - begin) * 1e-9)} of data, {_state_text(info)}"
    if info.start_ns is not None:
        version = f" by treadlink {info.treadlink}" if info.treadlink else ""
        yield f"  started {utc_text(info.start_ns)}{version} from {', '.join(info.sources) or 'an unknown source'}"
    yield "  vehicle configuration: " + ("included" if info.vehicle_toml else "none")
    for line in info.described_run().lines():
        yield f"  {line}"
    for name, link in inspection.links.items():
        yield ""
        yield from _link_lines(name, link, begin, end)
    if notices:
        yield ""
        yield "  notices"
        for notice in notices:
            yield f"    {notice_text(notice)}"
    for name, link in inspection.links.items():
        yield from _log_lines(name, link, begin)
    yield from _event_lines(inspection, begin)
    yield from _alarm_lines(inspection, begin)
    if inspection.topics:
        yield ""
        yield "  decoded topics: " + ", ".join(
            f"{topic} ({count})" for topic, count in sorted(inspection.topics.items())
        )
    if inspection.damage:
        yield ""
        yield f"  DAMAGED: {text(inspection.damage)}"


def _event_lines(inspection: Inspection, begin_ns: int) -> Iterator[str]:
    if not inspection.events:
        return
    yield ""
    yield "  events"
    for event in inspection.events[:_EVENTS_SHOWN]:
        time_s = (event.host_ns - begin_ns) * 1e-9
        words = text(event.reason)
        entry = f"{event.link}: {words}" if event.is_of_link else words
        yield f"    {fixed(time_s, 2):>9} s  {entry}"
    if len(inspection.events) > _EVENTS_SHOWN:
        printed = f"the first {len(inspection.events)}" if inspection.events_omitted else "all"
        omitted = len(inspection.events) + inspection.events_omitted - _EVENTS_SHOWN
        yield f"    ... and {omitted} more (--json prints {printed})"


def _alarm_lines(inspection: Inspection, begin_ns: int) -> Iterator[str]:
    if not inspection.alarms:
        return
    yield ""
    yield "  alarms"
    for alarm in inspection.alarms[:_EVENTS_SHOWN]:
        yield f"    {_alarm_text(alarm, begin_ns)}"
    if len(inspection.alarms) > _EVENTS_SHOWN:
        yield f"    ... and {len(inspection.alarms) - _EVENTS_SHOWN} more (--json prints all)"


def _state_text(info: RecordingInfo) -> str:
    if info.finished:
        return "finished"
    if info.in_progress:
        return "BEING RECORDED: this is what it contains so far"
    return "NOT FINISHED (recording was interrupted); `treadlink repair` completes it"


def _alarm_text(alarm: AlarmSpan, begin_ns: int) -> str:
    def since_begin(time_ns: int) -> str:
        return f"{fixed((time_ns - begin_ns) * 1e-9, 2)} s"

    end = "the end" if alarm.end_ns is None else since_begin(alarm.end_ns)
    acknowledged = "" if alarm.acknowledged_ns is None else f" (acknowledged at {since_begin(alarm.acknowledged_ns)})"
    return f"{since_begin(alarm.begin_ns):>11} to {end}  {escaped(alarm.subject)}: {escaped(alarm.text)}{acknowledged}"


def _log_lines(name: str, link: LinkInspection, begin_ns: int) -> Iterator[str]:
    if link.log:
        yield ""
        yield f"  log of the hubs of {name}"
    for line in link.log[:_EVENTS_SHOWN]:
        time_s = (line.host_ns - begin_ns) * 1e-9
        yield f"    {fixed(time_s, 2):>9} s  hub {line.hub}: {log_level(line.message)}: {escaped(line.message.text)}"
    if link.log_lines > _EVENTS_SHOWN:
        yield f"    ... and {link.log_lines - _EVENTS_SHOWN} more (--json prints up to {len(link.log)})"


def _link_lines(name: str, link: LinkInspection, begin: int, end: int) -> Iterator[str]:
    counted = link.counters
    seconds = max((link.last_ns - link.first_ns) * 1e-9, 1e-9)
    yield f"  {name}"
    yield (
        f"    {file_size(link.bytes_received)} in {link.chunks} chunks, "
        f"{link.bytes_received / seconds / 1e3:.1f} kB/s, longest gap {link.longest_silence_s:.2f} s"
    )
    if link.bus_frames:
        yield f"    {link.bus_frames} frames of a vehicle bus, {link.bus_frames / seconds:.1f} per second"
        return
    if link.sensor_lines:
        yield f"    {link.sensor_lines} lines of rtl_433, a receiver of tire pressure sensors"
        return
    if link.receiver is not None:
        yield from _receiver_lines(link.receiver)
        return
    total = counted.frames + counted.lost
    yield (
        f"    {counted.frames} frames, {counted.lost} lost ({percent(counted.lost, total)}), "
        f"{counted.crc_errors} with a bad CRC, {counted.duplicates} duplicate, {counted.reordered} late, "
        f"{counted.skipped} skipped, {counted.noise_bytes} noise bytes, {counted.restarts} counter restarts"
        + (f", {counted.bad_payload} with a bad payload" if counted.bad_payload else "")
    )
    for (hub, wheel), source in sorted(link.wheels.items()):
        sender = f"hub {hub}" if wheel == HUB_ITSELF else f"hub {hub} wheel {wheel}"
        kinds = ", ".join(f"{count} {kind}" for kind, count in source.frames.most_common())
        yield f"    {sender}: {kinds}"
        if source.hello is not None:
            yield f"      {_hello_text(source.hello)}"
        elif source.samples:
            yield f"      {text(Reason(CoreCode.SAMPLES_WITHOUT_HELLO, count=source.frames['samples']))}"
        if len(source.boots) > 1:
            boots = [*map(str, source.boots[:_BOOTS_SHOWN])]
            more = f" and {len(source.boots) - _BOOTS_SHOWN} more" if len(source.boots) > _BOOTS_SHOWN else ""
            yield f"      the hub restarted: boot counts {', '.join(boots)}{more}"
        if source.samples:
            lost = source.samples_lost
            share = percent(lost, source.samples + lost)
            rate = f", {source.measured_hz:.2f} Hz by the hub's clock" if source.measured_hz else ""
            yield f"      {source.samples} samples, {lost} lost ({share}){rate}"
            yield from _time_line(source, begin, end)


def _receiver_lines(receiver: ReceiverInspection) -> Iterator[str]:
    reader, first, last, ahead_s = receiver.reader, receiver.first, receiver.last, receiver.clock.ahead_s
    counts = f"{reader.fixes} with a position, {reader.without_fix} without, {reader.damaged} damaged"
    yield f"    {reader.sentences} sentences of a receiver, {counts}"
    if reader.sentences and not can_read_sentences():
        yield f"    {text(Reason(CoreCode.SENTENCES_UNREAD))}"
    if first is not None and last is not None:
        yield f"    from {_coordinates(first)} to {_coordinates(last)} (latitude and longitude in degrees)"
    if ahead_s is not None:
        yield f"    {text(Reason(CoreCode.RECEIVER_TIME, ahead_s=ahead_s))}"


def _coordinates(fix: Fix) -> str:
    return f"{fix.latitude_deg:.6f}, {fix.longitude_deg:.6f}"


def _receiver_json(receiver: ReceiverInspection) -> dict[str, Any]:
    reader, first, last = receiver.reader, receiver.first, receiver.last
    return {
        "sentences": reader.sentences,
        "with_position": reader.fixes,
        "without_position": reader.without_fix,
        "damaged": reader.damaged,
        "first_deg": None if first is None else [first.latitude_deg, first.longitude_deg],
        "last_deg": None if last is None else [last.latitude_deg, last.longitude_deg],
        "ahead_s": receiver.clock.ahead_s,
    }


def _range_text(range_mps2: float) -> str:
    return f" ±{range_mps2 / STANDARD_GRAVITY_MPS2:.0f} g" if range_mps2 else " of unknown range"


def _hello_text(hello: Hello) -> str:
    axes = [axis for axis in Axis if hello.axes >> axis & 1]
    names = ", ".join(f"{axis.name.lower()}{_range_text(hello.range_mps2[axis])}" for axis in axes)
    highpass = f" above {hello.highpass_hz:g} Hz" if hello.coupling and hello.highpass_hz else ""
    firmware = ".".join(map(str, hello.firmware))
    return (
        f"sensor {hello.sensor_id:08x} of hub {hello.hub_id:016x}, firmware {firmware}, protocol "
        f"{hello.protocol_major}.{hello.protocol_minor}, {hello.rate_hz:g} Hz, {names}, {hello.coupling.name}{highpass}"
    )


def _time_line(source: WheelInspection, begin: int, end: int) -> Iterator[str]:
    """Yield two rows: the received share of the samples, and the places of lost samples."""
    first_s, seconds = begin // _SECOND_NS, end // _SECOND_NS - begin // _SECOND_NS + 1
    # Cells of equal length: a cell of two seconds beside those of one would look twice as full.
    per_cell = -(-seconds // _LINE_CELLS)
    cells = -(-seconds // per_cell)
    got, lost = [0.0] * cells, [0.0] * cells
    for second, (samples, missing) in source.seconds.items():
        cell = min(cells - 1, max(0, (second - first_s) // per_cell))
        got[cell] += samples
        lost[cell] += missing
    expected = _expected(source, begin, end, cells, per_cell)
    # A cell begins and ends within a block.
    slack = 2.0 * source.samples / max(source.frames["samples"], 1)
    if expected is not None:
        # What is lost is counted, and what was held up arrives, with the next block.
        _move_back(lost, [full - received for full, received in zip(expected, got, strict=True)], slack)
        _move_back(got, [full - loss for full, loss in zip(expected, lost, strict=True)], slack)
    shares = [min(samples / max(samples + loss, 1.0), 1.0) for samples, loss in zip(got, lost, strict=True)]
    if expected is not None:
        shares = [
            min(share, received / max(full - slack, 1.0))
            for share, received, full in zip(shares, got, expected, strict=True)
        ]
    top = len(_BARS) - 1
    yield "      " + "".join(_BARS[max(1, round(top * share)) if share > 0.0 else 0] for share in shares)
    if any(lost):
        yield "      " + "".join("x" if value else " " for value in lost) + "  x: samples lost"


def _expected(source: WheelInspection, begin: int, end: int, cells: int, per_cell: int) -> list[float] | None:
    """Return the samples of each cell at the sensor's rate, fewer in the first and last; None without a rate."""
    rate_hz = source.measured_hz or (source.hello.rate_hz if source.hello is not None else 0.0)
    if not rate_hz > 0.0:
        return None
    starts = [(begin // _SECOND_NS + k * per_cell) * _SECOND_NS for k in range(cells)]
    length = per_cell * _SECOND_NS
    return [rate_hz * max(min(start + length, end) - max(start, begin), 0) * 1e-9 for start in starts]


def _move_back(counts: list[float], room: Sequence[float], slack: float) -> None:
    """Move what a cell has beyond its room to the cells before it that have some, more than the slack."""
    for cell in range(len(counts) - 1, 0, -1):
        for target_cell in range(cell - 1, -1, -1):
            free_room = room[target_cell] - counts[target_cell]
            shift = min(counts[cell] - max(room[cell], 0.0), free_room)
            if free_room <= slack or shift <= 0.0:
                break
            counts[cell] -= shift
            counts[target_cell] += shift


def inspection_json(inspection: Inspection, notices: Sequence[Notice]) -> dict[str, Any]:
    """Return the content of one recording."""
    info = inspection.info
    begin, end = inspection.span_ns
    return {
        "recording": str(info.path),
        "size_bytes": info.size_bytes,
        "finished": info.finished,
        "in_progress": info.in_progress,
        "damage": None if inspection.damage is None else text(inspection.damage),
        "damage_reason": None if inspection.damage is None else as_json(inspection.damage),
        "treadlink": info.treadlink,
        "start_ns": info.start_ns,
        "sources": list(info.sources),
        "run": info.described_run().as_dict(),
        "duration_s": (end - begin) * 1e-9,
        "links": {name: _link_json(link) for name, link in inspection.links.items()},
        "notices": [
            {"subject": notice.subject, "level": str(notice.level), "reason": as_json(notice.reason)}
            for notice in notices
        ],
        "events": [
            {
                "host_ns": event.host_ns,
                "link": event.link,
                "kind": str(event.kind),
                "text": event.text or text(event.reason),
                "reason": as_json(event.reason),
            }
            for event in inspection.events
        ],
        "events_omitted": inspection.events_omitted,
        "alarms": [asdict(alarm) for alarm in inspection.alarms],
        "topics": inspection.topics,
    }


def _link_json(link: LinkInspection) -> dict[str, Any]:
    counted = link.counters
    return {
        "bytes": link.bytes_received,
        "chunks": link.chunks,
        "longest_silence_s": link.longest_silence_s,
        "frames": counted.frames,
        "frames_lost": counted.lost,
        "crc_errors": counted.crc_errors,
        "duplicates": counted.duplicates,
        "reordered": counted.reordered,
        "skipped": counted.skipped,
        "bad_payload": counted.bad_payload,
        "noise_bytes": counted.noise_bytes,
        "restarts": counted.restarts,
        "log": [
            {"host_ns": line.host_ns, "hub": line.hub, "level": log_level(line.message), "text": line.message.text}
            for line in link.log
        ],
        "log_lines": link.log_lines,
        "bus_frames": link.bus_frames,
        "sensor_lines": link.sensor_lines,
        "receiver": None if link.receiver is None else _receiver_json(link.receiver),
        "sources": [
            {
                "hub": hub,
                "wheel": None if wheel == HUB_ITSELF else wheel,
                "frames": dict(source.frames),
                "sensor_id": f"{source.hello.sensor_id:08x}" if source.hello is not None else None,
                "rate_hz": source.hello.rate_hz if source.hello is not None else None,
                "measured_hz": source.measured_hz,
                "samples": source.samples,
                "samples_lost": source.samples_lost,
                "boots": source.boots,
            }
            for (hub, wheel), source in sorted(link.wheels.items())
        ],
    }
