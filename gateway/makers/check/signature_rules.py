"""Rules of signed frames: a source signs all of its frames or none, and its tags are right under its key."""

from collections.abc import Mapping

from firmware_protocol.messages import HUB_ITSELF, Hello
from firmware_protocol.signing import is_signed
from gateway.core.reasons import Reason
from gateway.makers.check.clauses import Clause, Ledger
from gateway.makers.check.seen_frame import SeenFrame, SourceKey, source_name
from gateway.makers.reasons import FirmwareCode
from gateway.security.cmac import Key, Verifier
from gateway.security.key_file import hub_identity, sensor_identity


class SignatureRules:
    """Follows which sources sign, and verifies the tags of those whose key is known."""

    def __init__(self, ledger: Ledger, keys: Mapping[str, Key]) -> None:
        """Take the keys by identity of sensor or hub."""
        self._ledger = ledger
        self._keys = keys
        self._hellos: dict[SourceKey, Hello] = {}
        self._boots: dict[int, Hello] = {}
        self._signs: dict[SourceKey, bool] = {}
        self._verifiers: dict[tuple[str, int], Verifier] = {}

    def frame(self, seen: SeenFrame) -> None:
        """Take a frame."""
        if isinstance(seen.message, Hello) and seen.wheel != HUB_ITSELF:
            self._hellos[seen.source] = self._boots[seen.hub] = seen.message
        signed = is_signed(seen.data)
        if signed or self._signs.get(seen.source):
            self._ledger.check(Clause.SIGNED_ALL)
        if self._signs.setdefault(seen.source, signed) != signed:
            reason = Reason(FirmwareCode.SIGNATURE_WRONG, how="some_frames")
            self._ledger.fail(Clause.SIGNED_ALL, source_name(seen.source), reason, seen.data, seen.at_byte)
        if signed:
            self._tag(seen)

    def _tag(self, frame: SeenFrame) -> None:
        hello = self._boots.get(frame.hub) if frame.wheel == HUB_ITSELF else self._hellos.get(frame.source)
        if hello is None:
            return
        number = hello.hub_id if frame.wheel == HUB_ITSELF else hello.sensor_id
        identity = hub_identity(number) if frame.wheel == HUB_ITSELF else sensor_identity(number)
        key = self._keys.get(identity)
        if key is None:
            self._ledger.leave(Clause.TAG, Reason(FirmwareCode.CHECK_NOT_DONE, why="no_key", identity=identity))
            return
        self._ledger.check(Clause.TAG)
        verifier = self._verifiers.get((identity, hello.boot_count))
        if verifier is None:
            verifier = self._verifiers[identity, hello.boot_count] = Verifier(key, number, hello.boot_count)
        if not verifier.is_genuine(frame.data):
            reason = Reason(FirmwareCode.SIGNATURE_WRONG, how="tag", identity=identity, boot_count=hello.boot_count)
            self._ledger.fail(Clause.TAG, source_name(frame.source), reason, frame.data, frame.at_byte)
