"""Signing and verifying frames with AES-128-CMAC, by the optional package `cryptography`."""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from firmware_protocol import wire
from firmware_protocol.signing import freshness, sign, signed_part, tag_of
from gateway.core.errors import TreadlinkError

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.cmac import CMAC

KEY_BYTES: Final = 16
_REMEDY: Final = "Install it: pip install 'treadlink[auth]'."


class SecurityError(TreadlinkError):
    """Keys or counters cannot be used as they are."""


class Key:
    """A secret key, which its `repr` hides.

    Attributes:
        secret: its 16 bytes.
    """

    __slots__ = ("secret",)

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_BYTES:
            raise ValueError(f"a key has {KEY_BYTES} bytes, this one has {len(secret)}")
        self.secret = secret

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Key) and hmac.compare_digest(self.secret, other.secret)

    def __hash__(self) -> int:
        return hash(self.secret)

    def __repr__(self) -> str:
        return "Key(...)"

    def check_value(self) -> str:
        """Return six digits by which keys can be compared without showing them."""
        return mac(self, bytes(KEY_BYTES))[:3].hex()


def begin_mac(key: Key) -> CMAC:
    """Return a CMAC object to be copied for every message.

    Raises:
        SecurityError: the package `cryptography` is missing.
    """
    try:
        from cryptography.hazmat.primitives.ciphers.algorithms import AES
        from cryptography.hazmat.primitives.cmac import CMAC
    except ImportError as error:
        raise SecurityError("signed frames need the package 'cryptography'", _REMEDY) from error
    return CMAC(AES(key.secret))


def mac(key: Key, data: bytes) -> bytes:
    """Return the AES-128-CMAC of `data`, 16 bytes.

    Raises:
        SecurityError: the package `cryptography` is missing.
    """
    code = begin_mac(key)
    code.update(data)
    return code.finalize()


class Verifier:
    """Check of the tags of one sensor or hub during one of its starts."""

    __slots__ = ("_begun", "boot_count")

    def __init__(self, key: Key, identity: int, boot_count: int) -> None:
        """Prepare; this costs as much as checking several frames, so keep the object."""
        self.boot_count = boot_count
        self._begun = begin_mac(key)
        self._begun.update(freshness(identity, boot_count))

    def is_genuine(self, frame: bytes) -> bool:
        """Return whether the tag of a signed frame is right, in a time that does not depend on the tag."""
        code = self._begun.copy()
        code.update(signed_part(frame))
        return hmac.compare_digest(code.finalize()[: wire.TAG_BYTES], tag_of(frame))


class FrameSigner:
    """Signing of frames as sensors and hubs do it, for the simulator and for tests."""

    def __init__(self, keys: Mapping[str, Key]) -> None:
        """Prepare the keys, given by identity.

        Raises:
            SecurityError: the package `cryptography` is missing.
        """
        self._codes = {identity: begin_mac(key) for identity, key in keys.items()}

    def __call__(self, frame: bytes, identity: str, boot_count: int) -> bytes:
        """Return the signed form of an unsigned frame.

        Raises:
            ValueError: its payload leaves no room for a tag.
            KeyError: there is no key for this identity.
        """
        template = self._codes[identity]

        def mac(data: bytes) -> bytes:
            code = template.copy()
            code.update(data)
            return code.finalize()

        return sign(frame, int(identity, 16), boot_count, mac)
