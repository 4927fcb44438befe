"""Keys of sensors and hubs in a private text file: one line each, identity and key in hexadecimal digits."""

from __future__ import annotations

import re
import secrets
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from gateway.security.cmac import KEY_BYTES, FrameSigner, Key, SecurityError
from gateway.security.private_file import keep_from_core_dumps, locked, read_private, write_private

SENSOR_DIGITS: Final = 8
HUB_DIGITS: Final = 16
_LINE: Final = re.compile(r"([0-9a-fA-F]+)[ \t]+([0-9a-fA-F]{32})")
_MAX_BYTES: Final = 16 << 20
_HEADER: Final = "# Keys of treadlink: serial number of a sensor (8 digits) or hub (16), key. Keep it secret.\n"


def default_key_file() -> Path:
    """Return the user's own key file."""
    from platformdirs import user_data_path

    return user_data_path("treadlink", appauthor=False) / "keys"


def command_keys(key_file: Path | None) -> dict[str, Key]:
    """Return the keys for commands, by identity: those of a file, or of the user's own.

    Raises:
        SecurityError: the file cannot be read, is not private, or was given and does not exist.
    """
    return stored_keys(key_file).keys


def stored_keys(key_file: Path | None) -> KeyFile:
    """Return a key file that somebody has given, or the user's own, which need not exist.

    Raises:
        SecurityError: the file cannot be read, is not private, or was given and does not exist.
    """
    if key_file is None:
        return KeyFile(default_key_file())
    if not key_file.exists():
        raise SecurityError(
            f"'{key_file}' does not exist",
            f"Give the key file, or make it: treadlink keys new SERIAL --keys '{key_file}'.",
        )
    return KeyFile(key_file)


def counters_file(key_file: Path) -> Path:
    """Return the file with the counters that belong to a key file."""
    return key_file.with_name(key_file.name + ".counters")


def sensor_identity(number: int) -> str:
    """Return the identity of a sensor by its serial number."""
    return f"{number:0{SENSOR_DIGITS}x}"


def hub_identity(number: int) -> str:
    """Return the identity of a hub by its serial number."""
    return f"{number:0{HUB_DIGITS}x}"


def new_nonce() -> int:
    """Return a random number of 64 bit that nobody can foretell."""
    return secrets.randbits(64)


def parse_identity(text: str) -> str:
    """Return an identity as it is stored: up to 8 hexadecimal digits are a sensor, 16 a hub.

    Raises:
        SecurityError: it is neither.
    """
    if not re.fullmatch(r"[0-9a-fA-F]{1,8}|[0-9a-fA-F]{16}", text):
        raise SecurityError(
            f"'{text[:40]}' is not a serial number of a sensor or hub",
            "Give up to 8 hexadecimal digits for a sensor, such as 0000a001, or 16 for a hub; see `treadlink inspect`.",
        )
    return text.lower().rjust(SENSOR_DIGITS, "0")


class KeyFile:
    """Keys by identity, and their file.

    Attributes:
        path: the file.
        keys: by identity.
    """

    def __init__(self, path: Path) -> None:
        """Read the file; one that does not exist contains no key.

        Raises:
            SecurityError: it cannot be read, is not private, or contains anything else.
        """
        self.path = path
        keep_from_core_dumps()
        text = read_private(path, _MAX_BYTES)
        self.keys: dict[str, Key] = dict(parse_keys(text, str(path))) if text is not None else {}

    def make(self, identity: str, *, replace: bool = False) -> Key:
        """Make a key; `save` stores it.

        Raises:
            SecurityError: there is one already and `replace` is not set.
        """
        self._refuse_known([identity], replace=replace)
        key = self.keys[identity] = Key(secrets.token_bytes(KEY_BYTES))
        return key

    def add(self, keys: Mapping[str, Key], *, replace: bool = False) -> None:
        """Add keys from elsewhere; `save` stores them.

        Raises:
            SecurityError: an identity has another key already and `replace` is not set.
        """
        self._refuse_known([name for name, key in keys.items() if self.keys.get(name, key) != key], replace=replace)
        self.keys.update(keys)

    def remove(self, identity: str) -> None:
        """Remove a key; `save` stores the change.

        Raises:
            SecurityError: there is no such key.
        """
        if self.keys.pop(identity, None) is None:
            raise SecurityError(f"there is no key for {identity} in '{self.path}'", "See `treadlink keys list`.")

    def save(self) -> None:
        """Write the file, readable by its owner only.

        Raises:
            SecurityError: it cannot be written.
        """
        lines = (f"{identity} {key.secret.hex()}\n" for identity, key in sorted(self.keys.items()))
        write_private(self.path, _HEADER + "".join(lines))

    def _refuse_known(self, identities: list[str], *, replace: bool) -> None:
        present = [identity for identity in identities if identity in self.keys]
        if present and not replace:
            raise SecurityError(
                f"'{self.path}' already has a key for {', '.join(present)}",
                "Nothing was changed. --replace stores the new key instead; the old one is then lost.",
            )


@contextmanager
def key_file_to_change(path: Path) -> Iterator[KeyFile]:
    """Yield a key file, read while no other process changes it; call its `save` within.

    Raises:
        SecurityError: it cannot be read or locked.
    """
    with locked(path):
        yield KeyFile(path)


def parse_keys(text: str, origin: str) -> Iterator[tuple[str, Key]]:
    """Yield identity and key of every line of a key file.

    Raises:
        SecurityError: it names the first invalid line, but not its content, which may be a key.
    """
    identities: set[str] = set()
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), 1):
        content = line.partition("#")[0].strip()
        if not content:
            continue
        match = _LINE.fullmatch(content)
        if match is None:
            raise SecurityError(
                f"{origin}, line {number} is not an identity and a key",
                "A line is the serial number of a sensor (up to 8 hexadecimal digits) or hub (16), and its key (32).",
            )
        identity = parse_identity(match[1])
        if identity in identities:
            raise SecurityError(f"{origin}, line {number}: {identity} has a key already", "Keep one of them.")
        identities.add(identity)
        yield identity, Key(bytes.fromhex(match[2]))


def open_signer(key_file: Path, identities: Iterable[str]) -> FrameSigner:
    """Return a signer for these sensors and hubs.

    Raises:
        SecurityError: a key is missing, or the file cannot be used.
    """
    keys = KeyFile(key_file).keys
    missing = [identity for identity in identities if identity not in keys]
    if missing:
        raise SecurityError(
            f"'{key_file}' has no key for {', '.join(missing)}",
            f"Make them: treadlink keys new {' '.join(missing)} --keys '{key_file}'.",
        )
    return FrameSigner(keys)
