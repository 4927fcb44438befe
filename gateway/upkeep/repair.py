"""Repair of recordings that were interrupted, cut off or damaged."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from firmware_protocol.decoder import FrameDecoder
from gateway.core.errors import RecordingError
from gateway.core.recording.container import McapOutput
from gateway.core.recording.mcap_layout import RAW_ENCODING, REPAIR_METADATA, SESSION_METADATA
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.regular_file import open_recording_file
from gateway.core.recording.run_description import copy_notes
from gateway.upkeep.file_window import FileWindow
from gateway.upkeep.salvage import Salvage
from gateway.upkeep.stitch import Losses, Stitcher

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class RepairReport:
    """Result of a repair.

    Attributes:
        source: the damaged file.
        target: the repaired file.
        messages: number of recovered messages.
        link_bytes: number of recovered link bytes.
        frames: number of intact frames in them.
        frames_lost: frames missing by their counters.
        frames_broken: incomplete frames, including those hit by the damage.
        losses: counts of the damaged places.
        session_kept: whether the description with configuration and sources was recovered.
    """

    source: Path
    target: Path
    messages: int
    link_bytes: int
    frames: int
    frames_lost: int
    frames_broken: int
    losses: Losses
    session_kept: bool


def needs_repair(path: Path, progress: Progress | None = None) -> bool:
    """Return whether a recording is unfinished or damaged, by reading all of it.

    Raises:
        RecordingError: the file does not exist, cannot be read, or is being written.
    """
    try:
        reader = RecordingReader(path)
    except RecordingError:
        if not path.is_file():
            raise
        return True
    if reader.info.in_progress:
        raise RecordingError(
            f"'{path}' is being recorded: there is nothing to repair",
            "Its session completes it at its end. All commands read what it contains so far.",
        )
    for number, _ in enumerate(reader.messages()):
        if progress is not None and number % 4096 == 0:
            progress(reader.position, reader.info.size_bytes)
    return reader.damage is not None or not reader.info.finished


def repair_recording(path: Path, target: Path, progress: Progress | None = None) -> RepairReport:
    """Write the recoverable part of a recording, and its notes, to a new file.

    Memory is bounded, whatever the file's size: a window of it (4 MiB), a few copies of a record or torn place (16 MiB
    each), and the index. The new file gets its name when it is complete.

    In a plain recording only the damaged frames are lost, in a compressed one whole chunks.

    Args:
        path: the damaged file, which is not changed.
        target: must not exist yet.
        progress: called from time to time with (bytes done, bytes in total).

    Raises:
        RecordingError: nothing can be recovered, `target` exists, or the disk is full.
    """
    with open_recording_file(path) as file:
        data = FileWindow(file, path)
        if not len(data):
            raise RecordingError(f"'{path}' is empty", "It contains nothing to recover.")
        salvage = Salvage(data)
        stitcher = Stitcher(salvage)
        output = McapOutput(target, in_part=True)
        try:
            report = _write(path, salvage, stitcher, output, progress)
            if not report.messages:
                raise RecordingError(f"nothing in '{path}' can be recovered", "It contains no message of a recording.")
            output.close()
            copy_notes(path, target)
            output.publish()
        except BaseException:
            output.abandon()
            raise
    return report


def _write(
    path: Path, salvage: Salvage, stitcher: Stitcher, output: McapOutput, progress: Progress | None
) -> RepairReport:
    if salvage.session:
        output.add_metadata(SESSION_METADATA, salvage.session)
    decoders: dict[str, FrameDecoder] = {}
    messages = link_bytes = 0
    for message in stitcher.messages():
        channel = output.register(message.channel)
        output.add_message(channel, message.log_time_ns, message.data)
        messages += 1
        if message.channel.encoding == RAW_ENCODING:
            link_bytes += len(message.data)
            decoders.setdefault(message.channel.link, FrameDecoder()).feed(message.data)
        if progress is not None and messages % 4096 == 0:
            progress(salvage.position, salvage.size)
    for decoder in decoders.values():
        decoder.finish()
    counters = [decoder.counters for decoder in decoders.values()]
    losses = stitcher.losses
    if salvage.session:
        output.add_metadata(SESSION_METADATA, salvage.session)
    output.add_metadata(
        REPAIR_METADATA,
        {
            "file": path.name,
            "torn_places": str(losses.torn_places),
            "bytes_kept": str(losses.bytes_kept),
            "bytes_dropped": str(losses.bytes_dropped),
            "compressed_chunks_lost": str(losses.compressed_chunks),
        },
    )
    return RepairReport(
        source=path,
        target=output.path,
        messages=messages,
        link_bytes=link_bytes,
        frames=sum(count.intact for count in counters),
        frames_lost=sum(count.lost for count in counters),
        frames_broken=sum(count.crc_errors + count.truncated for count in counters),
        losses=losses,
        session_kept=bool(salvage.session),
    )
