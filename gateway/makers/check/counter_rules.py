"""Rules of the frame counters and of the hub's starts."""

from dataclasses import dataclass, field
from typing import Final

from firmware_protocol.counters import SourceCounters
from firmware_protocol.messages import HUB_ITSELF, Hello, HubStatus
from firmware_protocol.source_tracking import SourceTracker
from gateway.core.reasons import Reason
from gateway.makers.check.clauses import Clause, Ledger
from gateway.makers.check.seen_frame import SeenFrame, SourceKey, signed_step, source_name
from gateway.makers.reasons import FirmwareCode

# A hub's clock that goes back by more shows a start; frames of several sources may be this late.
_RESTART_US: Final = 1_000_000
# Larger gaps are no loss on a link.
_LARGEST_GAP: Final = 10_000
# Share of frames above which a pattern explains the counters.
_PATTERN_SHARE: Final = 0.9


@dataclass(slots=True)
class _Hub:
    """Counters of a hub over all of its sources."""

    tick_us: int | None = None
    boot_count: int | None = None
    # Since the last HELLO, its clock has gone back, and its counters too.
    restart: SeenFrame | None = None
    counts_anew: bool = False
    last: tuple[SourceKey, int] | None = None  # source and seq
    # From a frame of one source to the next one of another: those of one counter, and all.
    shared_steps: int = 0
    changes: int = 0
    dropped: tuple[int, int] | None = None


@dataclass(slots=True)
class _Source:
    """Counters of one source."""

    tracker: SourceTracker = field(default_factory=lambda: SourceTracker(SourceCounters()))
    frames: int = 0
    last_seq: int | None = None
    swapped_steps: int = 0
    same_steps: int = 0
    saw_start: bool = False
    must_start: bool = False
    gaps: list[tuple[SeenFrame, int]] = field(default_factory=list)
    repeated: list[SeenFrame] = field(default_factory=list)
    went_back: list[SeenFrame] = field(default_factory=list)
    lost: int = 0
    damaged: int = 0


class CounterRules:
    """Follows `seq`, `boot_count` and the numbers of dropped frames."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._hubs: dict[int, _Hub] = {}
        self._sources: dict[SourceKey, _Source] = {}

    def lost(self, source: SourceKey) -> int:
        """Return how many frames of a source are missing by its counter."""
        return self._sources[source].lost if source in self._sources else 0

    def lost_of_hub(self, hub: int) -> int:
        """Return how many frames of all sources of a hub are missing by their counters."""
        return sum(state.lost for (of_hub, _), state in self._sources.items() if of_hub == hub)

    def started(self, source: SourceKey) -> bool:
        """Return whether the first frame of a source was the first of a start."""
        state = self._sources.get(source)
        return state is not None and state.saw_start

    def frame(self, seen: SeenFrame, *, after_damage: bool) -> bool:
        """Take a frame; return whether the hub has started anew with it.

        Args:
            seen: the frame.
            after_damage: whether damaged bytes came since the last frame.
        """
        hub = self._hubs.setdefault(seen.hub, _Hub())
        state = self._sources.setdefault(seen.source, _Source())
        restarted = self._restarted(hub, state, seen)
        self._pattern(hub, state, seen)
        self._start(state, seen, is_first=not state.frames)
        state.frames += 1
        counters = state.tracker.counters
        prior_counts = counters.lost, counters.duplicates, counters.reordered, counters.restarts
        state.tracker.accept(seen.seq)
        lost, duplicates, reordered, restarts = (
            current - previous
            for current, previous in zip(
                (counters.lost, counters.duplicates, counters.reordered, counters.restarts), prior_counts, strict=True
            )
        )
        if lost > 0:
            state.lost += lost
            state.damaged += lost if after_damage else 0
            state.gaps.append((seen, lost))
        if duplicates:
            state.repeated.append(seen)
        if reordered or restarts:
            state.went_back.append(seen)
        if isinstance(seen.message, HubStatus):
            first = hub.dropped[0] if hub.dropped is not None else seen.message.frames_dropped
            hub.dropped = first, seen.message.frames_dropped
        return restarted

    def _restarted(self, hub: _Hub, state: _Source, frame: SeenFrame) -> bool:
        """Follow the starts of a hub: its clock goes back, and its counters too or, by HELLO, its boot count rises."""
        went_back = hub.tick_us is not None and signed_step(hub.tick_us, frame.tick_us) < -_RESTART_US
        if went_back:
            hub.restart = frame
        if hub.tick_us is None or went_back or signed_step(hub.tick_us, frame.tick_us) > 0:
            hub.tick_us = frame.tick_us
        counts_anew = went_back and frame.seq < state.tracker.expected
        if counts_anew:
            self._start_anew(frame.hub)
            hub.counts_anew = True
        if isinstance(frame.message, Hello) and frame.wheel != HUB_ITSELF:
            return self._boot_count(hub, frame, frame.message) or counts_anew
        return counts_anew

    def _boot_count(self, hub: _Hub, frame: SeenFrame, hello: Hello) -> bool:
        """Compare a hello's boot count with the starts; return whether it alone shows one."""
        previous, hub.boot_count = hub.boot_count, hello.boot_count
        restart, hub.restart = hub.restart, None
        counts_anew, hub.counts_anew = hub.counts_anew, False
        if previous is None or restart is None:
            return False
        self._ledger.check(Clause.BOOT_COUNT)
        if hello.boot_count < previous or (hello.boot_count == previous and counts_anew):
            before, after = float(previous), float(hello.boot_count)
            reason = Reason(FirmwareCode.BOOT_COUNT_NOT_HIGHER, before=before, after=after)
            self._ledger.fail(Clause.BOOT_COUNT, frame, reason)
        if hello.boot_count == previous or counts_anew:
            return False
        self._start_anew(frame.hub)
        return True

    def _start_anew(self, number: int) -> None:
        for (of_hub, _), state in self._sources.items():
            if of_hub == number:
                state.tracker = SourceTracker(SourceCounters())
                state.must_start = True
                state.last_seq = None
        self._hubs[number].last = None

    def _start(self, state: _Source, frame: SeenFrame, *, is_first: bool) -> None:
        if is_first and frame.seq == 0:
            self._ledger.check(Clause.START)
            state.saw_start = True
        elif state.must_start:
            self._ledger.check(Clause.START)
            if frame.seq != 0:
                self._ledger.fail(
                    Clause.START, frame, Reason(FirmwareCode.SEQ_WRONG, how="not_from_zero", seq=float(frame.seq))
                )
        state.must_start = False

    @staticmethod
    def _pattern(hub: _Hub, state: _Source, frame: SeenFrame) -> None:
        """Count steps that a wrong counter would make."""
        if hub.last is not None and hub.last[0] != frame.source:
            hub.changes += 1
            hub.shared_steps += signed_step(hub.last[1], frame.seq) == 1
        hub.last = frame.source, frame.seq
        if state.last_seq is not None:
            state.same_steps += state.last_seq == frame.seq
            state.swapped_steps += signed_step(swapped(state.last_seq), swapped(frame.seq)) == 1
        state.last_seq = frame.seq

    def finish(self) -> None:
        """Judge the counters of the whole stream."""
        for source, state in self._sources.items():
            self._ledger.check(Clause.SEQ, state.frames)
            self._ledger.check(Clause.LOSS, state.frames)
            self._judge(self._hubs[source[0]], source, state)
        for number, hub in self._hubs.items():
            if hub.dropped is None or hub.dropped[1] <= hub.dropped[0]:
                continue
            dropped = hub.dropped[1] - hub.dropped[0]
            self._ledger.check(Clause.DROPS)
            missing = self.lost_of_hub(number)
            if missing < dropped / 2:
                reason = Reason(FirmwareCode.DROPS_NOT_NUMBERED, dropped=float(dropped), missing=float(missing))
                self._ledger.fail(Clause.DROPS, f"hub {number}", reason)

    def _judge(self, hub: _Hub, source: SourceKey, state: _Source) -> None:
        first = next((frame for frame, _ in state.gaps), None) or next(iter(state.repeated + state.went_back), None)
        if first is None:
            return
        if state.same_steps > _PATTERN_SHARE * (state.frames - 1):
            self._ledger.fail(Clause.SEQ, first, Reason(FirmwareCode.SEQ_WRONG, how="stands", seq=float(first.seq)))
            return
        if hub.changes and hub.shared_steps > _PATTERN_SHARE * hub.changes:
            self._ledger.fail(Clause.SEQ, first, Reason(FirmwareCode.SEQ_WRONG, how="shared"))
            return
        if state.swapped_steps > _PATTERN_SHARE * (state.frames - 1):
            self._ledger.fail(Clause.SEQ, first, Reason(FirmwareCode.SEQ_WRONG, how="big_endian"))
            return
        for frame in state.repeated:
            self._ledger.fail(Clause.SEQ, frame, Reason(FirmwareCode.SEQ_WRONG, how="repeated", seq=float(frame.seq)))
        for frame in state.went_back:
            self._ledger.fail(Clause.SEQ, frame, Reason(FirmwareCode.SEQ_WRONG, how="goes_back", seq=float(frame.seq)))
        for frame, gap in state.gaps:
            if gap > _LARGEST_GAP:
                self._ledger.fail(
                    Clause.SEQ, frame, Reason(FirmwareCode.SEQ_WRONG, how="jumps", gap=float(gap), seq=float(frame.seq))
                )
        lost = sum(gap for _, gap in state.gaps if gap <= _LARGEST_GAP)
        if lost and not state.went_back:
            reason = Reason(FirmwareCode.CHECK_FRAMES_LOST, lost=lost, frames=state.frames, damaged=state.damaged)
            self._ledger.fail(Clause.LOSS, source_name(source), reason, first.data, first.at_byte)


def swapped(number: int) -> int:
    """Return a number of 32 bits with its bytes in the other order."""
    return int.from_bytes(number.to_bytes(4, "little"), "big")
