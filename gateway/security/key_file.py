"""Keys of sensors and hubs in a private text file, one line each: identity and key in hexadecimal digits."""

from __future__ import annotations

import re
import secrets
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from gateway.security.cmac import KEY_BYTES, Key, SecurityError
from gateway.security.private_file import read_private, write_private

SENSOR_DIGITS: Final = 8
HUB_DIGITS: Final = 16
_LINE: Final = re.compile(r"([0-9a-fA-F]+)[ \t]+([0-9a-fA-F]{32})")
_MOST_BYTES: Final = 16 << 20
_HEADER: Final = "# Keys of treadlink: serial number of a sensor (8 digits) or hub (16), key. Keep from others.\n"


def default_key_file() -> Path:
    """Return the user's own key file."""
    from platformdirs import user_data_path

    return user_data_path("treadlink", appauthor=False) / "keys"


def counters_file(key_file: Path) -> Path:
    """Return the file with the counters that belong to a key file."""
    return key_file.with_name(key_file.name + ".counters")


def sensor_identity(number: int) -> str:
    """Return the identity of a sensor by its serial number."""
    return f"{number:0{SENSOR_DIGITS}x}"


def hub_identity(number: int) -> str:
    """Return the identity of a hub by its serial number."""
    return f"{number:0{HUB_DIGITS}x}"


def parse_identity(text: str) -> str:
    """Return an identity as it is kept: up to 8 hexadecimal digits are a sensor, 16 a hub.

    Raises:
        SecurityError: neither.
    """
    if not re.fullmatch(r"[0-9a-fA-F]{1,8}|[0-9a-fA-F]{16}", text):
        raise SecurityError(
            f"'{text[:40]}' is no serial number of a sensor or hub",
            "Give up to 8 hexadecimal digits for a sensor, as 0000a001, or 16 for a hub; `treadlink inspect` tells.",
        )
    return text.lower().rjust(SENSOR_DIGITS, "0")


class KeyFile:
    """Keys by identity, and the file that they are in.

    Attributes:
        path: the file.
        keys: by identity.
    """

    def __init__(self, path: Path) -> None:
        """Read the file; one that does not exist holds no key.

        Raises:
            SecurityError: it cannot be read, is not private, or holds anything else.
        """
        self.path = path
        text = read_private(path, _MOST_BYTES)
        self.keys: dict[str, Key] = dict(parse_keys(text, str(path))) if text is not None else {}

    def make(self, identity: str, *, replace: bool = False) -> Key:
        """Make a key; `save` keeps it.

        Raises:
            SecurityError: there is one, and it is not to be replaced.
        """
        self._refuse_known([identity], replace=replace)
        key = self.keys[identity] = Key(secrets.token_bytes(KEY_BYTES))
        return key

    def add(self, keys: Mapping[str, Key], *, replace: bool = False) -> None:
        """Take keys from elsewhere; `save` keeps them.

        Raises:
            SecurityError: one is known with another key, and it is not to be replaced.
        """
        self._refuse_known([name for name, key in keys.items() if self.keys.get(name, key) != key], replace=replace)
        self.keys.update(keys)

    def remove(self, identity: str) -> None:
        """Forget a key; `save` makes it last.

        Raises:
            SecurityError: there is none.
        """
        if self.keys.pop(identity, None) is None:
            raise SecurityError(f"there is no key of {identity} in '{self.path}'", "See `treadlink keys list`.")

    def save(self) -> None:
        """Write the file, for its owner alone.

        Raises:
            SecurityError: it cannot be written.
        """
        lines = (f"{identity} {key.secret.hex()}\n" for identity, key in sorted(self.keys.items()))
        write_private(self.path, _HEADER + "".join(lines))

    def _refuse_known(self, identities: list[str], *, replace: bool) -> None:
        known = [identity for identity in identities if identity in self.keys]
        if known and not replace:
            raise SecurityError(
                f"'{self.path}' has a key of {', '.join(known)} already",
                "Nothing was changed. --replace takes the new key in its place; then the old one is lost.",
            )


def parse_keys(text: str, origin: str) -> Iterator[tuple[str, Key]]:
    """Yield identity and key of every line of a key file.

    Raises:
        SecurityError: naming the first line that is none; its content is not told, it may be a key.
    """
    known: set[str] = set()
    for number, line in enumerate(text.splitlines(), 1):
        content = line.partition("#")[0].strip()
        if not content:
            continue
        match = _LINE.fullmatch(content)
        if match is None:
            raise SecurityError(
                f"{origin}, line {number} is no identity and key",
                "A line is the serial number of a sensor (up to 8 hexadecimal digits) or hub (16), and its key (32).",
            )
        identity = parse_identity(match[1])
        if identity in known:
            raise SecurityError(f"{origin}, line {number}: {identity} has a key already", "Keep one of them.")
        known.add(identity)
        yield identity, Key(bytes.fromhex(match[2]))
