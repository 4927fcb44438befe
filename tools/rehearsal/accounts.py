"""Accounts of a day: every frame, every name, and the numbers against those of a quiet day."""

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gateway.core.links.bus_frames import unpack
from gateway.core.links.source import BusFrames, Chunk, LinkEventKind, Sentences
from gateway.core.recording.reader import RecordingReader
from gateway.core.session.alarms import AlarmName
from gateway.core.session.reasons import SessionCode
from gateway.simulator.link_faults import frame_pieces
from tools.rehearsal.day import START_NS, Played
from tools.rehearsal.plan import BUS, EXPECTED, HUBS, LINKS, NOBODY, POSITIONS, RECEIVER, SETTLE_S, Fault, Kind

# A frame may wait in a chunk before the fault, and in a line after it.
_BEFORE_S: Final = 0.5
_AFTER_S: Final = 0.3
# The share of damaged frames is that of a thousand; a hub of this day sends 65 a second.
_JUDGED_S: Final = 32.0


@dataclass(slots=True)
class Accounts:
    """What became of a day.

    Attributes:
        faults: injected.
        named: of these, named.
        missed: not named.
        false: alarms and warnings without a cause, and alarms that stand at the end.
        frames: sent, those of the bus and sentences of the receiver included.
        lost: by cause.
        unaccounted: times and links of frames lost without a cause.
        worst: largest difference from the quiet day, over the standard error of one revolution.
        compared: number of estimates compared.
    """

    faults: int = 0
    named: int = 0
    missed: list[Fault] = field(default_factory=list)
    false: list[tuple[float, str, str]] = field(default_factory=list)
    frames: int = 0
    lost: Counter[Kind] = field(default_factory=Counter)
    unaccounted: list[tuple[float, str]] = field(default_factory=list)
    worst: float = 0.0
    compared: int = 0


def account(played: Played, quiet: Played, faults: list[Fault]) -> Accounts:
    """Return the accounts of a day with faults, and of the quiet day with the same seed."""
    accounts = Accounts(faults=len(faults))
    recorded, computer = _recorded(played)
    for number, sent in enumerate(played.sent):
        accounts.frames += len(sent)
        back_s = played.restored_s[played.links[number]]
        for at_s, frame in sent:
            if frame in recorded[number]:
                continue
            cause = next((f for f in faults if _loses(f, number) and _covers(f, at_s, back_s)), None)
            if cause is None:
                accounts.unaccounted.append((at_s, played.links[number]))
            else:
                accounts.lost[cause.kind] += 1
    said = sorted([*played.said, *computer])
    named: set[Fault] = set()
    for at_s, subject, name in said:
        causes = [fault for fault in faults if _explains(fault, at_s, _target(played, subject), name)]
        named |= {fault for fault in causes if name in EXPECTED[fault.kind].names}
        if not causes:
            accounts.false.append((at_s, subject, name))
    accounts.false += [(math.inf, *alarm) for alarm in played.standing if alarm[1] != AlarmName.MISPLACED]
    accounts.named = len(named)
    accounts.missed = [fault for fault in faults if fault not in named]
    for key, mean in quiet.means.items():
        other = played.means.get(key)
        if other is not None and mean.value is not None and other.value is not None:
            accounts.compared += 1
            ratio = abs(other.value - mean.value) / float(np.median(quiet.single_std[key]))
            accounts.worst = max(accounts.worst, ratio)
    return accounts


def _recorded(played: Played) -> tuple[list[set[bytes]], list[tuple[float, str, str]]]:
    """Return the frames of each hub, the content of those of the bus, sentences, and the events of this computer."""
    chunks: list[list[Chunk]] = [[] for _ in range(HUBS)]
    others: list[set[bytes]] = [set() for _ in range(HUBS, LINKS)]
    computer = []
    for path in played.recordings:
        for item in RecordingReader(path).items():
            if isinstance(item, Chunk):
                chunks[played.links.index(item.link)].append(item)
            elif isinstance(item, BusFrames):
                others[BUS - HUBS] |= {frame.data for frame in unpack(item.data, 0)}
            elif isinstance(item, Sentences):
                others[RECEIVER - HUBS] |= set(item.data.splitlines(keepends=True))
            elif item.kind is LinkEventKind.COMPUTER:
                computer += [((item.host_ns - START_NS) * 1e-9, "", str(detail.code)) for detail in item.details]
    frames = [{piece.data for _, _, pieces in frame_pieces(each) for piece in pieces if piece.whole} for each in chunks]
    return [*frames, *others], computer


def _loses(fault: Fault, number: int) -> bool:
    return EXPECTED[fault.kind].loses and fault.target in (number, NOBODY)


def _covers(fault: Fault, at_s: float, back_s: list[float]) -> bool:
    """Return whether a fault covers a time; a link is away until it is open again."""
    end_s = fault.end_s
    if fault.kind in (Kind.UNPLUGGED, Kind.CUT):
        end_s = next((time_s for time_s in back_s if time_s >= end_s), end_s)
    return fault.begin_s - _BEFORE_S <= at_s <= end_s + _AFTER_S


def _explains(fault: Fault, at_s: float, target: int, name: str) -> bool:
    expected = EXPECTED[fault.kind]
    settle_s = _JUDGED_S if name == str(SessionCode.FRAMES_DAMAGED) else SETTLE_S
    if name not in expected.names | expected.may or not fault.begin_s - _BEFORE_S <= at_s <= fault.end_s + settle_s:
        return False
    return NOBODY in (fault.target, target) or fault.target == target


def _target(played: Played, subject: str) -> int:
    """Return what a subject such as `FL`, `hub 2`, a link or `LINK, FL` is about."""
    last = subject.rpartition(", ")[2]
    if last in POSITIONS:
        return POSITIONS.index(last)
    if subject in played.links:
        return played.links.index(subject)
    if last.startswith("hub ") and last[4:].isdecimal():
        return int(last[4:])
    return next((number for number, link in enumerate(played.links) if link in subject), NOBODY)
