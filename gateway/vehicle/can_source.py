"""Sources of vehicle signals: a CAN bus, or a log file of one, by python-can."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gateway.core.bounded_input import MAX_DBC_BYTES
from gateway.core.clock import Clock, wait_until
from gateway.core.errors import SourceError
from gateway.core.links.bus_frames import BusFrame, pack
from gateway.core.links.reasons import LinkCode
from gateway.core.links.reconnect import Backoff, BriefConnections
from gateway.core.links.source import (
    BusFrames,
    LinkEvent,
    LinkEventKind,
    LinkItem,
    Source,
    SourceAddress,
)
from gateway.core.reasons import Reason
from gateway.vehicle.can_log import channel_number, frame_of, logged_frames
from gateway.vehicle.dbc_file import read_dbc
from gateway.vehicle.log_file import LogFile
from gateway.vehicle.log_sources import CAN_FILE_SUFFIXES
from gateway.vehicle.reasons import VehicleCode

if TYPE_CHECKING:
    import can

_logger = logging.getLogger(__name__)

# Frames of this time share an item.
_BLOCK_NS: Final = 10_000_000
_MOST_FRAMES: Final = 256
_WAIT_S: Final = 0.1


def open_can_source(address: SourceAddress, clock: Clock) -> Source:
    """Open `can:INTERFACE:CHANNEL?bitrate=500000&dbc=FILE`, or `can:FILE?dbc=FILE&channel=1&speed=1|10|max&offset_s=0`.

    Raises:
        SourceError: python-can is missing, or address, file or option cannot be used.
    """
    try:
        import can
    except ModuleNotFoundError as error:
        raise SourceError(
            "a CAN source needs the package 'can', which is not installed",
            "Install it with: pip install 'treadlink[can]'",
        ) from error
    dbc = _dbc_of(address)
    if address.target.lower().endswith(CAN_FILE_SUFFIXES):
        return CanFileSource(address, clock, dbc)
    interface, _, channel = address.target.partition(":")
    if interface not in can.VALID_INTERFACES or not channel:
        raise SourceError(
            f"'{address.uri}' names neither a CAN interface with its channel nor a log file",
            f"Write can:INTERFACE:CHANNEL, for example can:socketcan:can0, or can:FILE with one of "
            f"{', '.join(CAN_FILE_SUFFIXES)}; interfaces: {', '.join(sorted(can.VALID_INTERFACES))}.",
        )
    options: dict[str, Any] = {name: bus_option(value) for name, value in address.options.items() if name != "dbc"}
    return CanBusSource(f"can:{address.target}", lambda: can.Bus(channel, interface, **options), clock, dbc)


def _dbc_of(address: SourceAddress) -> str | None:
    path = address.options.get("dbc")
    if path is None:
        return None
    try:
        text = read_dbc(Path(path))
    except OSError as error:
        raise SourceError(f"cannot read the DBC file '{path}': {error.strerror}", "Check the path.") from error
    if text is None:
        raise SourceError(f"the DBC file '{path}' is larger than {MAX_DBC_BYTES >> 20} MiB", "Check the path.")
    return text


def bus_option(text: str) -> str | int | bool:
    """Return an option of python-can as the type that it expects."""
    if text in ("yes", "no", "true", "false"):
        return text in ("yes", "true")
    try:
        return int(text, 0)
    except ValueError:
        return text


class CanBusSource:
    """Frames of a bus as they arrive, stamped by this computer's clock as those of the wheels are.

    Attributes:
        dbc_text: the DBC file given with the source, None without one.
    """

    vehicle_toml: str | None = None

    def __init__(
        self,
        link: str,
        make_bus: Callable[[], can.BusABC],
        clock: Clock,
        dbc_text: str | None,
    ) -> None:
        """Name the bus; nothing is opened yet."""
        self.dbc_text = dbc_text
        self._link = link
        self._make_bus = make_bus
        self._clock = clock
        self._backoff = Backoff()
        self._closed = threading.Event()

    @property
    def link(self) -> str:
        """Name of the link."""
        return self._link

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield blocks of frames and events of the link until stopped.

        Raises:
            SourceError: the bus cannot be opened the first time.
        """
        try:
            bus = self._make_bus()
        except Exception as error:  # each interface raises errors of its own
            raise SourceError(
                f"cannot open {self._link}: {error_text(error)}", "Check interface, channel and options."
            ) from error
        brief = BriefConnections(self._backoff)
        brief.opened(self._clock.now_ns())
        yield self._event(LinkEventKind.CONNECTED)
        while True:
            try:
                yield from self._blocks(bus, stop)
                return
            except Exception as error:  # likewise
                _logger.info("%s lost: %s", self._link, error)
                yield self._event(LinkEventKind.LOST, error_text(error))
            finally:
                with suppress(Exception):
                    bus.shutdown()
            lost_ns = self._clock.now_ns()
            failures, reported = brief.lost(lost_ns), ""
            while True:
                failures += 1
                if not wait_until(
                    self._clock, self._clock.now_ns() + self._backoff.pause_ns(failures), stop, self._closed
                ):
                    return
                try:
                    bus = self._make_bus()
                    break
                except Exception as error:  # likewise
                    if error_text(error) != reported:
                        reported = error_text(error)
                        interval = Reason(LinkCode.RETRY_INTERVAL, interval_s=self._backoff.cap_ns * 1e-9)
                        yield self._event(LinkEventKind.RETRYING, reported, (interval,))
            brief.opened(self._clock.now_ns())
            away_s = (self._clock.now_ns() - lost_ns) * 1e-9
            yield self._event(LinkEventKind.RESTORED, details=(Reason(LinkCode.LINK_AWAY, away_s=away_s),))

    def close(self) -> None:
        """End `items`; the bus is released by the thread that reads it."""
        self._closed.set()

    def _blocks(self, bus: can.BusABC, stop: threading.Event) -> Iterator[LinkItem]:
        while not stop.is_set() and not self._closed.is_set():
            message = bus.recv(_WAIT_S)
            if message is None:
                continue
            first_ns = self._clock.now_ns()
            frames = [_frame(message, first_ns)]
            try:
                while len(frames) < _MOST_FRAMES:
                    left_ns = first_ns + _BLOCK_NS - self._clock.now_ns()
                    message = bus.recv(left_ns * 1e-9) if left_ns > 0 else None
                    if message is None:
                        break
                    frames.append(_frame(message, self._clock.now_ns()))
            except Exception:  # what came before counts
                yield BusFrames(self._link, first_ns, pack(frames, first_ns))
                raise
            yield BusFrames(self._link, first_ns, pack(frames, first_ns))

    def _event(self, kind: LinkEventKind, text: str = "", details: tuple[Reason, ...] = ()) -> LinkEvent:
        return LinkEvent(self._link, self._clock.now_ns(), kind, text, details=details)


class CanFileSource(LogFile):
    """Frames of a log file with its times: BLF, ASC, TRC, MF4 and CSV of python-can, candump, SavvyCAN.

    Attributes:
        dbc_text: the DBC file given with the source, None without one.
    """

    def __init__(self, address: SourceAddress, clock: Clock, dbc_text: str | None) -> None:
        """Prepare the file.

        Raises:
            SourceError: there is no such file, or an option is not known or not allowed.
        """
        super().__init__(address, clock, "dbc", "channel")
        self.dbc_text = dbc_text
        text = address.options.get("channel")
        self._channel = None if text is None else channel_number(text)
        self._back = 0
        if text is not None and self._channel is None:
            raise SourceError(f"invalid option channel={text}", "Give the name of a bus in the log: 1, 2, or can0.")

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield blocks of frames with the times of the file, then that it has ended.

        Raises:
            SourceError: the file cannot be read, or has no frame of the channel.
        """
        last_ns = 0
        channels: set[int | None] = set()
        try:
            frames = self._chosen(logged_frames(self._path, self._offset_ns), channels)
            for first_ns, block in _grouped(frames):
                if not self.playback.wait_until(first_ns, stop, self._closed):
                    return
                last_ns = block[-1].host_ns
                yield BusFrames(self.link, first_ns, pack(block, first_ns))
        except Exception as error:  # damaged files raise errors of many kinds
            if not last_ns:
                raise SourceError(
                    f"cannot read the CAN log file '{self._path}': {error_text(error)}",
                    "It may be a log of BLF, ASC, TRC or MF4, of candump, of SavvyCAN, or CSV of python-can.",
                ) from error
            yield self._cut_off(last_ns, error_text(error))
        if not channels and not last_ns:
            raise SourceError(f"the CAN log file '{self._path}' has no frames", "Check that it is a log of a CAN bus.")
        if self._channel is not None and channels and self._channel not in channels:
            channel_names = ", ".join(sorted(str(channel) for channel in channels if channel is not None)) or "none"
            raise SourceError(
                f"the CAN log file '{self._path}' has no channel {self._channel}", f"Its channels are: {channel_names}."
            )
        back = (Reason(VehicleCode.LOG_STEPS_BACK, count=self._back),) if self._back else ()
        yield from (replace(event, details=back) for event in self._end(last_ns, stop))

    def _chosen(self, frames: Iterator[BusFrame], channels: set[int | None]) -> Iterator[BusFrame]:
        """Yield the frames of the chosen channel; collect all channels, and count steps back in time."""
        latest_ns: int | None = None
        for frame in frames:
            self._back += latest_ns is not None and frame.host_ns < latest_ns - _BLOCK_NS
            latest_ns = frame.host_ns
            channels.add(frame.channel)
            if self._channel is None or frame.channel == self._channel:
                yield frame


def _grouped(frames: Iterator[BusFrame]) -> Iterator[tuple[int, list[BusFrame]]]:
    """Yield runs of frames of at most 10 ms; a step back in time begins a new one."""
    block: list[BusFrame] = []
    try:
        for frame in frames:
            if block and (not 0 <= frame.host_ns - block[0].host_ns < _BLOCK_NS or len(block) >= _MOST_FRAMES):
                yield block[0].host_ns, block
                block = []
            block.append(frame)
    except Exception:
        if block:  # what was read before the damage
            yield block[0].host_ns, block
        raise
    if block:
        yield block[0].host_ns, block


def _frame(message: can.Message, host_ns: int) -> BusFrame:
    return frame_of(message, host_ns, None)


def error_text(error: Exception) -> str:
    """Return what an error of an interface says; some say nothing."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or type(error).__name__
