"""What the user is told of frames that were not verified: each thing once, again when it has grown a hundredfold."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Protocol

from firmware_protocol.messages import HUB_ITSELF

_AGAIN: Final = 100
# A hello comes every 2 s; so many frames of a source before it are worth a word, fewer are not.
_PATIENCE: Final = 1000

_TEXTS: Final = {
    "unsigned": "{who}: a frame is not signed; anybody could have sent it",
    "wrong tag": "{who}: a signed frame has a wrong tag: forged, of an earlier start, or its key is not the one here",
    "replayed": "{who}: a frame came that had come before: somebody may be playing a recording of the sensor",
    "too late": "{who}: a frame came long after later ones: somebody may be playing a recording of the sensor",
    "no key": "{who}: frames are signed by {stranger}, of which there is no key; `treadlink keys import` admits it",
    "before hello": "{who}: signed frames come but no hello that could be verified",
}
_COUNT_FIRST: Final = {"before hello": _PATIENCE}


class _Place(Protocol):
    @property
    def position(self) -> str: ...
    @property
    def sensor(self) -> str | None: ...


class Teller:
    """Finds the words for one link."""

    def __init__(
        self,
        link: str,
        places: Mapping[tuple[int, int], _Place],
        owners: Mapping[str, str],
        *,
        requires: bool,
    ) -> None:
        """Know the vehicle.

        Args:
            link: name of the link.
            places: wheels of the configuration.
            owners: position by the sensor that belongs there.
            requires: whether what is told of was ignored.
        """
        self._link = link
        self._places = places
        self._owners = owners
        self._requires = requires
        self._counts: dict[tuple[bytes, str, str | None], int] = {}
        self._due: dict[tuple[bytes, str, str | None], int] = {}

    def found(self, source: bytes, verdict: str, stranger: str | None) -> list[str]:
        """Count a frame of a source; return what is to be told now.

        Args:
            source: hub and wheel number.
            verdict: what is wrong.
            stranger: identity that the source claims and that is not verified or does not belong there.
        """
        # Strangers come and go by the sender's will: what is kept must not grow with them.
        what = (source, verdict, stranger if stranger in self._owners else None)
        count = self._counts[what] = self._counts.get(what, 0) + 1
        if count < self._due.get(what, _COUNT_FIRST.get(verdict, 1)):
            return []
        self._due[what] = count * _AGAIN
        more = f" ({count} such frames)" if count > 1 else ""
        effect = "ignored, but recorded" if self._requires else "used all the same (policy warn)"
        return [f"SECURITY: {self._text(source, verdict, stranger)}; {effect}{more}"]

    def _text(self, source: bytes, verdict: str, stranger: str | None) -> str:
        hub, wheel = source
        place = self._places.get((hub, wheel))
        who = place.position if place else f"hub {hub}" + ("" if wheel == HUB_ITSELF else f" wheel {wheel}")
        who = f"{self._link}, {who}"
        if verdict != "not admitted":
            name = "an unknown sensor" if stranger is None else self._named(stranger)
            return _TEXTS[verdict].format(who=who, stranger=name)
        owner = self._owners.get(stranger or "")
        if owner is not None:
            return f"{who}: sensor {stranger} of {owner} speaks here: wheels swapped?"
        wanted = f", the configuration names {place.sensor}" if place is not None else ", which is not configured"
        return f"{who}: sensor {stranger} speaks here{wanted}; put it into the configuration to admit it"

    def _named(self, identity: str) -> str:
        return f"hub {identity}" if len(identity) > 8 else f"sensor {identity}"
