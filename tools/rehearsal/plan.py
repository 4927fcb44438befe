"""Plan of a day: what is to go wrong, when, and what the session must say of it."""

from collections.abc import Iterator
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from gateway.core.links.reasons import LinkCode
from gateway.core.reasons import Code
from gateway.core.session.alarms import AlarmName
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recent_loss import WINDOW_S

HUBS: Final = 4
TERMINALS: Final = (0, 1)
"""Hubs on pseudo-terminals; the others are on TCP."""
BUS: Final = HUBS
RECEIVER: Final = HUBS + 1
"""Positioning receiver on a pseudo-terminal of its own."""
LINKS: Final = HUBS + 2
NOBODY: Final = -1
"""Target of what concerns the computer, the disk or the broker."""
POSITIONS: Final = ("FL", "FR", "RL", "RR")
WARM_UP_S: Final = 5.0
SETTLE_S: Final = 5.0
"""Time after a fault within which its consequences end."""


class Kind(StrEnum):
    """What goes wrong."""

    UNPLUGGED = "port unplugged"
    CUT = "TCP cut"
    NOISE = "bits flipped"
    RESTART = "hub restarts"
    SENSOR = "sensor dies"
    REPLACED = "hub replaced"
    BUS = "bus silent"
    RECEIVER = "receiver silent"
    POSITION = "position lost"
    BROKER = "broker restarts"
    DISK = "disk full"
    CLOCK = "clock set"
    PAUSE = "computer pauses"


class Expectation(NamedTuple):
    """What a kind of fault causes.

    Attributes:
        names: one of them must be said: of its target, or of the whole session.
        may: what else it causes.
        loses: whether frames may be lost.
    """

    names: frozenset[str]
    may: frozenset[str] = frozenset()
    loses: bool = False


def _of(*names: AlarmName | Code) -> frozenset[str]:
    return frozenset(map(str, names))


_GAP: Final = _of(AlarmName.SILENT, AlarmName.LOSS, AlarmName.ENVIRONMENT)
_LINK: Final = _of(LinkCode.LINK_LOST, LinkCode.LINK_RETRYING, LinkCode.LINK_RESTORED)
EXPECTED: Final = {
    Kind.UNPLUGGED: Expectation(_of(AlarmName.LINK), _GAP | _LINK, loses=True),
    Kind.CUT: Expectation(_of(AlarmName.LINK), _GAP | _LINK, loses=True),
    Kind.NOISE: Expectation(_of(AlarmName.LOSS), _of(SessionCode.FRAMES_DAMAGED), loses=True),
    Kind.RESTART: Expectation(_of(SessionCode.HUB_RESTARTED), _GAP),
    Kind.SENSOR: Expectation(_of(AlarmName.SILENT), _GAP),
    Kind.REPLACED: Expectation(_of(AlarmName.MISPLACED), _GAP | _of(SessionCode.HUB_RESTARTED)),
    Kind.BUS: Expectation(_of(AlarmName.SILENT)),
    Kind.RECEIVER: Expectation(_of(AlarmName.SILENT)),
    Kind.POSITION: Expectation(_of(AlarmName.SILENT)),
    Kind.BROKER: Expectation(_of(AlarmName.PUBLISHING)),
    Kind.DISK: Expectation(
        _of(SessionCode.RECORDING_STOPPED),
        _of(SessionCode.RECORDING_BEGUN, AlarmName.STOPPED, SessionCode.RECORDING_PART_REFUSED),
        loses=True,
    ),
    Kind.CLOCK: Expectation(_of(LinkCode.SYSTEM_TIME_SET)),
    Kind.PAUSE: Expectation(_of(LinkCode.COMPUTER_PAUSED), _of(AlarmName.LOSS), loses=True),
}

_SILENCES: Final = (Kind.BUS, Kind.SENSOR, Kind.RECEIVER, Kind.POSITION)


class Fault(NamedTuple):
    """A fault of the plan: seconds from the beginning of the day, a hub, BUS, RECEIVER or NOBODY, and a size.

    The size is the step of a clock in s; that of other faults is 0.
    """

    kind: Kind
    begin_s: float
    end_s: float
    target: int
    size_s: float = 0.0


def planned_day(seed: int, rounds: int = 1, *, without: frozenset[Kind] = frozenset()) -> tuple[list[Fault], float]:
    """Return the faults of a day, each kind once a round in random order, and the length of the day in s.

    A hub is replaced in the last round only: its sensor is another one from then on.
    """
    rng = np.random.default_rng(seed)
    faults = list(_faults(rng, rounds, without))
    return faults, (faults[-1].end_s if faults else WARM_UP_S) + WINDOW_S + SETTLE_S


def _faults(rng: np.random.Generator, rounds: int, without: frozenset[Kind]) -> Iterator[Fault]:
    at_s = WARM_UP_S
    for number in range(rounds):
        kinds = [kind for kind in Kind if kind not in without and (kind is not Kind.REPLACED or number == rounds - 1)]
        for index in rng.permutation(len(kinds)):
            kind = kinds[index]
            at_s += float(rng.uniform(0.5, 2.0))
            # Buses, receivers and sensors count as silent after 3 s.
            end_s = at_s + float(rng.uniform(2.0, 4.0)) + (2.0 if kind in _SILENCES else 0.0)
            yield Fault(kind, at_s, end_s, _target(kind, rng), float(rng.choice([-1, 1]) * rng.uniform(2.0, 5e6)))
            at_s = end_s + SETTLE_S


def _target(kind: Kind, rng: np.random.Generator) -> int:
    if kind is Kind.UNPLUGGED:
        return int(rng.choice(TERMINALS))
    if kind is Kind.CUT:
        return int(rng.integers(len(TERMINALS), HUBS))
    if kind is Kind.BUS:
        return BUS
    if kind in (Kind.RECEIVER, Kind.POSITION):
        return RECEIVER
    if kind in (Kind.BROKER, Kind.DISK, Kind.CLOCK, Kind.PAUSE):
        return NOBODY
    return int(rng.integers(HUBS))
