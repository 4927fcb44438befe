"""Health of a link: notices of why it does not deliver what it should, each given once."""

import logging
from collections.abc import Callable
from typing import Final

from firmware_protocol import wire
from firmware_protocol.counters import LinkCounters
from firmware_protocol.messages import HUB_ITSELF, Frame, Hello
from gateway.core.reasons import Code, Level, Notice, Reason
from gateway.core.session.line_content import identify_content, other_major_versions
from gateway.core.session.reasons import SessionCode

_logger = logging.getLogger(__name__)

_REVIEW_INTERVAL_NS: Final = 500_000_000
_SILENCE_NS: Final = 5_000_000_000
_SILENCE_S: Final = _SILENCE_NS * 1e-9
# Bytes without a frame are identified after this time and number, or after many at once as from a file.
_BARREN_NS: Final = 2_000_000_000
_BARREN_BYTES: Final = 256
_BARREN_BYTES_AT_ONCE: Final = 1 << 16
_SAMPLE_BYTES: Final = 4096
# A single unreadable frame may be chance or an experiment of the hub; this many are its habit.
_UNREADABLE_FRAMES: Final = 3
_DAMAGED_SHARE: Final = 0.05
_DAMAGE_REVIEW_FRAMES: Final = 1000
# Restarts within a minute after which a hub is reported to restart again and again, and then no further.
_RESTARTS_PER_MINUTE: Final = 3
_MINUTE_NS: Final = 60_000_000_000
_OWN_VERSION: Final = f"{wire.VERSION_MAJOR}.{wire.VERSION_MINOR}"

PositionOf = Callable[[int, int], str]


class LinkHealth:
    """Watches one link; each finding is reported once, and again only after it had ended or the link was reopened.

    The silence of hubs and sensors is not reported here, but by `gateway.core.session.silence`.
    """

    def __init__(
        self, link: str, position_of: PositionOf, admits: Callable[[int, int], bool] = lambda _hub, _wheel: True
    ) -> None:
        """Watch a link.

        Args:
            link: its name.
            position_of: returns the wheel position of a hub and wheel number.
            admits: returns whether a wheel number is within the limit of the session.
        """
        self._link = link
        self._position_of = position_of
        self._admits = admits
        # Code and subject of the findings that hold now.
        self._reported: set[tuple[Code, str]] = set()
        self._bytes = self._crc_errors = 0
        self._review_due_ns: int | None = None
        # Host time of the first frame of each source, None once it has sent a hello, and its frames at the last review.
        self._ungreeted_ns: dict[tuple[int, int], int | None] = {}
        self._frames: dict[tuple[int, int], int] = {}
        self._has_hub = False
        self._boot_counts: dict[int, int] = {}
        self._restarts_ns: dict[int, list[int]] = {}
        self._intact_frames = self._barren_bytes = 0
        self._barren_since_ns: int | None = None
        self._sample = b""
        # CRC errors and intact frames at the last review of damage.
        self._damage_base = (0, 0)
        # Bytes received and host time when they were last found to have changed.
        self._last_change = (0, 0)

    def reconnected(self) -> None:
        """Start again: another hub may be on the reopened link."""
        self._reported.clear()
        self._review_due_ns = self._barren_since_ns = None
        self._barren_bytes, self._sample, self._last_change = 0, b"", (self._bytes, 0)
        self._ungreeted_ns.clear()

    def paused(self, now_ns: int) -> None:
        """Count the silence of the link again after a pause of this computer."""
        if self._last_change[1]:
            self._last_change = (self._last_change[0], now_ns)

    def data(self, host_ns: int, data: bytes, counters: LinkCounters) -> list[Notice]:
        """Review a chunk after it was decoded; return new notices."""
        self._bytes += len(data)
        if counters.crc_errors != self._crc_errors:
            self._crc_errors = counters.crc_errors
            errors, noise = counters.crc_errors, counters.noise_bytes
            _logger.debug("%s: decoder resynchronised, %d CRC errors, %d noise bytes", self._link, errors, noise)
        if self._review_due_ns is not None and 0 <= self._review_due_ns - host_ns <= _REVIEW_INTERVAL_NS:
            if not self._sample and self._barren_since_ns is None:
                return []
            if len(self._sample) < _SAMPLE_BYTES:
                self._sample += data[:_SAMPLE_BYTES]
            self._barren_bytes += len(data)
            if self._barren_bytes < _BARREN_BYTES_AT_ONCE:
                return []
        self._review_due_ns = host_ns + _REVIEW_INTERVAL_NS
        return [
            *self._review_content(host_ns, data, counters),
            *self._review_versions(data, counters),
            *self._review_damage(counters),
            *self._review_greetings(host_ns, counters),
        ]

    def hello(self, frame: Frame, host_ns: int) -> list[Notice]:
        """Review a hello; return new notices."""
        hello = frame.message
        assert isinstance(hello, Hello)
        self._ungreeted_ns[(frame.hub, frame.wheel)] = None
        notices: list[Notice] = []
        previous_count = self._boot_counts.get(frame.hub)
        self._boot_counts[frame.hub] = hello.boot_count
        if previous_count is not None and previous_count != hello.boot_count:
            notices += self._restarted(frame.hub, hello.boot_count, host_ns)
        if (hello.protocol_major, hello.protocol_minor) > (wire.VERSION_MAJOR, wire.VERSION_MINOR):
            version = f"{hello.protocol_major}.{hello.protocol_minor}"
            newer = Reason(SessionCode.PROTOCOL_DIFFERS, how="newer", version=version, own=_OWN_VERSION)
            notices += self._once(hub_name(frame.hub), newer)
        elif (hello.protocol_major, hello.protocol_minor) < (wire.VERSION_MAJOR, wire.SIGNED_COMMANDS_MINOR):
            version = f"{hello.protocol_major}.{hello.protocol_minor}"
            older = Reason(SessionCode.PROTOCOL_DIFFERS, how="older", version=version, own=_OWN_VERSION)
            notices += self._once(hub_name(frame.hub), older, Level.INFO)
        return notices

    def tick(self, now_ns: int) -> list[Notice]:
        """Return new notices of a link that is open but silent, before a hub is known to be on it."""
        last_bytes, since_ns = self._last_change
        if last_bytes != self._bytes or since_ns == 0:
            self._last_change = (self._bytes, now_ns)
            if last_bytes != self._bytes and self._ended(SessionCode.LINK_SILENT, SessionCode.LINK_NO_DATA_YET):
                return [Notice(self._link, Reason(SessionCode.LINK_RESUMED))]
            return []
        if now_ns - since_ns < _SILENCE_NS or self._has_hub:
            return []
        if self._bytes == 0:
            return self._once(self._link, Reason(SessionCode.LINK_NO_DATA_YET))
        return self._once(self._link, Reason(SessionCode.LINK_SILENT, silence_s=_SILENCE_S))

    def _review_content(self, host_ns: int, data: bytes, counters: LinkCounters) -> list[Notice]:
        """Report bytes that contain no frame."""
        if counters.intact != self._intact_frames:
            self._intact_frames = counters.intact
            self._barren_since_ns, self._barren_bytes, self._sample = None, 0, b""
            ended = self._ended(SessionCode.NO_FRAMES, SessionCode.NO_FRAMES_ANY_MORE)
            return [Notice(self._link, Reason(SessionCode.FRAMES_RESUMED))] if ended else []
        if self._barren_since_ns is None:
            self._barren_since_ns = host_ns
        if len(self._sample) < _SAMPLE_BYTES:
            self._sample += data[:_SAMPLE_BYTES]
        self._barren_bytes += len(data)
        is_long = host_ns - self._barren_since_ns >= _BARREN_NS and self._barren_bytes >= _BARREN_BYTES
        is_known = self._is_reported(SessionCode.NO_FRAMES) or self._is_reported(SessionCode.NO_FRAMES_ANY_MORE)
        if is_known or (not is_long and self._barren_bytes < _BARREN_BYTES_AT_ONCE):
            return []
        content = identify_content(self._link, self._sample)
        if counters.intact:
            return self._once(
                self._link, Reason(SessionCode.NO_FRAMES_ANY_MORE, frames=counters.intact, content=content)
            )
        return self._once(self._link, Reason(SessionCode.NO_FRAMES, content=content))

    def _review_versions(self, data: bytes, counters: LinkCounters) -> list[Notice]:
        """Report intact frames that this version cannot read."""
        notices: list[Notice] = []
        is_known = self._is_reported(SessionCode.FIRMWARE_UNREADABLE)
        if counters.other_major >= _UNREADABLE_FRAMES and not is_known and (majors := other_major_versions(data)):
            major = min(majors, key=lambda version: abs(version - wire.VERSION_MAJOR))
            older = "firmware" if major < wire.VERSION_MAJOR else "treadlink"
            reason = Reason(SessionCode.FIRMWARE_UNREADABLE, major=major, own=wire.VERSION_MAJOR, older=older)
            notices += self._once(self._link, reason)
        if counters.newer_minor >= _UNREADABLE_FRAMES:
            notices += self._once(
                self._link, Reason(SessionCode.PROTOCOL_DIFFERS, how="newer_layout", own=_OWN_VERSION)
            )
        if counters.unknown_flags >= _UNREADABLE_FRAMES:
            notices += self._once(self._link, Reason(SessionCode.FRAMES_WITH_UNKNOWN_FLAGS))
        if counters.bad_payload >= _UNREADABLE_FRAMES:
            notices += self._once(self._link, Reason(SessionCode.FRAMES_WITH_BAD_PAYLOAD))
        return notices

    def _review_damage(self, counters: LinkCounters) -> list[Notice]:
        """Report a large share of damaged frames."""
        errors, frames = counters.crc_errors - self._damage_base[0], counters.intact - self._damage_base[1]
        if errors + frames < _DAMAGE_REVIEW_FRAMES:
            return []
        self._damage_base = (counters.crc_errors, counters.intact)
        if not frames or errors <= _DAMAGED_SHARE * (errors + frames):
            return []
        return self._once(self._link, Reason(SessionCode.FRAMES_DAMAGED, share=errors / (errors + frames)))

    def _review_greetings(self, host_ns: int, counters: LinkCounters) -> list[Notice]:
        """Report wheels without a hello."""
        notices: list[Notice] = []
        for (hub, wheel), source in counters.sources.items():
            first_ns = self._ungreeted_ns.setdefault((hub, wheel), host_ns)
            is_sending = self._frames.get((hub, wheel)) != source.frames
            self._frames[(hub, wheel)] = source.frames
            is_overdue = first_ns is not None and host_ns - first_ns >= _SILENCE_NS
            if is_overdue and is_sending and wheel != HUB_ITSELF and self._admits(hub, wheel):
                notices += self._once(self._position_of(hub, wheel), Reason(SessionCode.NO_HELLO, silence_s=_SILENCE_S))
        self._has_hub = bool(counters.sources)
        return notices

    def _restarted(self, hub: int, boot_count: int, host_ns: int) -> list[Notice]:
        recent = [restart_ns for restart_ns in self._restarts_ns.get(hub, []) if 0 <= host_ns - restart_ns < _MINUTE_NS]
        self._restarts_ns[hub] = [*recent[-_RESTARTS_PER_MINUTE:], host_ns]
        if len(recent) >= _RESTARTS_PER_MINUTE:
            return self._once(hub_name(hub), Reason(SessionCode.HUB_RESTARTS_REPEATEDLY))
        self._reported.discard((SessionCode.HUB_RESTARTS_REPEATEDLY, hub_name(hub)))
        return [Notice(hub_name(hub), Reason(SessionCode.HUB_RESTARTED, boot_count=boot_count), Level.WARNING)]

    def _once(self, subject: str, reason: Reason, level: Level = Level.WARNING) -> list[Notice]:
        if (reason.code, subject) in self._reported:
            return []
        self._reported.add((reason.code, subject))
        return [Notice(subject, reason, level)]

    def _is_reported(self, code: Code) -> bool:
        return (code, self._link) in self._reported

    def _ended(self, *codes: Code) -> bool:
        """Forget findings of the link that hold no more; return whether one of them had been reported."""
        ended = {(code, self._link) for code in codes} & self._reported
        self._reported -= ended
        return bool(ended)


def hub_name(hub: int) -> str:
    """Return the name of a hub as the subject of notices."""
    return f"hub {hub}"
