"""Signing of commands for the hubs of one link, and verification of their replies."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from firmware_protocol import wire
from firmware_protocol.codec import encode_frame
from firmware_protocol.declaration import PAYLOADS
from firmware_protocol.messages import (
    COMMAND_TYPES,
    EVERY_HUB,
    HUB_ITSELF,
    Challenge,
    Command,
    CommandResult,
    Frame,
    MessageType,
    Outcome,
)
from firmware_protocol.signing import is_of_hub, is_signed, sign
from gateway.security.cmac import Key, Verifier, mac
from gateway.security.key_file import hub_identity, new_nonce, sensor_identity

_HELLO: Final = PAYLOADS[MessageType.HELLO].reader(
    "protocol_major", "protocol_minor", "hub_id", "sensor_id", "boot_count"
)
_HELLO_BYTES: Final = PAYLOADS[MessageType.HELLO].size
_ANSWER: Final = PAYLOADS[MessageType.CHALLENGE_ANSWER].head
_ANSWER_BYTES: Final = _ANSWER.size + wire.TAG_BYTES
_U32: Final = 0xFFFF_FFFF
_MAX_RESYNCS: Final = 3

_NS_PER_S: Final = 1_000_000_000
# Anybody can send a hello, so what hellos cause is limited: at once, and then per second.
_HELLOS_ANSWERED: Final = 8
_HELLOS_ANSWERED_PER_S: Final = 1
# The hellos of all wheels of a hub come at once.
_CHALLENGE_PERIOD_NS: Final = 1_000_000_000


@dataclass(slots=True)
class HubAtLink:
    """A hub by its last hello, which may be a replay until the hub has answered a challenge.

    Attributes:
        hub: number on the link.
        hub_id: serial number.
        boot_count: its start as the hello says.
        protocol: (major, minor) version of its firmware.
        signs: whether the hello is signed by a sensor whose key is there.
        key: of the hub, None when there is none.
        nonce: of its challenge.
        answered_ns: time of the last answer to one of its hellos.
        next_seq: counter of the next signed command, None until the hub has answered the challenge.
        resyncs: times that the hub has asked for a higher counter, in this start.
    """

    hub: int
    hub_id: int
    boot_count: int
    protocol: tuple[int, int]
    signs: bool
    key: Key | None
    nonce: int = field(default_factory=new_nonce)
    answered_ns: int | None = None
    next_seq: int | None = None
    resyncs: int = 0
    _verifier: Verifier | None = field(default=None, repr=False)

    @property
    def verifies_commands(self) -> bool:
        """Whether its firmware takes signed commands, and no others."""
        return self.signs and self.protocol >= (wire.VERSION_MAJOR, wire.SIGNED_COMMANDS_MINOR)

    @property
    def is_present(self) -> bool:
        """Whether it has answered the challenge: it is there now, in this start."""
        return self.next_seq is not None

    def is_genuine(self, frame: bytes) -> bool:
        """Return whether a frame of the hub itself is signed with its key."""
        if self.key is None or not is_signed(frame):
            return False
        if self._verifier is None:
            self._verifier = Verifier(self.key, self.hub_id, self.boot_count)
        return self._verifier.is_genuine(frame)


class HubCommands:
    """Commands to the hubs of one link; a `firmware_protocol.signing.Gate` of its decoder.

    A hub whose sensors sign gets signed commands, after it has answered a challenge. Its replies count only when they
    are signed with its key.

    Attributes:
        hubs: by number on the link, those whose hello has come.
        may_be_unsigned: whether a hub without a verified hello, or of a protocol without signed commands, gets unsigned
            ones. Anybody who can write to the link can pass for such a hub.
    """

    def __init__(self, keys: Mapping[str, Key], *, may_be_unsigned: bool = False) -> None:
        """Take the keys by identity of sensor or hub."""
        self._keys = keys
        self.may_be_unsigned = may_be_unsigned
        self.hubs: dict[int, HubAtLink] = {}
        self._allowance = float(_HELLOS_ANSWERED)
        self._allowed_ns: int | None = None

    def __call__(self, frame: bytes) -> bool:
        """Learn from a hello or the answer to a challenge; return whether an intact frame may be read."""
        hub = self.hubs.get(frame[wire.HUB_OFFSET])
        kind = frame[wire.TYPE_OFFSET]
        if kind == MessageType.HELLO and not is_of_hub(frame):
            self._hello(frame[wire.HUB_OFFSET], frame)
        elif kind == MessageType.CHALLENGE_ANSWER:
            return hub is not None and is_of_hub(frame) and self._answer(hub, frame)
        elif kind == MessageType.COMMAND_RESULT:
            return hub is None or not hub.verifies_commands or hub.is_genuine(frame)
        return True

    def may_answer_hello(self, hub: HubAtLink, now_ns: int) -> bool:
        """Take one of the limited answers to hellos; return whether there was one."""
        if hub.answered_ns is not None and 0 <= now_ns - hub.answered_ns < _CHALLENGE_PERIOD_NS:
            return False
        elapsed_ns = 0 if self._allowed_ns is None else max(now_ns - self._allowed_ns, 0)
        self._allowed_ns = now_ns
        refilled = self._allowance + elapsed_ns / _NS_PER_S * _HELLOS_ANSWERED_PER_S
        self._allowance = min(refilled, float(_HELLOS_ANSWERED))
        if self._allowance < 1.0:
            return False
        self._allowance -= 1.0
        hub.answered_ns = now_ns
        return True

    def challenge(self, hub: HubAtLink) -> bytes:
        """Return the frame that asks a hub whether it is there in the start of its hello.

        Raises:
            KeyError: there is no key for the hub, so that its answer could not be verified.
        """
        if hub.key is None:
            raise KeyError(hub_identity(hub.hub_id))
        return command_frame(Challenge(hub.nonce), 0, hub.hub)

    def frame(self, command: Command, hub: HubAtLink) -> tuple[int, bytes]:
        """Return counter and frame of a signed command to every wheel of a hub.

        Raises:
            ValueError: the hub has not answered its challenge.
            OverflowError: the hub has accepted the last counter of this start.
        """
        seq, key = hub.next_seq, hub.key
        if seq is None or key is None:
            raise ValueError("the hub has not answered its challenge")
        if seq > _U32:
            raise OverflowError
        hub.next_seq = seq + 1
        unsigned = command_frame(command, seq, hub.hub)
        return seq, sign(unsigned, hub.hub_id, hub.boot_count, lambda data: mac(key, data))

    def resynchronise(self, hub: HubAtLink, result: CommandResult) -> bool:
        """Forget the counter of a hub that calls a command repeated; return whether to challenge it again."""
        if result.outcome != Outcome.REPEATED or not hub.is_present or hub.resyncs >= _MAX_RESYNCS:
            return False
        hub.resyncs += 1
        hub.nonce, hub.next_seq, hub.answered_ns = new_nonce(), None, None
        return True

    def _answer(self, hub: HubAtLink, frame: bytes) -> bool:
        if not hub.is_genuine(frame) or frame[wire.LENGTH_OFFSET] != _ANSWER_BYTES:
            return False
        nonce, boot_count, highest_seq = _ANSWER.unpack_from(frame, wire.HEADER_BYTES)
        if (nonce, boot_count) != (hub.nonce, hub.boot_count):
            return False
        hub.next_seq = max(hub.next_seq or 0, highest_seq + 1)
        return True

    def _hello(self, number: int, frame: bytes) -> None:
        signed = is_signed(frame)
        if frame[wire.LENGTH_OFFSET] != _HELLO_BYTES + (wire.TAG_BYTES if signed else 0):
            return
        major, minor, hub_id, sensor_id, boot_count = _HELLO.unpack_from(frame, wire.HEADER_BYTES)
        genuine = signed and self._is_genuine(sensor_id, boot_count, frame)
        present = self.hubs.get(number)
        if present is not None and present.signs and not genuine:
            return  # only a genuine hello replaces a genuine one
        if present is not None and (present.hub_id, present.boot_count, present.signs) == (hub_id, boot_count, genuine):
            return
        if present is not None and present.is_present and hub_id == present.hub_id and boot_count < present.boot_count:
            return  # a start that is over
        key = self._keys.get(hub_identity(hub_id))
        self.hubs[number] = HubAtLink(number, hub_id, boot_count, (major, minor), genuine, key)

    def _is_genuine(self, sensor_id: int, boot_count: int, frame: bytes) -> bool:
        key = self._keys.get(sensor_identity(sensor_id))
        return key is not None and Verifier(key, sensor_id, boot_count).is_genuine(frame)


def command_frame(command: Command, seq: int, hub: int = EVERY_HUB) -> bytes:
    """Return the unsigned frame of a command to every wheel of a hub, or of every hub of the link."""
    return encode_frame(Frame(COMMAND_TYPES[type(command)], hub, HUB_ITSELF, seq, 0, command))
