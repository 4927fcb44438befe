"""Output of MCAP files that are never overwritten and stay readable after every failure."""

import errno
import logging
import os
import stat
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import Final

from mcap.records import ChunkIndex
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from gateway import __version__
from gateway.core.errors import RecordingError
from gateway.core.recording.mcap_layout import CHANNEL_METADATA, PROFILE, ChannelInfo, declaration
from gateway.core.recording.schemas import stored_schema
from gateway.core.writing_lock import lock_for_writing

_logger = logging.getLogger(__name__)

_BUFFER_BYTES: Final = 1 << 20
_CHUNK_INDEXES: Final = "_Writer__chunk_indices"
_NUMBERS: Final = struct.Struct("<7QH")
_OFFSET: Final = struct.Struct("<HQ")
# Neighbouring entries are similar, so packs of them compress well.
_PACK_ENTRIES: Final = 512
# Of MCAP.
_LATEST_NS: Final = (1 << 64) - 1


class _GuardedStream:
    """Buffered new file for `mcap` that is cut back to the complete part when a write fails.

    A buffered Python file would keep the data that a full disk rejected, try again at close, and leave a partial
    record behind.
    """

    def __init__(self, path: Path, part: Path | None) -> None:
        self._path = path
        self._is_kept = part is None
        try:
            self._file = _open_new(path) if part is None else _open_part(path, part)
        except OSError as error:
            raise _open_error(path, error) from error
        self._pending = bytearray()
        self._written = 0

    def write(self, data: bytes) -> int:
        self._pending += data
        if len(self._pending) > _BUFFER_BYTES:
            self.flush()
        return len(data)

    def tell(self) -> int:
        return self._written + len(self._pending)

    def flush(self) -> None:
        """Pass all data to the operating system, so that killing this process loses nothing."""
        try:
            view = memoryview(self._pending)
            done = 0
            while done < len(view):
                done += self._file.write(view[done:]) or 0
            view.release()
            if os.fstat(self._file.fileno()).st_nlink == 0:
                raise FileNotFoundError(errno.ENOENT, "the file was deleted while it was written")
        except OSError as error:
            self._cut_back()
            raise _write_error(self._path, error, is_kept=self._is_kept) from error
        self._written += len(self._pending)
        self._pending = bytearray()

    def _cut_back(self) -> None:
        self._pending = bytearray()
        try:
            self._file.truncate(self._written)
        except OSError:
            return  # the device is gone; readers stop at the partial record

    def sync(self) -> None:
        """Write all data through to the disk."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise _write_error(self._path, error, is_kept=self._is_kept) from error

    def close(self) -> None:
        try:
            self._file.close()
        except OSError as error:  # a network folder may refuse only now what it took before
            raise _write_error(self._path, error, is_kept=self._is_kept) from error


class PackedIndexes:
    """List of chunk indexes for appending and one iteration; an entry takes about 45 bytes instead of 700."""

    def __init__(self, compression: str) -> None:
        """Create an empty list for chunks with the same compression."""
        self._compression = compression
        self._packs: list[bytes] = []
        self._open = bytearray()
        self._count = 0

    def __len__(self) -> int:
        """Return the number of entries."""
        return self._count

    def append(self, index: ChunkIndex) -> None:
        """Append an entry."""
        self._open += _NUMBERS.pack(
            index.message_start_time,
            index.message_end_time,
            index.chunk_start_offset,
            index.chunk_length,
            index.message_index_length,
            index.compressed_size,
            index.uncompressed_size,
            len(index.message_index_offsets),
        )
        for channel, offset in index.message_index_offsets.items():
            # Relative to the chunk, so that neighbours are similar.
            self._open += _OFFSET.pack(channel, offset - index.chunk_start_offset)
        self._count += 1
        if self._count % _PACK_ENTRIES == 0:
            self._packs.append(zlib.compress(self._open, 6))
            self._open.clear()

    def __iter__(self) -> Iterator[ChunkIndex]:
        """Yield the entries in order."""
        for pack in self._packs:
            yield from self._entries(zlib.decompress(pack))
        yield from self._entries(bytes(self._open))

    def _entries(self, pack: bytes) -> Iterator[ChunkIndex]:
        position = 0
        while position < len(pack):
            start, end, chunk_start, length, index_length, compressed, uncompressed, count = _NUMBERS.unpack_from(
                pack, position
            )
            position += _NUMBERS.size
            offsets = {}
            for _ in range(count):
                channel, offset = _OFFSET.unpack_from(pack, position)
                offsets[channel] = chunk_start + offset
                position += _OFFSET.size
            yield ChunkIndex(
                message_start_time=start,
                message_end_time=end,
                chunk_start_offset=chunk_start,
                chunk_length=length,
                message_index_offsets=offsets,
                message_index_length=index_length,
                compression=self._compression,
                compressed_size=compressed,
                uncompressed_size=uncompressed,
            )


class McapOutput:
    """MCAP file under construction: channels by topic, and a flush that reaches the operating system."""

    def __init__(
        self, path: Path, *, compressed: bool = False, chunk_bytes: int = 256 << 10, in_part: bool = False
    ) -> None:
        """Create the file and write its header.

        Args:
            path: must not exist yet.
            compressed: whether to write zstd-compressed chunks.
            chunk_bytes: size at which a chunk ends without a flush.
            in_part: write to `NAME.part` in the same folder until `publish`, so that a killed command leaves no
                incomplete file under the final name. What an earlier run left there is replaced.

        Raises:
            RecordingError: the file exists or cannot be created, or another command writes the same part.
        """
        self.path = path
        self.written_path = _part_of(path) if in_part else path
        self._stream = _GuardedStream(path, self.written_path if in_part else None)
        self._writer = Writer(
            self._stream,  # type: ignore[arg-type]  # has the methods that Writer uses: write, tell, flush
            chunk_size=chunk_bytes,
            compression=CompressionType.ZSTD if compressed else CompressionType.NONE,
        )
        # mcap keeps 700 bytes per chunk, 25 MB per hour of recording, and has no option to change that.
        if hasattr(self._writer, _CHUNK_INDEXES):
            setattr(self._writer, _CHUNK_INDEXES, PackedIndexes("zstd" if compressed else ""))
        self._schema_ids: dict[str, int] = {}
        self._channels: dict[ChannelInfo, int] = {}
        self._sequences: dict[int, int] = {}
        self.failed = False
        self.closed = False
        self._writer.start(PROFILE, f"treadlink {__version__} {LIBRARY_IDENTIFIER}")

    @property
    def size_bytes(self) -> int:
        """Size of the file including unflushed data, without the current chunk."""
        return self._stream.tell()

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._guard(lambda: self._writer.add_metadata(name, dict(entries)))

    def register(self, channel: ChannelInfo) -> int:
        """Declare a channel with its schema, if it is new, and return its number.

        The declaration is written twice, in the chunk as required by MCAP and as metadata, so that one damaged place
        does not make the channel unknown.
        """
        registered = self._channels.get(channel)
        if registered is not None:
            return registered
        schema = stored_schema(channel)
        if schema.name not in self._schema_ids:
            self._schema_ids[schema.name] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        entries = {"link": channel.link} if channel.link else {}
        number = self._writer.register_channel(channel.topic, channel.encoding, self._schema_ids[schema.name], entries)
        self._channels[channel] = number
        self._sequences[number] = 0
        self.add_metadata(CHANNEL_METADATA, declaration(number, channel))
        return number

    def add_message(self, channel: int, log_time_ns: int, data: bytes, sequence: int | None = None) -> None:
        """Append a message; its sequence number is counted unless given.

        Raises:
            RecordingError: the disk is full or gone, or the time has no place in a recording.
        """
        if not 0 <= log_time_ns <= _LATEST_NS:
            raise RecordingError(f"the recording '{self.path}' has no place for the time {log_time_ns * 1e-9:g} s", "")
        if sequence is None:
            sequence = self._sequences[channel]
            self._sequences[channel] = (sequence + 1) & 0xFFFFFFFF
        number = sequence
        self._guard(lambda: self._writer.add_message(channel, log_time_ns, data, log_time_ns, number))

    def flush(self) -> None:
        """End the current chunk and pass all bytes to the operating system."""
        self._guard(self._writer.flush)

    def sync(self) -> None:
        """Write all bytes through to the disk, so that a power cut loses nothing."""
        self._guard(self._writer.flush)
        self._guard(self._stream.sync)

    def close(self) -> None:
        """Write index and footer, sync and close. After a failure only close; the written part stays readable."""
        if self.closed:
            return
        self.closed = True
        if self.failed:
            with suppress(RecordingError):  # the failure was reported
                self._stream.close()
            return
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._stream.flush()
            self._stream.sync()
        finally:
            self._stream.close()

    def publish(self) -> None:
        """Give a closed file that was written in a part its name.

        Raises:
            RecordingError: another program created that name meanwhile, or the folder refuses.
        """
        try:
            try:
                os.link(self.written_path, self.path)
            except FileExistsError:
                raise
            except OSError:  # a file system without hard links
                if os.path.lexists(self.path):
                    raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)) from None
                self.written_path.replace(self.path)
            else:
                self.written_path.unlink()
        except OSError as error:
            raise _open_error(self.path, error) from error

    def abandon(self) -> None:
        """Close and delete the incomplete file."""
        if not self.closed:
            self.closed = True
            with suppress(RecordingError):
                self._stream.close()
        with suppress(OSError):  # the folder may be what has gone
            self.written_path.unlink(missing_ok=True)

    def _guard(self, action: Callable[[], object]) -> None:
        if self.failed or self.closed:
            raise RecordingError(f"the recording '{self.path}' is closed", "Start a new recording.")
        try:
            action()
        except BaseException as error:
            # Whatever failed may have left half a record, which must not be written.
            self.failed = True
            if isinstance(error, RecordingError):
                _logger.warning("%s", error)
            raise


def _open_new(path: Path) -> FileIO:
    """Return a new file, locked while it is written."""
    file = FileIO(path, "xb")
    with suppress(BlockingIOError):  # of a reader, which looks at the lock at this moment
        lock_for_writing(file)
    return file


def _open_part(path: Path, part: Path) -> FileIO:
    """Return the empty part of a new file, locked against another command that writes the same.

    Raises:
        OSError: `path` exists, or the part cannot be created.
        RecordingError: it is being written.
    """
    refuse_existing(path)
    file = _opened_part(part, 0)
    status = os.fstat(file.fileno())
    if status.st_nlink != 1 or status.st_uid != getattr(os, "geteuid", lambda: status.st_uid)():
        # It has another name too, as after a kill that came between naming it and removing the part, or belongs to
        # somebody else: what is written here must not get there.
        file.close()
        part.unlink()
        file = _opened_part(part, os.O_EXCL)
    file.truncate(0)
    return file


def refuse_existing(path: Path) -> None:
    """Refuse to write a recording that exists; its part, which a kill after naming it leaves, is removed.

    Raises:
        RecordingError: it exists.
    """
    if not os.path.lexists(path):
        return
    with suppress(OSError):
        if path.samefile(part := _part_of(path)):
            part.unlink()
    raise _open_error(path, FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)))


def _part_of(path: Path) -> Path:
    return path.with_name(f"{path.name}.part")


def _opened_part(part: Path, more_flags: int) -> FileIO:
    """Return a part, opened and locked.

    Raises:
        OSError: it cannot be created, or is no regular file.
        RecordingError: it is being written.
    """
    flags = os.O_RDWR | os.O_CREAT | more_flags
    for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY"):
        flags |= getattr(os, name, 0)
    file = FileIO(os.open(part, flags, 0o666), "r+b")
    try:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, f"'{part}' is not a regular file")
        lock_for_writing(file)
    except BlockingIOError as error:
        file.close()
        raise RecordingError(
            f"'{part}' is being written by another command", "Wait for it to end, or give another name."
        ) from error
    except BaseException:
        file.close()
        raise
    return file


def _open_error(path: Path, error: OSError) -> RecordingError:
    if isinstance(error, FileExistsError):
        return RecordingError(f"'{path}' already exists", "Recordings are never overwritten. Give another name.")
    if isinstance(error, FileNotFoundError):
        return RecordingError(f"the folder '{path.parent}' does not exist", f"Create it: mkdir -p '{path.parent}'")
    if isinstance(error, PermissionError):
        return RecordingError(f"no permission to write '{path}'", "Choose another folder.")
    return RecordingError(f"cannot create '{path}': {error.strerror}", "Choose another folder or disk.")


def _write_error(path: Path, error: OSError, *, is_kept: bool) -> RecordingError:
    """Return what has gone wrong; `is_kept` is whether the file is kept, as that of a session is."""
    consequence = "the part written before stays readable" if is_kept else "nothing is left of it"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return RecordingError(
            f"disk full while writing '{path}'; {consequence}", "Free some space, or choose another disk."
        )
    if error.errno == errno.ENOENT:
        return RecordingError(
            f"the recording '{path}' was deleted while it was written", "Record to a folder that is not cleaned up."
        )
    return RecordingError(
        f"cannot write the recording '{path}': {error.strerror}; {consequence}",
        "Check the disk, or record to another one.",
    )
