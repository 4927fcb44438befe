"""Compression of a finished recording, verified before the original is replaced."""

import itertools
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.core.errors import RecordingError
from gateway.core.recording.container import McapOutput
from gateway.core.recording.mcap_layout import SESSION_METADATA
from gateway.core.recording.reader import REPAIR_REMEDY, RecordingReader
from gateway.core.recording.run_description import copy_notes

Progress = Callable[[int, int], None]

# About a second of four wheels; damage to a compressed chunk loses the whole chunk.
_CHUNK_BYTES: Final = 256 << 10
_PROGRESS_MESSAGES: Final = 1024


@dataclass(frozen=True, slots=True)
class CompactReport:
    """Result of compressing a recording.

    Attributes:
        source: the recording.
        target: the compressed copy; the path of the recording when it was replaced.
        messages: number of messages.
        bytes_before: size of the recording.
        bytes_after: size of the compressed copy.
    """

    source: Path
    target: Path
    messages: int
    bytes_before: int
    bytes_after: int


def compact_recording(
    path: Path, target: Path, *, replace: bool = False, progress: Progress | None = None
) -> CompactReport:
    """Write a zstd-compressed copy of a recording, with its notes, and compare both.

    Args:
        path: a finished recording.
        target: must not exist yet.
        replace: replace the recording, or what a link leads to, by the verified copy, in one step.
        progress: called from time to time with (bytes done, bytes in total) of writing and comparing.

    Raises:
        RecordingError: the recording is unfinished or damaged, `target` exists, or the disk is full. The recording
            is unchanged.
    """
    reader = RecordingReader(path)
    if reader.info.in_progress:
        raise RecordingError(f"'{path}' is being recorded", "Compress it when its session has ended.")
    if not reader.info.finished:
        raise RecordingError(f"'{path}' is not finished", "Run `treadlink repair` first and compress the result.")
    output = McapOutput(target, compressed=True, chunk_bytes=_CHUNK_BYTES, in_part=True)
    try:
        messages = _copy(reader, output, progress)
        output.close()
        if reader.damage is not None:
            raise RecordingError(f"'{path}' is damaged and was not compressed", REPAIR_REMEDY)
        _check_same(reader, RecordingReader(output.written_path), progress)
        before, after = reader.info.size_bytes, output.written_path.stat().st_size
        if replace:
            _replace(path, output.written_path)
        else:
            copy_notes(path, target)
            output.publish()
    except BaseException:
        output.abandon()
        raise
    return CompactReport(path, path if replace else target, messages, before, after)


def _copy(reader: RecordingReader, output: McapOutput, progress: Progress | None) -> int:
    if reader.session:
        output.add_metadata(SESSION_METADATA, reader.session)
    count = 0
    for message in reader.messages():
        channel = output.register(message.channel)
        output.add_message(channel, message.log_time_ns, message.data, message.sequence)
        count += 1
        if progress is not None and count % _PROGRESS_MESSAGES == 0:
            progress(reader.position, 2 * reader.info.size_bytes)
    for name, entries in reader.notes:
        output.add_metadata(name, entries)
    if reader.session:
        output.add_metadata(SESSION_METADATA, reader.session)
    return count


def _check_same(original: RecordingReader, copy: RecordingReader, progress: Progress | None) -> None:
    size = original.info.size_bytes
    pairs = itertools.zip_longest(original.messages(), copy.messages())
    for count, (ours, theirs) in enumerate(pairs):
        if ours != theirs:
            raise RecordingError(
                f"the compressed copy of '{original.info.path}' differs in message {count}",
                "The recording is unchanged. Check the disk and try again.",
            )
        if progress is not None and count % _PROGRESS_MESSAGES == 0:
            progress(size + original.position, 2 * size)
    if copy.damage is not None or not copy.info.finished or copy.session != original.session:
        raise RecordingError(
            f"the compressed copy of '{original.info.path}' is damaged or incomplete",
            "The recording is unchanged. Check the disk and try again.",
        )


def _replace(path: Path, target: Path) -> None:
    try:
        shutil.copymode(path, target)
        target.replace(os.path.realpath(path))
    except OSError as error:
        raise RecordingError(f"cannot replace '{path}': {error.strerror}", "Check its permissions.") from error
