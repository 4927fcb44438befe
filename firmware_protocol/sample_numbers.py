"""Rule by which sample numbers and the hub's clock advance together (specification, "Sample numbers")."""

from typing import Final, overload

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.wire import COUNTER_BITS

_JUMP_S: Final = 0.25
_JUMP_SHARE: Final = 0.05
# Over hours without a connection, ticks wrap and the clocks of sensor and hub drift apart.
_DRIFT: Final = 5e-4
_TICK_PERIOD_S: Final = 2**COUNTER_BITS * 1e-6

Numbers = NDArray[np.int64]


def apart_s(samples: Numbers | int, us: Numbers | float, rate_hz: float) -> NDArray[np.float64]:
    """Return by how much samples have advanced more than the hub's clock, s; ticks may have wrapped in between."""
    apart = np.asarray(samples / rate_hz - us * 1e-6)
    return np.asarray(apart - np.rint(apart / _TICK_PERIOD_S) * _TICK_PERIOD_S)


@overload
def is_jump(samples: int, us: float, rate_hz: float) -> np.bool_: ...
@overload
def is_jump(samples: Numbers, us: Numbers, rate_hz: float) -> NDArray[np.bool_]: ...
def is_jump(samples: Numbers | int, us: Numbers | float, rate_hz: float) -> NDArray[np.bool_] | np.bool_:
    """Return whether sample numbers have jumped, rather than samples been lost.

    Args:
        samples: advance of the sample number, (k,) or one.
        us: advance of the hub's clock.
        rate_hz: stated rate.
    """
    tolerance_s = _JUMP_S + _JUMP_SHARE * np.abs(us) * 1e-6 + _DRIFT * np.abs(samples) / rate_hz
    return np.abs(apart_s(samples, us, rate_hz)) > tolerance_s
