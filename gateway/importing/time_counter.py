"""Times of a counter of few bits, which starts again at zero."""

import math
from typing import Final

import numpy as np

from gateway.core.types import FloatArray

# Counters of microcontrollers; one of 2^32 us starts again each 71.6 minutes, also where it was converted to ms or s.
_COUNTS: Final = (2.0**32, 2.0**24, 2.0**16, 2.0**32 * 1e-3, 2.0**32 * 1e-6)
# Sample intervals that may be missing where a counter starts again; a step back by another amount is a fault.
_MAX_MISSING: Final = 20


class TimeCounter:
    """Continuation of a counter that starts again at zero, block by block.

    Attributes:
        restarts: number of times at which it started again.
    """

    def __init__(self) -> None:
        """Begin before the first block."""
        self.restarts = 0
        self._last = math.nan
        self._interval = math.nan
        self._offset = 0.0

    def look(self, times: FloatArray) -> FloatArray:
        """Return the (n,) times of the next rows as those of a counter that goes on; a row without a time is NaN."""
        rows = np.flatnonzero(np.isfinite(times))
        if not len(rows):
            return times
        values = times[rows]
        if not self._interval > 0.0 and len(rows) > 1:
            self._interval = float(np.median(np.diff(values) / np.diff(rows)))
        steps = np.diff(values, prepend=self._last)
        self._last = float(values[-1])
        offsets = np.zeros(len(rows))
        for row in np.flatnonzero(steps < 0.0).tolist():
            limit = self._interval * (_MAX_MISSING + (rows[row] - rows[row - 1] if row else 1))
            last = values[row] - steps[row]
            # Both sides of the step lie at the ends of the counter.
            fitting = [n for n in _COUNTS if 0.0 <= values[row] <= limit and n - last > 0.0 and n + steps[row] <= limit]
            if fitting:
                offsets[row] = fitting[0]
                self.restarts += 1
        if not offsets.any() and not self._offset:
            return times
        total = self._offset + np.cumsum(offsets)
        self._offset = float(total[-1])
        continued = times.copy()
        continued[rows] = values + total
        return continued
