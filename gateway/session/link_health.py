"""Why a link does not deliver what it should, told once in plain words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from firmware_protocol import wire
from firmware_protocol.counters import LinkCounters
from firmware_protocol.messages import HUB_ITSELF, Frame, Hello
from gateway.session.line_content import describe_content, major_versions

_REVIEW_NS: Final = 500_000_000
_QUIET_NS: Final = 5_000_000_000
# Bytes without a frame are judged after so long and so many, or after many at once as from a file.
_JUDGE_NS: Final = 2_000_000_000
_JUDGE_BYTES: Final = 256
_JUDGE_AT_ONCE: Final = 1 << 16
_SAMPLE_BYTES: Final = 4096
# One such frame may be chance or a hub that tries something; several are its way.
_SEVERAL: Final = 3
_DAMAGE_SHARE: Final = 0.05
_DAMAGE_FRAMES: Final = 1000
# A hub that starts more often than this within a minute is told to be doing that, then left alone.
_RESTARTS: Final = 3
_MINUTE_NS: Final = 60_000_000_000

Position = Callable[[int, int], str]


@dataclass(slots=True)
class _Sender:
    """A source (hub, wheel) as the diagnosis sees it."""

    frames: int
    first_ns: int
    last_ns: int
    greeted: bool = False
    gone: bool = False


class LinkDiagnosis:
    """Watches one link; each finding is told once, and again only after it had gone or the link came back.

    Everything goes by the items' own times, so a replay finds the same, but for the silence of a whole link.
    """

    def __init__(self, link: str, position: Position) -> None:
        """Watch a link.

        Args:
            link: its name.
            position: names the wheel of a hub and wheel number.
        """
        self._link = link
        self._position = position
        self._told: set[str] = set()
        self._bytes = 0
        self._due_ns: int | None = None
        self._senders: dict[tuple[int, int], _Sender] = {}
        self._boots: dict[int, int] = {}
        self._restarts_ns: dict[int, list[int]] = {}
        self._intact = self._barren_bytes = 0
        self._barren_ns: int | None = None
        self._sample = b""
        self._base = (0, 0)
        self._silent = (0, 0)

    def reconnected(self) -> None:
        """The link is open anew: another hub may be on it."""
        self._told.clear()
        self._due_ns = self._barren_ns = None
        self._barren_bytes, self._sample, self._silent = 0, b"", (self._bytes, 0)
        self._senders.clear()

    def data(self, host_ns: int, data: bytes, counters: LinkCounters) -> list[str]:
        """Look at a chunk after it was decoded; return what is to be told."""
        self._bytes += len(data)
        if self._due_ns is not None and 0 <= self._due_ns - host_ns <= _REVIEW_NS:
            if not self._sample and self._barren_ns is None:
                return []
            if len(self._sample) < _SAMPLE_BYTES:
                self._sample += data[:_SAMPLE_BYTES]
            self._barren_bytes += len(data)
            if self._barren_bytes < _JUDGE_AT_ONCE:
                return []
        self._due_ns = host_ns + _REVIEW_NS
        return [*self._barren(host_ns, data, counters), *self._unread(data, counters), *self._wheels(host_ns, counters)]

    def hello(self, frame: Frame, host_ns: int) -> list[str]:
        """Look at a hello; return what is to be told."""
        hello = frame.message
        assert isinstance(hello, Hello)
        sender = self._senders.setdefault((frame.hub, frame.wheel), _Sender(0, host_ns, host_ns))
        sender.greeted = True
        found: list[str] = []
        before = self._boots.get(frame.hub)
        self._boots[frame.hub] = hello.boot_count
        if before is not None and before != hello.boot_count:
            found += self._restarted(frame.hub, hello.boot_count, host_ns)
        spoken = (hello.protocol_major, hello.protocol_minor)
        if spoken > (wire.VERSION_MAJOR, wire.VERSION_MINOR):
            found += self._once(
                f"protocol {frame.hub}",
                f"hub {frame.hub}: its firmware speaks protocol {spoken[0]}.{spoken[1]}, newer than this treadlink's "
                f"{wire.VERSION_MAJOR}.{wire.VERSION_MINOR}; what both know is read, the rest is skipped and counted. "
                "Update treadlink.",
            )
        return found

    def tick(self, now_ns: int) -> list[str]:
        """Look at the clock; return what is to be told of a link that is open but silent."""
        seen, since_ns = self._silent
        if seen != self._bytes or since_ns == 0:
            self._silent = (self._bytes, now_ns)
            if seen != self._bytes and "silent" in self._told:
                self._told.discard("silent")
                return [f"{self._link}: bytes arrive again"]
            return []
        if now_ns - since_ns < _QUIET_NS:
            return []
        whence = "no byte has come yet" if self._bytes == 0 else "nothing has come for 5 s"
        return self._once(
            "silent",
            f"{self._link}: open, but {whence}. Is the hub powered, awake and told to send? Are TX and RX right?",
        )

    def _barren(self, host_ns: int, data: bytes, counters: LinkCounters) -> list[str]:
        """Bytes come, frames do not."""
        intact = counters.intact
        if intact != self._intact:
            self._intact, self._barren_ns, self._barren_bytes, self._sample = intact, None, 0, b""
            if "barren" in self._told:
                self._told.discard("barren")
                return [f"{self._link}: frames arrive now"]
            return []
        if self._barren_ns is None:
            self._barren_ns = host_ns
        if len(self._sample) < _SAMPLE_BYTES:
            self._sample += data[:_SAMPLE_BYTES]
        self._barren_bytes += len(data)
        long = host_ns - self._barren_ns >= _JUDGE_NS and self._barren_bytes >= _JUDGE_BYTES
        if "barren" in self._told or (not long and self._barren_bytes < _JUDGE_AT_ONCE):
            return []
        any_more = " any more" if intact else ""
        return self._once(
            "barren",
            f"{self._link}: bytes arrive but no frame is in them{any_more}: "
            + describe_content(self._link, self._sample),
        )

    def _unread(self, data: bytes, counters: LinkCounters) -> list[str]:
        """Intact frames that this version cannot read, and frames that arrive damaged."""
        found: list[str] = []
        if counters.other_major >= _SEVERAL and "major" not in self._told and (majors := major_versions(data)):
            major = min(majors, key=lambda version: abs(version - wire.VERSION_MAJOR))
            older = major < wire.VERSION_MAJOR
            found += self._once(
                "major",
                f"{self._link}: the firmware speaks protocol {major}.x, this treadlink {wire.VERSION_MAJOR}.x; none of "
                f"its frames can be read. Update {'the firmware of the hub' if older else 'treadlink'}.",
            )
        if counters.newer_minor >= _SEVERAL:
            found += self._once(
                "minor",
                f"{self._link}: frames of a layout newer than protocol {wire.VERSION_MAJOR}.{wire.VERSION_MINOR} are "
                "skipped and counted: the firmware is newer than this treadlink. Update treadlink.",
            )
        if counters.unknown_flags >= _SEVERAL:
            found += self._once(
                "flags", f"{self._link}: frames with flags that this treadlink does not know are skipped and counted."
            )
        if counters.bad_payload >= _SEVERAL:
            found += self._once(
                "payload",
                f"{self._link}: frames whose checksum is right but whose content breaks the specification are skipped: "
                "a fault of the firmware.",
            )
        errors, frames = counters.crc_errors - self._base[0], counters.intact - self._base[1]
        if errors + frames >= _DAMAGE_FRAMES:
            self._base = (counters.crc_errors, counters.intact)
            if frames and errors > _DAMAGE_SHARE * (errors + frames):
                found += self._once(
                    "damage",
                    f"{self._link}: {errors / (errors + frames):.0%} of the frames arrive damaged; they are left out. "
                    "Check cable, ground, distance and baud rate.",
                )
        return found

    def _wheels(self, host_ns: int, counters: LinkCounters) -> list[str]:
        """Sensors that fall silent while others speak, or speak without a hello."""
        found: list[str] = []
        for key, source in counters.sources.items():
            hub, wheel = key
            sender = self._senders.get(key)
            if sender is None:
                sender = self._senders[key] = _Sender(source.frames, host_ns, host_ns)
                continue
            if source.frames == sender.frames:
                if not sender.gone and sender.frames and host_ns - sender.last_ns >= _QUIET_NS:
                    sender.gone = True
                    what = f"hub {hub}" if wheel == HUB_ITSELF else f"{self._position(hub, wheel)}: its sensor"
                    found.append(
                        f"{what} has sent nothing for 5 s while others do: battery empty, out of range, or broken?"
                    )
                continue
            if sender.gone:
                sender.gone = False
                what = f"hub {hub}" if wheel == HUB_ITSELF else self._position(hub, wheel)
                found.append(f"{what} sends again after {(host_ns - sender.last_ns) * 1e-9:.1f} s")
            sender.frames, sender.last_ns = source.frames, host_ns
            if not sender.greeted and wheel != HUB_ITSELF and host_ns - sender.first_ns >= _QUIET_NS:
                found += self._once(
                    f"hello {key}",
                    f"{self._position(hub, wheel)}: samples come but no hello for 5 s, so rate and scale are unknown "
                    "and nothing can be estimated: a hub sends one every 2 s. Restart the hub or update its firmware.",
                )
        return found

    def _restarted(self, hub: int, boot_count: int, host_ns: int) -> list[str]:
        recent = [at for at in self._restarts_ns.get(hub, []) if 0 <= host_ns - at < _MINUTE_NS]
        self._restarts_ns[hub] = [*recent, host_ns]
        if len(recent) >= _RESTARTS:
            return self._once(
                f"restarts {hub}", f"hub {hub} keeps restarting: check its supply. Further restarts are not told."
            )
        self._told.discard(f"restarts {hub}")
        return [f"hub {hub} has restarted (start number {boot_count}); its counters and times begin anew"]

    def _once(self, what: str, text: str) -> list[str]:
        if what in self._told:
            return []
        self._told.add(what)
        return [text]
