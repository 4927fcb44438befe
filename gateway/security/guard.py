"""The guard: checks every frame's signature, its sender and its freshness before anything else sees it."""

from __future__ import annotations

from collections import Counter as Tally
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from firmware_protocol import wire
from firmware_protocol.declaration import PAYLOADS
from firmware_protocol.messages import COMMANDS, HUB_ITSELF, MessageType
from firmware_protocol.signing import is_of_hub, is_signed
from gateway.core.config.vehicle import Policy, VehicleConfig
from gateway.core.reasons import Level, Notice, Reason
from gateway.core.session.frame_guard import Verdict
from gateway.security.cmac import Key, SecurityError, Verifier, begin_mac
from gateway.security.freshness import Counter, Freshness, Ledger
from gateway.security.key_file import (
    HUB_DIGITS,
    counters_file,
    hub_identity,
    sensor_identity,
    stored_keys,
)
from gateway.security.reasons import SecurityCode

_HELLO_IDS: Final = PAYLOADS[MessageType.HELLO].reader("hub_id", "sensor_id", "boot_count")
_HELLO_BYTES: Final = PAYLOADS[MessageType.HELLO].size + wire.TAG_BYTES
_SEQ: Final = wire.HEADER.reader("seq")
_LAST_BOOT: Final = 0xFFFF_FFFF

# A notice is repeated when its count has grown by this factor.
_REPEAT_FACTOR: Final = 100
# A hello comes every 2 s; this many frames of a source before a verified one are worth a notice, fewer are not.
_EARLY_FRAMES: Final = 1000


class ConfiguredWheel(NamedTuple):
    """A wheel of the configuration.

    Attributes:
        position: its name.
        sensor: identity of the sensor configured there, None when the configuration names none.
    """

    position: str
    sensor: str | None


class _EarlierStart(NamedTuple):
    """A genuine sender in a start below the latest one accepted under its key.

    Attributes:
        identity: of the sensor or hub.
        hub: identity of the hub, empty where the frame does not name it.
        start: boot count of its frames.
        latest: boot count accepted before.
    """

    identity: str
    hub: str
    start: int
    latest: int


class _Sender:
    """Sender behind one source (hub, wheel) of a link, by its last genuine hello."""

    __slots__ = ("counter", "identity", "key", "number", "refused", "verifier")

    def __init__(self, identity: str, key: Key, counter: Counter, boot_count: int) -> None:
        self.identity = identity
        self.key = key
        self.number = int(identity, 16)
        self.counter = counter
        self.refused: Verdict | None = None
        self.verifier = Verifier(key, self.number, boot_count)

    def is_genuine(self, frame: bytes) -> bool:
        """Check a tag, also against the next start of the sender, whose hello may have been lost."""
        if self.verifier.is_genuine(frame):
            return True
        following = self.verifier.boot_count + 1
        if following > _LAST_BOOT:
            return False
        next_verifier = Verifier(self.key, self.number, following)
        if not next_verifier.is_genuine(frame):
            return False
        self.verifier = next_verifier
        return True

    def judge(self, frame: bytes) -> Verdict:
        """Return the verdict on a signed frame other than a hello."""
        if not self.is_genuine(frame):
            return Verdict.FORGED
        return self.refused or self.fresh(frame)

    def fresh(self, frame: bytes) -> Verdict:
        """Return the verdict on the counter of a genuine frame."""
        (seq,) = _SEQ.unpack_from(frame)
        if self.verifier.boot_count < self.counter.boot_count:
            return Verdict.EARLIER_START
        freshness = self.counter.take(self.verifier.boot_count << 32 | seq)
        if freshness is Freshness.SEEN:
            return Verdict.REPLAYED
        return Verdict.TOO_LATE if freshness is Freshness.OLD else Verdict.VERIFIED


class Guard:
    """Check of the frames of all links of a session; a sensor has one counter for all links.

    Attributes:
        requires: True when only verified frames pass; otherwise the others pass too, reported, until their source has
            verified.
        ledger: counters of the sensors.
    """

    def __init__(
        self,
        wheels: Mapping[tuple[int, int], ConfiguredWheel],
        keys: Mapping[str, Key],
        ledger: Ledger,
        *,
        requires: bool,
    ) -> None:
        """Set up the checks.

        Args:
            wheels: wheels of the configuration by hub and wheel number.
            keys: by identity of sensor or hub.
            ledger: counters; saved by the caller.
            requires: whether to refuse frames that are not verified.
        """
        self.requires = requires
        self.ledger = ledger
        self.wheels = wheels
        self.owners = {
            configured.sensor: configured.position for configured in wheels.values() if configured.sensor is not None
        }
        self._keys = keys
        self._check_values = {identity: key.check_value() for identity, key in keys.items()}
        self._notices: list[Notice] = []
        self._gates: dict[str, LinkGate] = {}
        frames = "ignored" if requires else "not_verified"
        for configured in wheels.values():
            if configured.sensor is not None and configured.sensor not in keys:
                missing = Reason(SecurityCode.KEY_MISSING, sensor=configured.sensor, frames=frames)
                self.report(Notice(configured.position, missing, Level.WARNING))

    def gate(self, link: str) -> LinkGate:
        """Return the gate of a link, one per name."""
        gate = self._gates.get(link)
        if gate is None:
            gate = self._gates[link] = LinkGate(self, link)
        return gate

    def sender(self, identity: str, boot_count: int) -> _Sender | None:
        """Return a sensor or hub in one of its starts, None without its key."""
        key = self._keys.get(identity)
        return None if key is None else _Sender(identity, key, self.counter(identity), boot_count)

    def counter(self, identity: str) -> Counter:
        """Return the counter of a sensor or hub under its present key."""
        return self.ledger.counter(identity, self._check_values.get(identity, ""))

    def report(self, notice: Notice) -> None:
        """Keep a notice until `take_notices`."""
        self._notices.append(notice)

    def take_notices(self) -> list[Notice]:
        """Return the notices since the last call."""
        if not self._notices:
            return []
        notices, self._notices = self._notices, []
        return notices


class LinkGate:
    """The guard at one link; a `firmware_protocol.signing.Gate`.

    Memory is bounded by the 65,536 sources that a link can have.

    Attributes:
        counts: frames by verdict.
    """

    def __init__(self, guard: Guard, link: str) -> None:
        self._guard = guard
        self._requires = guard.requires
        self._senders: dict[bytes, _Sender] = {}
        self._unknown: dict[bytes, str] = {}
        self._earlier_senders: dict[bytes, _Sender] = {}
        self._earlier_starts: dict[bytes, _EarlierStart] = {}
        self._reports = _RefusalReports(link, guard)
        # By hub and wheel, and by hub, the start of the last verified frame.
        self._verified: dict[bytes, int] = {}
        self.counts: Tally[Verdict] = Tally()

    def __call__(self, frame: bytes) -> bool:
        """Return whether an intact frame may pass."""
        verdict = self._judge(frame)
        self.counts[verdict] += 1
        source = frame[wire.HUB_OFFSET : wire.WHEEL_OFFSET + 1]
        if verdict is Verdict.VERIFIED:
            if not self._requires:
                self._verified[source] = self._verified[source[:1]] = self._senders[source].verifier.boot_count
            return True
        passes = not self._requires and not self._would_harm(source, frame)
        self._reports.count(source, verdict, self._unknown.get(source), self._earlier_starts.get(source), passes=passes)
        return passes

    def _would_harm(self, source: bytes, frame: bytes) -> bool:
        """Return whether an unverified frame speaks for a source that has verified, or restarts its hub."""
        if source in self._verified:
            return True
        start = self._verified.get(source[:1])
        if start is None or frame[wire.TYPE_OFFSET] != MessageType.HELLO:
            return False
        is_whole = frame[wire.LENGTH_OFFSET] >= _HELLO_BYTES - wire.TAG_BYTES
        return is_whole and _HELLO_IDS.unpack_from(frame, wire.HEADER_BYTES)[2] != start

    def _judge(self, frame: bytes) -> Verdict:
        source = frame[wire.HUB_OFFSET : wire.WHEEL_OFFSET + 1]
        if not is_signed(frame):
            return Verdict.UNSIGNED
        if frame[wire.TYPE_OFFSET] in COMMANDS:
            return Verdict.FORGED  # signed with the same key, but by a gateway: no hub sends commands
        if frame[wire.TYPE_OFFSET] == MessageType.HELLO and not is_of_hub(frame):
            return self._hello(source, frame)
        sender = self._senders.get(source)
        if sender is None:
            if source in self._unknown:
                return Verdict.NO_KEY
            return self._before_hello(source, frame)
        verdict = sender.judge(frame)
        if verdict is Verdict.EARLIER_START:
            self._note_earlier(source, sender, "")
        return verdict

    def _before_hello(self, source: bytes, frame: bytes) -> Verdict:
        """Return the verdict on a frame of a source without an accepted hello."""
        presumed = self._presumed(source)
        verdict = presumed.judge(frame) if presumed is not None else Verdict.FORGED
        if presumed is not None and verdict is Verdict.VERIFIED:
            self._senders[source] = presumed
        if verdict is not Verdict.FORGED:
            return verdict
        earlier_sender = self._earlier_senders.get(source)
        if earlier_sender is not None and earlier_sender.is_genuine(frame):
            return Verdict.EARLIER_START
        # The start is a guess so far: a wrong tag proves nothing yet.
        return Verdict.EARLY

    def _note_earlier(self, source: bytes, sender: _Sender, hub: str) -> None:
        earlier_start = self._earlier_starts.get(source)
        if earlier_start is None or hub:
            self._earlier_starts[source] = _EarlierStart(
                sender.identity, hub, sender.verifier.boot_count, sender.counter.boot_count
            )

    def _presumed(self, source: bytes) -> _Sender | None:
        """Return the sender there in former sessions, as far as the configuration names it."""
        configured = self._guard.wheels.get((source[0], source[1]))
        if configured is None or configured.sensor is None:
            return None
        latest = self._guard.counter(configured.sensor).boot_count
        return self._guard.sender(configured.sensor, latest) if latest >= 0 else None

    def _hello(self, source: bytes, frame: bytes) -> Verdict:
        if frame[wire.VERSION_OFFSET] != wire.VERSION_BYTE or frame[wire.LENGTH_OFFSET] != _HELLO_BYTES:
            # Of a layout that this version cannot read: it introduces no sender.
            previous = self._senders.get(source)
            return Verdict.EARLY if previous is None else previous.judge(frame)
        hub_id, sensor_id, boot_count = _HELLO_IDS.unpack_from(frame, wire.HEADER_BYTES)
        identity = sensor_identity(sensor_id)
        sender = self._senders.get(source)
        if sender is None or sender.identity != identity or sender.verifier.boot_count != boot_count:
            sender = self._guard.sender(identity, boot_count)
        if sender is None:
            if source not in self._senders:
                self._unknown[source] = identity
            return Verdict.NO_KEY
        if not sender.verifier.is_genuine(frame):
            return Verdict.FORGED
        configured = self._guard.wheels.get((source[0], source[1]))
        if configured is None or configured.sensor not in (None, identity):
            self._unknown[source] = identity
            sender.refused = Verdict.NOT_ADMITTED
            if source not in self._senders or self._senders[source].refused:
                self._senders[source] = sender
            return Verdict.NOT_ADMITTED
        verdict = sender.fresh(frame)
        if verdict is Verdict.VERIFIED:
            self._unknown.pop(source, None)
            self._senders[source] = sender
            self._earlier_senders.pop(source, None)
            self._introduce_hub(source[:1] + bytes((HUB_ITSELF,)), hub_identity(hub_id), boot_count)
        elif verdict is Verdict.EARLIER_START:
            # Kept apart from the accepted senders: a replayed hello must not displace the sensor.
            self._earlier_senders[source] = sender
            self._note_earlier(source, sender, hub_identity(hub_id))
        return verdict

    def _introduce_hub(self, source: bytes, identity: str, boot_count: int) -> None:
        """Learn the identity of the hub from a genuine hello of its sensor."""
        previous = self._senders.get(source)
        if previous is not None and previous.identity == identity and previous.verifier.boot_count == boot_count:
            return
        sender = self._guard.sender(identity, boot_count)
        if sender is None:
            self._unknown[source] = identity
            self._senders.pop(source, None)
        else:
            self._unknown.pop(source, None)
            self._senders[source] = sender


class _RefusalReports:
    """Notices of the frames of one link that were not verified: each once, and again at a hundred times as many."""

    def __init__(self, link: str, guard: Guard) -> None:
        self._link = link
        self._guard = guard
        self._counts: dict[tuple[bytes, Verdict, str | None, bool], int] = {}
        self._next_counts: dict[tuple[bytes, Verdict, str | None, bool], int] = {}

    def count(
        self, source: bytes, verdict: Verdict, claimed: str | None, earlier: _EarlierStart | None, *, passes: bool
    ) -> None:
        """Count a frame, and report it when that is due.

        Args:
            source: hub and wheel number.
            verdict: on the frame.
            claimed: identity that the source claims and that is not verified or does not belong there.
            earlier: start of the source that is below the latest one accepted.
            passes: whether the frame is not refused all the same.
        """
        # The sender can claim any number of identities, so that what is kept must not grow with them.
        key = (source, verdict, claimed if claimed in self._guard.owners else None, passes)
        number = self._counts[key] = self._counts.get(key, 0) + 1
        if number < self._next_counts.get(key, _EARLY_FRAMES if verdict is Verdict.EARLY else 1):
            return
        self._next_counts[key] = number * _REPEAT_FACTOR
        hub, wheel = source
        configured = self._guard.wheels.get((hub, wheel))
        subject = (
            configured.position if configured else f"hub {hub}" + ("" if wheel == HUB_ITSELF else f" wheel {wheel}")
        )
        consequence = Reason(SecurityCode.FRAMES_USED if passes else SecurityCode.FRAMES_IGNORED)
        reason = self._reason(configured, verdict, claimed, number, earlier, consequence)
        self._guard.report(Notice(f"{self._link}, {subject}", reason, Level.SECURITY))

    def _reason(
        self,
        configured: ConfiguredWheel | None,
        verdict: Verdict,
        claimed: str | None,
        count: int,
        earlier_start: _EarlierStart | None,
        consequence: Reason,
    ) -> Reason:
        if verdict is Verdict.EARLIER_START and earlier_start is not None:
            signer = _signer(earlier_start.identity)
            origin = (
                Reason(SecurityCode.SIGNER, who="sensor_at_hub", signer=signer, hub=earlier_start.hub)
                if earlier_start.hub
                else signer
            )
            return Reason(
                SecurityCode.FRAME_EARLIER_START,
                signer=origin,
                start=earlier_start.start,
                latest=earlier_start.latest,
                identity=earlier_start.identity,
                count=count,
                consequence=consequence,
            )
        if verdict is Verdict.NO_KEY:
            return Reason(SecurityCode.FRAME_NO_KEY, signer=_signer(claimed), count=count, consequence=consequence)
        if verdict is not Verdict.NOT_ADMITTED:
            return Reason(SecurityCode.FRAME_NOT_TRUSTED, fault=str(verdict), count=count, consequence=consequence)
        sensor = claimed or ""
        owner = self._guard.owners.get(sensor)
        if owner is not None:
            return Reason(
                SecurityCode.SENSOR_NOT_ADMITTED,
                how="swapped",
                sensor=sensor,
                owner=owner,
                count=count,
                consequence=consequence,
            )
        if configured is None or configured.sensor is None:
            return Reason(
                SecurityCode.SENSOR_NOT_ADMITTED,
                how="unconfigured",
                sensor=sensor,
                count=count,
                consequence=consequence,
            )
        return Reason(
            SecurityCode.SENSOR_NOT_ADMITTED,
            how="other",
            sensor=sensor,
            expected=configured.sensor,
            count=count,
            consequence=consequence,
        )


def _signer(identity: str | None) -> Reason:
    if identity is None:
        return Reason(SecurityCode.SIGNER, who="unknown")
    return Reason(SecurityCode.SIGNER, who="hub" if len(identity) == HUB_DIGITS else "sensor", identity=identity)


def open_guard(vehicle: VehicleConfig | None, key_file: Path | None, *, remembers: bool) -> Guard | None:
    """Return the guard that the policy of a vehicle requires, None for policy `off`.

    Args:
        vehicle: configuration.
        key_file: keys; the user's own file when None.
        remembers: whether counters are kept across sessions: yes for a link, no for a recording, whose frames are old.

    Raises:
        SecurityError: keys or counters cannot be read, keys are given that the policy would not use, or the package
            `cryptography` is missing.
    """
    if vehicle is None or vehicle.security.policy is Policy.OFF:
        if key_file is None:
            return None
        stored_keys(key_file)
        cause = "there is no configuration" if vehicle is None else "the configuration has the policy off"
        raise SecurityError(
            f"the keys of '{key_file}' would verify nothing: {cause}",
            'Set policy = "warn" or "require" under [security] of the vehicle file, or leave out --keys.',
        )
    stored = stored_keys(key_file)
    path, keys = stored.path, stored.keys
    for key in keys.values():
        begin_mac(key)  # raises now, rather than at the first frame, when the package is missing
        break
    wheels = {
        (wheel.hub, wheel.wheel): ConfiguredWheel(
            wheel.position, None if wheel.sensor_number is None else sensor_identity(wheel.sensor_number)
        )
        for wheel in vehicle.wheel
    }
    ledger = Ledger(counters_file(path) if remembers else None)
    guard = Guard(wheels, keys, ledger, requires=vehicle.security.policy is Policy.REQUIRE)
    if not keys:
        guard.report(Notice("", Reason(SecurityCode.NO_KEYS, file=str(path)), Level.WARNING))
    return guard
