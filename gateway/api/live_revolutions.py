"""Live estimates for programs: an iterator over revolutions as they complete."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, Self

from gateway.api.recording_access import path_of
from gateway.api.revolution_view import Revolution
from gateway.core.clock import SystemClock
from gateway.core.errors import RecordingError, SourceError, TreadlinkError
from gateway.core.estimates.results import SessionSnapshot
from gateway.core.session.program_arguments import Config, PathLike, chosen_vehicle, paths, several_names
from gateway.core.session.session_opening import OpenedSession, SessionSettings, open_session
from gateway.core.text.session_summary import summary_lines
from gateway.core.text.wording import notice_text, text

_POLL_S: Final = 0.05


def live(
    *sources: str,
    config: Config | None = None,
    record: PathLike | None = None,
    keys: PathLike | None = None,
    effects: PathLike | Sequence[PathLike] = (),
    estimators: str | Sequence[str] = (),
    duration_s: float | None = None,
) -> LiveRevolutions:
    """Estimate the wheels of one or more sources as their data arrive.

    `for revolution in gateway.live("serial:///dev/ttyUSB0"):` ends with the sources; leaving the loop, Ctrl-C and an
    error close them. Reading, recording and estimating go on in the background while the loop is busy.

    Args:
        sources: URIs as for `treadlink live`: `serial:`, `tcp:`, `ble:`, `sim:` or `replay:`.
        config: vehicle configuration, as a file or as read; None for the one in the recording or scenario.
        record: also record to this new .mcap file, or to a new file in this folder.
        keys: file with the keys of signed frames; None for the key file of `treadlink keys`.
        effects: files of `treadlink diagnose --save-effects`, whose effects are subtracted.
        estimators: names of the estimators; none for the default ones.
        duration_s: stop after this many seconds of data, and of waiting for a silent hub.

    Raises:
        SourceError: no source is given, or one is wrong. One that cannot be opened is reported by the iterator.
        ConfigError: the configuration or the effects have faults.
        RecordingError: the recording cannot be created.
    """
    if not sources:
        raise SourceError("there is no source", 'Give one, such as gateway.live("sim:demo").')
    opened = open_session(
        sources,
        lambda provided: chosen_vehicle(config, provided, sources[0]),
        SessionSettings(
            config_path=path_of(config),
            record=None if record is None else Path(record),
            estimators=several_names(estimators),
            key_file=None if keys is None else Path(keys),
            effects_paths=paths(effects),
            duration_s=duration_s,
            latency_s=0.0,
        ),
        clock=SystemClock(),
    )
    return LiveRevolutions(opened, sources)


class LiveRevolutions:
    """Iterator over the revolutions of all wheels of a running session, and a context manager that closes it."""

    def __init__(self, opened: OpenedSession, sources: Sequence[str]) -> None:
        """Take a started session; use `gateway.live`."""
        self._opened = opened
        self._session = opened.live
        self._sources = tuple(sources)
        self._ready: deque[Revolution] = deque()
        self._closed = False

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Revolution:
        """Wait for the next revolution.

        Raises:
            StopIteration: the sources have ended, or the session was closed.
            TreadlinkError: a source, the recording or the session failed.
        """
        try:
            while not self._ready:
                if self._closed:
                    raise StopIteration
                ended = self._session.wait(0.0)
                self._ready.extend(map(Revolution, self._session.results()))
                if not self._ready and ended:
                    self.close()
                elif not self._ready:
                    if self._opened.time_is_up():
                        self._session.request_stop()
                    self._session.wait_for_results(_POLL_S)
        except BaseException:
            self._abandon()
            raise
        return self._ready.popleft()

    @property
    def snapshot(self) -> SessionSnapshot:
        """Latest state of all wheels and links, made ten times a second."""
        return self._session.snapshot()

    @property
    def wheels(self) -> tuple[str, ...]:
        """Positions of the wheels so far, configured ones first."""
        return tuple(wheel.position for wheel in self.snapshot.wheels)

    @property
    def alarms(self) -> dict[str, tuple[str, ...]]:
        """Present alarms in words, by position of the wheel or name of the link."""
        by_position: dict[str, tuple[str, ...]] = {}
        for alarm in self.snapshot.alarms:
            by_position[alarm.position] = (*by_position.get(alarm.position, ()), text(alarm.reason))
        return by_position

    @property
    def dropped(self) -> int:
        """Items that the session could not take, and revolutions that the loop was too slow for."""
        return sum(sum(link.queue_dropped.values()) for link in self.snapshot.links)

    def notices(self) -> tuple[str, ...]:
        """Return the notices since the last call, in words."""
        return tuple(map(notice_text, self._session.notices()))

    def mark(self, words: str) -> None:
        """Mark an event in the recording, with the present time."""
        self._session.mark(words)

    def summary(self) -> str:
        """Return what the command prints at the end, of the revolutions so far."""
        snapshot = self.snapshot
        return "\n".join(
            summary_lines(self._opened.live.summary.wheels(snapshot.wheels), snapshot.links, snapshot.alarm_records)
        )

    def close(self) -> None:
        """Close the sources and finish the recording; may be called twice.

        Raises:
            TreadlinkError: a source, the recording or the session failed.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._session.close()
        finally:
            self._opened.remove_empty_recording()
        fault = self._session.core.recording.fault
        if fault is not None:
            raise RecordingError(fault, "Check the disk and its free space, then record again.")

    def _abandon(self) -> None:
        """Close after another error, which the user needs first."""
        with suppress(TreadlinkError):
            self.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self._abandon()

    def __del__(self) -> None:
        if hasattr(self, "_closed"):
            self._abandon()

    def __repr__(self) -> str:
        state = "closed" if self._closed else f"running for {self.snapshot.elapsed_s:.1f} s"
        return f"<LiveRevolutions of {', '.join(self._sources)}: {state}, wheels {', '.join(self.wheels) or 'none'}>"
