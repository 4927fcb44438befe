"""A rolling wheel's radial signal with its truth, and the hello of its sensor, for the tests of the pipeline."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Coupling, Hello
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring

RADIUS_M = 0.32
PRESSURE_PA = 210e3
LOAD_N = 5000.0
SCALE_MPS2 = 0.05


@cache
def ring_solution() -> RingSolution:
    ring = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=RADIUS_M, pressure_pa=PRESSURE_PA)
    return solve_rolling_ring(ring, LOAD_N, PRESSURE_PA, 56.42, nodes=1200)


@dataclass(frozen=True)
class Rolling:
    """A radial signal and its truth."""

    rate_hz: float
    speed_mps: NDArray[np.float64]
    theta_rad: NDArray[np.float64]
    radial_mps2: NDArray[np.float64]
    contacts: NDArray[np.float64]

    def errors(self, centres: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance of each centre from the nearest true contact, in samples."""
        return np.array([np.abs(self.contacts - centre).min() for centre in centres])


def hello(rate_hz: float = 9600.0, **changes: object) -> Hello:
    base = Hello(
        1, 0, 0xAB, 0x1234, (1, 2, 3), 1, rate_hz, 0b100, Coupling.DC, 0.0,
        (0.0, 0.0, 19620.0), (0.0, 0.0, SCALE_MPS2), (0.0, 0.0, 0.0), 32767,
    )  # fmt: skip
    return base._replace(**changes)
