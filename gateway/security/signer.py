"""Signs frames as sensors and hubs do; for the simulator and for tests."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from firmware_protocol.signing import sign
from gateway.security.cmac import Key, SecurityError, start
from gateway.security.key_file import KeyFile


class FrameSigner:
    """Signs for every identity of which there is a key."""

    def __init__(self, keys: Mapping[str, Key]) -> None:
        """Take the keys by identity.

        Raises:
            SecurityError: the package `cryptography` is missing.
        """
        self._codes = {identity: start(key) for identity, key in keys.items()}

    def __call__(self, frame: bytes, identity: str, boot_count: int) -> bytes:
        """Return an unsigned frame signed.

        Raises:
            ValueError: its payload leaves no room for a tag.
            KeyError: there is no key.
        """
        begun = self._codes[identity]

        def mac(data: bytes) -> bytes:
            code = begun.copy()
            code.update(data)
            return code.finalize()

        return sign(frame, int(identity, 16), boot_count, mac)


def open_signer(key_file: Path, identities: Iterable[str]) -> FrameSigner:
    """Return what signs for these sensors and hubs.

    Raises:
        SecurityError: a key is missing, or the file cannot be used.
    """
    keys = KeyFile(key_file).keys
    missing = [identity for identity in identities if identity not in keys]
    if missing:
        raise SecurityError(
            f"'{key_file}' has no key of {', '.join(missing)}",
            f"Make them: treadlink keys new {' '.join(missing)} --file '{key_file}'.",
        )
    return FrameSigner(keys)
