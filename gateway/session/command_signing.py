"""Signing of commands for the hubs of one link, and verification of their replies."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from firmware_protocol import wire
from firmware_protocol.codec import encode_frame
from firmware_protocol.messages import (
    COMMAND_TYPES,
    EVERY_HUB,
    HUB_ITSELF,
    Command,
    CommandResult,
    Frame,
    MessageType,
    Outcome,
)
from firmware_protocol.signing import is_of_hub, is_signed, sign
from gateway.security.cmac import Key, Verifier, mac
from gateway.security.key_file import hub_identity, sensor_identity

_HELLO: Final = struct.Struct("<BB6xQII")
_HELLO_BYTES: Final = 70
_U32: Final = 0xFFFF_FFFF
_NS_PER_S: Final = 1_000_000_000
_MOST_RESYNCS: Final = 3


@dataclass(slots=True)
class HubAtLink:
    """A hub by its last hello.

    Attributes:
        hub: number on the link.
        hub_id: serial number.
        boot_count: its present start.
        protocol: (major, minor) version of its firmware.
        signs: whether a sensor of it has sent a verified hello.
        key: of the hub, None when there is none.
        next_seq: counter of the next signed command, None before the first.
        resyncs: times that the hub has asked for a higher counter, in this start.
    """

    hub: int
    hub_id: int
    boot_count: int
    protocol: tuple[int, int]
    signs: bool
    key: Key | None
    next_seq: int | None = None
    resyncs: int = 0
    _verifier: Verifier | None = field(default=None, repr=False)

    @property
    def verifies_commands(self) -> bool:
        """Whether its firmware takes signed commands, and no others."""
        return self.signs and self.protocol >= (wire.VERSION_MAJOR, wire.SIGNED_COMMANDS_MINOR)

    def is_genuine(self, frame: bytes) -> bool:
        """Return whether a frame of the hub itself is signed with its key."""
        if self.key is None or not is_signed(frame):
            return False
        if self._verifier is None:
            self._verifier = Verifier(self.key, self.hub_id, self.boot_count)
        return self._verifier.is_genuine(frame)


class HubCommands:
    """Commands to the hubs of one link; a `firmware_protocol.signing.Gate` of its decoder.

    A hub whose sensors sign gets signed commands, any other one unsigned commands. Its replies count only when they
    are signed with its key.

    Attributes:
        hubs: by number on the link, those whose hello has come.
    """

    def __init__(self, keys: Mapping[str, Key]) -> None:
        """Take the keys by identity of sensor or hub."""
        self._keys = keys
        self.hubs: dict[int, HubAtLink] = {}

    def __call__(self, frame: bytes) -> bool:
        """Learn from a hello; return whether an intact frame may be read."""
        hub = frame[wire.HUB_OFFSET]
        if frame[wire.TYPE_OFFSET] == MessageType.HELLO and not is_of_hub(frame):
            self._hello(hub, frame)
        elif frame[wire.TYPE_OFFSET] == MessageType.COMMAND_RESULT:
            known = self.hubs.get(hub)
            return known is None or not known.verifies_commands or known.is_genuine(frame)
        return True

    def frame(self, command: Command, hub: HubAtLink, now_ns: int) -> bytes:
        """Return the frame of a command to every wheel of a hub, signed if the hub verifies commands.

        Args:
            command: what to do.
            hub: addressee.
            now_ns: time since the epoch. The counter begins with its seconds, so that the commands of a later session
                are newer without a memory.

        Raises:
            KeyError: the hub verifies commands and there is no key for it.
        """
        if not hub.verifies_commands:
            return command_frame(command, 0, hub.hub)
        if hub.key is None:
            raise KeyError(hub_identity(hub.hub_id))
        seq = min(now_ns // _NS_PER_S, _U32) if hub.next_seq is None else hub.next_seq
        hub.next_seq = min(seq + 1, _U32)
        key = hub.key
        return sign(command_frame(command, seq, hub.hub), hub.hub_id, hub.boot_count, lambda data: mac(key, data))

    def resynchronise(self, hub: HubAtLink, result: CommandResult) -> bool:
        """Continue behind the counter of a hub that calls a command repeated; return whether to send again."""
        if result.outcome != Outcome.REPEATED or not hub.verifies_commands or hub.resyncs >= _MOST_RESYNCS:
            return False
        hub.resyncs += 1
        hub.next_seq = min(max(hub.next_seq or 0, result.seq + 1), _U32)
        return True

    def _hello(self, number: int, frame: bytes) -> None:
        signed = is_signed(frame)
        if frame[wire.LENGTH_OFFSET] != _HELLO_BYTES + (wire.TAG_BYTES if signed else 0):
            return
        major, minor, hub_id, sensor_id, boot_count = _HELLO.unpack_from(frame, wire.HEADER_BYTES)
        genuine = signed and self._is_genuine(sensor_id, boot_count, frame)
        known = self.hubs.get(number)
        if known is not None and known.signs and not genuine:
            return  # only a genuine hello replaces a genuine one
        if known is not None and (known.hub_id, known.boot_count, known.signs) == (hub_id, boot_count, genuine):
            return
        key = self._keys.get(hub_identity(hub_id))
        self.hubs[number] = HubAtLink(number, hub_id, boot_count, (major, minor), genuine, key)

    def _is_genuine(self, sensor_id: int, boot_count: int, frame: bytes) -> bool:
        key = self._keys.get(sensor_identity(sensor_id))
        return key is not None and Verifier(key, sensor_id, boot_count).is_genuine(frame)


def command_frame(command: Command, seq: int, hub: int = EVERY_HUB) -> bytes:
    """Return the unsigned frame of a command to every wheel of a hub, or of every hub of the link."""
    return encode_frame(Frame(COMMAND_TYPES[type(command)], hub, HUB_ITSELF, seq, 0, command))
