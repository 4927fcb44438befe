"""The check between a link's bytes and everything else: who signed a frame, may he, and is it new."""

from __future__ import annotations

import struct
from collections import Counter as Tally
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Final, NamedTuple

from firmware_protocol import wire
from firmware_protocol.messages import HUB_ITSELF, MessageType
from firmware_protocol.signing import is_of_hub, is_signed
from gateway.security.cmac import Key, Verifier
from gateway.security.freshness import Counter, Freshness, Ledger
from gateway.security.key_file import hub_identity, sensor_identity
from gateway.security.words import Teller

_HELLO_IDS: Final = struct.Struct("<QII")
_HELLO_IDS_AT: Final = wire.HEADER_BYTES + 8
_HELLO_BYTES: Final = 70 + wire.TAG_BYTES
_SEQ: Final = struct.Struct("<I")
_LAST_BOOT: Final = 0xFFFF_FFFF


class Verdict(StrEnum):
    """What the guard makes of a frame; all but the first are not let through where signatures are required."""

    VERIFIED = "verified"
    UNSIGNED = "unsigned"
    FORGED = "wrong tag"
    REPLAYED = "replayed"
    TOO_LATE = "too late"
    NO_KEY = "no key"
    NOT_ADMITTED = "not admitted"
    EARLY = "before hello"


SUSPICIOUS: Final = (Verdict.UNSIGNED, Verdict.FORGED, Verdict.REPLAYED, Verdict.TOO_LATE, Verdict.NOT_ADMITTED)
"""Verdicts that somebody's bad intent could explain."""


class Place(NamedTuple):
    """A wheel of the configuration.

    Attributes:
        position: its name.
        sensor: identity of the sensor that belongs there, None when the configuration does not say.
    """

    position: str
    sensor: str | None


class _Speaker:
    """Who speaks as one source (hub, wheel) of a link, by its last genuine hello."""

    __slots__ = ("counter", "identity", "key", "number", "refused", "verifier")

    def __init__(self, identity: str, key: Key, counter: Counter, boot_count: int) -> None:
        self.identity = identity
        self.key = key
        self.number = int(identity, 16)
        self.counter = counter
        self.refused: Verdict | None = None
        self.verifier = Verifier(key, self.number, boot_count)

    def is_genuine(self, frame: bytes) -> bool:
        """Check a tag; the hello of the start after this one may have been lost."""
        if self.verifier.is_genuine(frame):
            return True
        following = self.verifier.boot_count + 1
        if following > _LAST_BOOT:
            return False
        ahead = Verifier(self.key, self.number, following)
        if not ahead.is_genuine(frame):
            return False
        self.verifier = ahead
        return True

    def judge(self, frame: bytes) -> Verdict:
        """Judge a signed frame that is no hello."""
        if not self.is_genuine(frame):
            return Verdict.FORGED
        return self.refused or self.fresh(frame)

    def fresh(self, frame: bytes) -> Verdict:
        """Judge the counter of a genuine frame."""
        (seq,) = _SEQ.unpack_from(frame, 8)
        found = self.counter.take(self.verifier.boot_count << 32 | seq)
        if found is Freshness.SEEN:
            return Verdict.REPLAYED
        return Verdict.TOO_LATE if found is Freshness.OLD else Verdict.VERIFIED


class Guard:
    """Judges the frames of all links of a session; a sensor's counter is one for all links.

    Attributes:
        requires: True when only verified frames are let through; else all are, and the user is told of the others.
        ledger: counters of the sensors.
    """

    def __init__(
        self,
        places: Mapping[tuple[int, int], Place],
        keys: Mapping[str, Key],
        ledger: Ledger,
        *,
        requires: bool,
    ) -> None:
        """Take what is known.

        Args:
            places: wheels of the configuration by hub and wheel number.
            keys: by identity of sensor or hub.
            ledger: counters; kept by the caller.
            requires: whether to refuse what is not verified.
        """
        self.requires = requires
        self.ledger = ledger
        self.places = places
        self.owners = {place.sensor: place.position for place in places.values() if place.sensor is not None}
        self._keys = keys
        self._findings: list[str] = []
        self._gates: dict[str, LinkGate] = {}
        for place in places.values():
            if place.sensor is not None and place.sensor not in keys:
                what = "will be ignored" if requires else "cannot be verified"
                self._findings.append(
                    f"no key of {place.position} (sensor {place.sensor}): its frames {what}; get its key into the key "
                    "file with `treadlink keys import`"
                )

    def gate(self, link: str) -> LinkGate:
        """Return the gate of a link, one for each name."""
        found = self._gates.get(link)
        if found is None:
            found = self._gates[link] = LinkGate(self, link)
        return found

    def speaker(self, identity: str, boot_count: int) -> _Speaker | None:
        """Return a sensor or hub in one of its starts, None when there is no key of it."""
        key = self._keys.get(identity)
        return None if key is None else _Speaker(identity, key, self.ledger.counter(identity), boot_count)

    def tell(self, texts: Sequence[str]) -> None:
        """Keep findings until somebody fetches them."""
        self._findings += texts

    def findings(self) -> list[str]:
        """Take what is to be told since the last call."""
        if not self._findings:
            return []
        taken, self._findings = self._findings, []
        return taken


class LinkGate:
    """The guard at one link; a `firmware_protocol.signing.Gate`.

    Memory is bounded by the 65,536 sources that a link can have.

    Attributes:
        counts: frames by verdict.
    """

    def __init__(self, guard: Guard, link: str) -> None:
        self._guard = guard
        self._requires = guard.requires
        self._speakers: dict[bytes, _Speaker] = {}
        self._strangers: dict[bytes, str] = {}
        self._teller = Teller(link, guard.places, guard.owners, requires=guard.requires)
        self.counts: Tally[Verdict] = Tally()

    def __call__(self, frame: bytes) -> bool:
        """Tell whether an intact frame may pass."""
        verdict = self._judge(frame)
        self.counts[verdict] += 1
        if verdict is Verdict.VERIFIED:
            return True
        source = frame[wire.HUB_OFFSET : wire.WHEEL_OFFSET + 1]
        self._guard.tell(self._teller.found(source, verdict.value, self._strangers.get(source)))
        return not self._requires

    def _judge(self, frame: bytes) -> Verdict:
        source = frame[wire.HUB_OFFSET : wire.WHEEL_OFFSET + 1]
        if not is_signed(frame):
            return Verdict.UNSIGNED
        if frame[wire.TYPE_OFFSET] == MessageType.HELLO and not is_of_hub(frame):
            return self._hello(source, frame)
        speaker = self._speakers.get(source)
        if speaker is None:
            if source in self._strangers:
                return Verdict.NO_KEY
            speaker = self._presumed(source)
            if speaker is None:
                return Verdict.EARLY
            verdict = speaker.judge(frame)
            if verdict is Verdict.VERIFIED:
                self._speakers[source] = speaker
            # Before a hello the start is a guess: a tag that does not fit proves nothing yet.
            return Verdict.EARLY if verdict is Verdict.FORGED else verdict
        return speaker.judge(frame)

    def _presumed(self, source: bytes) -> _Speaker | None:
        """Return who spoke there in former sessions, as far as the configuration tells."""
        place = self._guard.places.get((source[0], source[1]))
        if place is None or place.sensor is None:
            return None
        highest = self._guard.ledger.counter(place.sensor).highest
        return self._guard.speaker(place.sensor, highest >> 32) if highest >= 0 else None

    def _hello(self, source: bytes, frame: bytes) -> Verdict:
        if frame[wire.VERSION_OFFSET] != wire.VERSION_BYTE or frame[wire.LENGTH_OFFSET] != _HELLO_BYTES:
            # Of a layout that this version cannot read: it introduces nobody.
            known = self._speakers.get(source)
            return Verdict.EARLY if known is None else known.judge(frame)
        hub_id, sensor_id, boot_count = _HELLO_IDS.unpack_from(frame, _HELLO_IDS_AT)
        identity = sensor_identity(sensor_id)
        speaker = self._speakers.get(source)
        if speaker is None or speaker.identity != identity or speaker.verifier.boot_count != boot_count:
            speaker = self._guard.speaker(identity, boot_count)
        if speaker is None:
            if source not in self._speakers:
                self._strangers[source] = identity
            return Verdict.NO_KEY
        if not speaker.verifier.is_genuine(frame):
            return Verdict.FORGED
        place = self._guard.places.get((source[0], source[1]))
        if place is None or place.sensor not in (None, identity):
            self._strangers[source] = identity
            speaker.refused = Verdict.NOT_ADMITTED
            if source not in self._speakers or self._speakers[source].refused:
                self._speakers[source] = speaker
            return Verdict.NOT_ADMITTED
        verdict = speaker.fresh(frame)
        if verdict is Verdict.VERIFIED:
            self._strangers.pop(source, None)
            self._speakers[source] = speaker
            self._introduce_hub(source[:1] + bytes((HUB_ITSELF,)), hub_identity(hub_id), boot_count)
        return verdict

    def _introduce_hub(self, source: bytes, identity: str, boot_count: int) -> None:
        """Learn from a sensor's genuine hello whose hub it is."""
        known = self._speakers.get(source)
        if known is not None and known.identity == identity and known.verifier.boot_count == boot_count:
            return
        speaker = self._guard.speaker(identity, boot_count)
        if speaker is None:
            self._strangers[source] = identity
            self._speakers.pop(source, None)
        else:
            self._strangers.pop(source, None)
            self._speakers[source] = speaker
