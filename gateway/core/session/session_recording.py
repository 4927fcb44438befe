"""Recording of a session: its items, and results, messages and notices as topics."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, Final

from firmware_protocol.messages import Frame
from gateway.core.errors import RecordingError
from gateway.core.estimates.results import AlarmChange, RevolutionResult
from gateway.core.links.source import LinkItem
from gateway.core.reasons import Level, Notice, Reason
from gateway.core.recording.mcap_layout import ALARMS_TOPIC
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_stage import Recorder
from gateway.core.text.recording_topics import (
    alarm_payload,
    message_topic,
    notice_payload,
    revolution_payload,
    waveform_payload,
    wheel_topic,
)
from gateway.core.types import FloatArray

_WAVEFORM_INTERVAL_NS: Final = 1_000_000_000


class SessionRecording:
    """The recording of a session, if there is one. One that fails does not end the session: a notice reports it.

    Attributes:
        recorder: None when there is no recording, or it failed.
        fault: why a recording of the session stopped early, None when none did.
        stopped: the same of the present recording.
    """

    def __init__(self, recorder: Recorder | None, notify: Callable[[Notice], None]) -> None:
        """Take an open recording, closed by `close`; `notify` takes notices."""
        self.recorder = recorder
        self.fault: str | None = None
        self.stopped: Reason | None = None
        self._notify = notify
        self._last = _path_and_size(recorder)
        self._waveform_due_ns: dict[str, int] = {}

    @property
    def path_and_size(self) -> tuple[str, int]:
        """Path and size in bytes of the recording, or of the last one; empty without any."""
        if self.recorder is not None:
            self._last = _path_and_size(self.recorder)
        return self._last

    def goes_on_in(self, recorder: Recorder | None) -> None:
        """Record to another recording from now on, or to none; the caller closes the one before."""
        if self.recorder is not None:
            self._notify(Notice("", Reason(SessionCode.RECORDING_FINISHED, path=str(self.recorder.path))))
        self.recorder, self._last = recorder, _path_and_size(recorder)
        if recorder is not None:
            self.stopped = None
            self._notify(Notice("", Reason(SessionCode.RECORDING_BEGUN, path=str(recorder.path))))
        self._waveform_due_ns.clear()

    def item(self, item: LinkItem) -> None:
        """Record an item of a link."""
        self._record(lambda recorder: recorder.write(item))

    def signals(self, values: Mapping[str, float], host_ns: int) -> None:
        """Record values of the vehicle's bus."""
        self._topic("/vehicle/signals", host_ns, values)

    def notice(self, notice: Notice, link: str, host_ns: int) -> None:
        """Record a notice."""
        if self.recorder is not None:
            self._topic("/log", host_ns, notice_payload(notice, link))

    def alarm(self, change: AlarmChange, host_ns: int) -> None:
        """Record an alarm that was raised, acknowledged or is over."""
        if self.recorder is not None:
            self._topic(ALARMS_TOPIC, host_ns, alarm_payload(change))

    def message(self, frame: Frame, position: str, link: str, host_ns: int) -> None:
        """Record a frame without samples of a wheel or hub."""
        entry = message_topic(frame, position, link) if self.recorder is not None else None
        if entry is not None:
            self._topic(entry[0], host_ns, entry[1])

    def results(
        self, results: Sequence[RevolutionResult], host_ns: int, average_mps2: Callable[[str], FloatArray | None]
    ) -> None:
        """Record revolutions, and once a second the last one of a wheel against its average.

        Args:
            results: the revolutions.
            host_ns: present time.
            average_mps2: returns the average of a wheel after its last revolution, at its speed.
        """
        if self.recorder is None:
            return
        latest = {result.position: result for result in results}
        for result in results:
            position = result.position
            self._topic(wheel_topic(position, "revolution"), host_ns, revolution_payload(result))
            if latest[position] is result and host_ns >= self._waveform_due_ns.get(position, 0):
                self._waveform_due_ns[position] = host_ns + _WAVEFORM_INTERVAL_NS
                average = average_mps2(position)
                if average is not None:
                    self._topic(wheel_topic(position, "waveform"), host_ns, waveform_payload(result, average))

    def tick(self, now_ns: int) -> None:
        """Flush to the operating system."""
        self._record(lambda recorder: recorder.tick(now_ns))

    def close(self) -> None:
        """Finish the file."""
        self._record(lambda recorder: recorder.close())
        self._last, self.recorder = self.path_and_size, None

    def _topic(self, topic: str, host_ns: int, payload: Mapping[str, Any]) -> None:
        self._record(lambda recorder: recorder.write_topic(topic, host_ns, payload))

    def _record(self, write: Callable[[Recorder], None]) -> None:
        if self.recorder is None:
            return
        try:
            write(self.recorder)
        except RecordingError as error:
            self._last, self.fault = _path_and_size(self.recorder), str(error)
            with suppress(RecordingError):  # the user needs the first failure
                self.recorder.close()
            self.recorder = None
            self.stopped = Reason(SessionCode.RECORDING_STOPPED, error=str(error), remedy=error.remedy)
            self._notify(Notice("", self.stopped, Level.ERROR))


def _path_and_size(recorder: Recorder | None) -> tuple[str, int]:
    return (str(recorder.path), recorder.size_bytes) if recorder is not None else ("", 0)
