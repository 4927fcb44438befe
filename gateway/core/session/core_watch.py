"""Watch over the thread of the session's core: an estimator that does not return is named."""

import sys
import threading
from types import FrameType
from typing import Final

from gateway.core.estimates.plugin_estimator import PluginEstimator
from gateway.core.estimates.registry import estimator_names
from gateway.core.reasons import Reason
from gateway.core.session.reasons import SessionCode

LOOK_S: Final = 0.25
"""Time between two looks."""
# Looks without progress. The work of an estimator on some revolutions takes milliseconds; other work is done on all
# wheels, and at the end of a session on all that waits.
_LOOKS_IN_ESTIMATOR: Final = 16
_LOOKS_ELSEWHERE: Final = 80
_CALLS: Final = ("update", "update_block")


class CoreWatch:
    """Compares what the core does from look to look. Looks are counted, not their time: a computer may be suspended.

    Attributes:
        name: what has not returned, as alarms name it.
        stuck_s: for how long it has not; 0 while the core goes on.
    """

    def __init__(self, thread: threading.Thread) -> None:
        """Watch a thread."""
        self._thread = thread
        self._round = -1
        self._call: FrameType | None = None
        self._looks = 0
        self.name = "session"
        self.stuck_s = 0.0

    def look(self, round_number: int) -> bool:
        """Take the number of the core's present round; return whether the core is stuck."""
        name, call = _running(self._thread)
        if round_number != self._round or call is not self._call:
            self._looks, self._round, self._call = 0, round_number, call
        self._looks += 1
        is_stuck = self._looks > (_LOOKS_ELSEWHERE if call is None else _LOOKS_IN_ESTIMATOR)
        self.name, self.stuck_s = name, (self._looks - 1) * LOOK_S if is_stuck else 0.0
        return is_stuck

    @property
    def reason(self) -> Reason:
        """What is stuck, and for how long."""
        return Reason(SessionCode.CORE_STUCK, stuck_s=self.stuck_s)


def _running(thread: threading.Thread) -> tuple[str, FrameType | None]:
    """Return the name of the estimator that a thread is in, and the frame of its call; without one, of the session."""
    frame = sys._current_frames().get(thread.ident or 0)
    while frame is not None:
        owner = frame.f_locals.get("self")
        is_call = isinstance(owner, PluginEstimator) or frame.f_code.co_name in _CALLS
        name = getattr(owner, "name", None)
        if is_call and name in estimator_names():
            return f"estimator {name}", frame
        frame = frame.f_back
    return "session", None
