"""Recordings of one drive as one: one time line by the clocks of the computers, and what two of them heard once."""

import heapq
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import repeat
from pathlib import Path
from typing import Final

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.framing import next_frame
from firmware_protocol.messages import HUB_ITSELF, Hello
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import ConfigError, RecordingError
from gateway.core.links.source import Chunk, LinkEvent, LinkItem, VehicleData
from gateway.core.recording.reader import REPAIR_REMEDY, RecordingReader
from gateway.core.recording.run_description import NO_DESCRIPTION, Note, RunDescription
from gateway.core.recording.writer import RecordingWriter, whole_recording

# Some minutes of one link: copies of a frame are no further apart, unless a clock is wrong.
_REMEMBERED_FRAMES: Final = 200_000


@dataclass(frozen=True, slots=True)
class MergeReport:
    """Result of merging recordings.

    Attributes:
        target: the new recording.
        items: chunks, bus frames and events in it.
        repeated_frames: frames that were left out because another recording has them.
        noise_bytes: bytes of no frame that were left out, of links that several recordings have.
    """

    target: Path
    items: int
    repeated_frames: int
    noise_bytes: int


@dataclass(slots=True)
class _Content:
    """What a recording holds: wheels by link, hub and number with their sensors, and the span of each link in ns."""

    wheels: dict[tuple[str, int, int], set[int]] = field(default_factory=dict)
    spans_ns: dict[str, tuple[int, int]] = field(default_factory=dict)


class _Once:
    """Frames of one link that several recordings have, each once."""

    def __init__(self) -> None:
        self.repeated = self.noise_bytes = 0
        self._hashes: OrderedDict[int, None] = OrderedDict()
        self._tails: dict[int, bytes] = {}

    def new_frames(self, recording: int, data: bytes) -> bytes:
        """Return those of the frames that `data` completes that no recording has had before."""
        buffer, start, frames = self._tails.get(recording, b"") + data, 0, []
        while True:
            begin, end, _ = next_frame(buffer, start)
            self.noise_bytes += begin - start
            start = begin
            if not end:
                break
            frame = buffer[begin:end]
            key = hash(frame)
            if key in self._hashes:
                self.repeated += 1
            else:
                frames.append(frame)
                self._hashes[key] = None
                if len(self._hashes) > _REMEMBERED_FRAMES:
                    self._hashes.popitem(last=False)
            start = end
        self._tails[recording] = buffer[start:]
        return b"".join(frames)


def _joint_run(readers: Sequence[RecordingReader]) -> RunDescription:
    joint = NO_DESCRIPTION
    for run in (reader.info.described_run() for reader in readers):
        comments = tuple(Note("", line) for line in run.comment.splitlines())
        joint = run.overridden_by(joint).with_notes(comments)
    return joint


def merge_recordings(
    paths: Sequence[Path],
    target: Path,
    *,
    vehicle_toml: str | None = None,
    on_recording: Callable[[Path], None] = lambda _: None,
) -> MergeReport:
    """Write the links of several recordings into a new one, in the order of the computers' clocks.

    Links of different names are taken as they are. Of a link that several recordings have, each frame is taken once;
    of a vehicle bus that several have, each time is taken from the first recording that has it. The run's description
    has comments, tags and notes of all; where they differ in the rest, the first recording counts.

    Args:
        paths: finished recordings, at least two.
        target: must not exist yet.
        vehicle_toml: vehicle configuration of the result; None where those of the recordings are the same.
        on_recording: called with each recording before it is read.

    Raises:
        RecordingError: a recording is unfinished or damaged, their configurations differ, two hubs send the same
            wheel, `target` exists, or the disk is full. There is no target then.
    """
    readers = [_finished(path) for path in paths]
    vehicle_toml = _joint_vehicle(readers, vehicle_toml)
    dbc_text = _common(
        [reader.info.dbc_text for reader in readers], "DBC files", "Record the bus in all of them with the same file."
    )
    contents = []
    for reader in readers:
        on_recording(reader.info.path)
        contents.append(_content(reader))
        if reader.damage is not None:
            raise RecordingError(f"'{reader.info.path}' is damaged", REPAIR_REMEDY)
    _check_wheels(contents, paths)
    starts = [reader.info.start_ns for reader in readers if reader.info.start_ns]
    firsts = [span[0] for content in contents for span in content.spans_ns.values()]
    shared = {link: _Once() for link in _links(contents) if sum(link in content.spans_ns for content in contents) > 1}
    part = RecordingWriter(
        target,
        start_ns=min([*starts, *firsts], default=0),
        vehicle_toml=vehicle_toml,
        sources=tuple(dict.fromkeys(source for reader in readers for source in reader.info.sources)),
        dbc_text=dbc_text,
        run=_joint_run(readers),
        in_part=True,
    )
    with whole_recording(part) as writer:
        for item in _items(readers, contents, shared):
            writer.write(item)
    once = shared.values()
    return MergeReport(
        writer.path, writer.items, sum(link.repeated for link in once), sum(link.noise_bytes for link in once)
    )


def _finished(path: Path) -> RecordingReader:
    reader = RecordingReader(path)
    if reader.info.in_progress:
        raise RecordingError(f"'{reader.info.path}' is being recorded", "Merge it when its session has ended.")
    if not reader.info.finished:
        raise RecordingError(f"'{reader.info.path}' was not finished", REPAIR_REMEDY)
    return reader


def _joint_vehicle(readers: Sequence[RecordingReader], vehicle_toml: str | None) -> str | None:
    """Return the stated configuration with what the recordings say of their sensors, or the one that they share."""
    if vehicle_toml is None:
        return _common(
            [reader.vehicle_toml for reader in readers],
            "vehicle configurations",
            "Give that of the whole drive: --config FILE. Where load, pressure or wear have changed, these are several "
            "drives: estimate them apart, or look at treadlink compare.",
        )
    vehicle = parse_vehicle(vehicle_toml, "the vehicle configuration")
    for reader in readers:
        # What a recording states of the accuracy of its samples is not in another file.
        with suppress(ConfigError):
            vehicle = vehicle.with_sensors_of(parse_vehicle(reader.vehicle_toml or "", str(reader.info.path)))
    return vehicle.to_toml()


def _common(texts: Iterable[str | None], what: str, remedy: str) -> str | None:
    different = list(dict.fromkeys(text for text in texts if text is not None))
    if len(different) > 1:
        lines, others = (text.splitlines() for text in different[:2])
        only = [next((line for line in a if line not in b), "nothing") for a, b in ((lines, others), (others, lines))]
        raise RecordingError(
            f"the recordings have different {what}: '{only[0].strip()}' and '{only[1].strip()}'", remedy
        )
    return different[0] if different else None


def _content(reader: RecordingReader) -> _Content:
    content, decoders = _Content(), dict[str, FrameDecoder]()
    for item in reader.items():
        if isinstance(item, LinkEvent):
            continue
        first_ns, last_ns = content.spans_ns.get(item.link, (item.host_ns, item.host_ns))
        content.spans_ns[item.link] = min(first_ns, item.host_ns), max(last_ns, item.host_ns)
        if isinstance(item, Chunk):
            for frame in decoders.setdefault(item.link, FrameDecoder()).feed(item.data):
                if frame.wheel == HUB_ITSELF:
                    continue
                sensors = content.wheels.setdefault((item.link, frame.hub, frame.wheel), set())
                if isinstance(frame.message, Hello):
                    sensors.add(frame.message.sensor_id)
    return content


def _links(contents: Sequence[_Content]) -> list[str]:
    return list(dict.fromkeys(link for content in contents for link in content.spans_ns))


def _check_wheels(contents: Sequence[_Content], paths: Sequence[Path]) -> None:
    """Raise RecordingError where two links send the same wheel, or two wheels have the same sensor."""
    by_number: dict[tuple[int, int], tuple[str, Path]] = {}
    by_sensor: dict[int, tuple[tuple[str, int, int], Path]] = {}
    remedy = "Merge recordings of one drive, in which each wheel is heard by one hub under one name of its link."
    for content, path in zip(contents, paths, strict=True):
        for (link, hub, wheel), sensors in content.wheels.items():
            other, other_path = by_number.setdefault((hub, wheel), (link, path))
            if other != link:
                raise RecordingError(
                    f"wheel {wheel} of hub {hub} comes from two hubs: of {other} in '{other_path}' and of {link} in "
                    f"'{path}'",
                    remedy,
                )
            for sensor in sensors:
                origin, other_path = by_sensor.setdefault(sensor, ((link, hub, wheel), path))
                if origin != (link, hub, wheel):
                    raise RecordingError(
                        f"the sensor {sensor:08x} comes from two hubs or wheels: hub {origin[1]}, wheel {origin[2]} in "
                        f"'{other_path}' and hub {hub}, wheel {wheel} in '{path}'",
                        remedy,
                    )


def _items(
    readers: Sequence[RecordingReader], contents: Sequence[_Content], shared: dict[str, _Once]
) -> Iterator[LinkItem]:
    """Yield the items of all recordings in the order of their times, without what is repeated."""
    streams = [zip(repeat(number), reader.items()) for number, reader in enumerate(readers)]
    # Frames are compared here and not in the streams, which are read ahead: the first arrival is taken.
    for number, item in heapq.merge(*streams, key=lambda numbered: numbered[1].host_ns):
        if isinstance(item, VehicleData):
            spans = [content.spans_ns[item.link] for content in contents[:number] if item.link in content.spans_ns]
            if not any(first_ns <= item.host_ns <= last_ns for first_ns, last_ns in spans):
                yield item
        elif isinstance(item, Chunk) and item.link in shared:
            data = shared[item.link].new_frames(number, item.data)
            if data:
                yield Chunk(item.link, item.host_ns, data)
        else:
            yield item
