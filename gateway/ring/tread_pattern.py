"""Belt vibration locked to the tire: waves from the contact edges and tread blocks in the contact.

Measured tires show wave packets that run out of both edges, of different order before and after the contact, the same
in every revolution. They are prescribed here, not solved: the smooth ring has no tread pattern to excite them.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.types import FloatArray

# A packet grows from zero over this angle, so that there is no step at the edge.
_ONSET_RAD: Final = 0.03


@dataclass(frozen=True, slots=True)
class EdgeWaves:
    """Two decaying wave packets.

    Attributes:
        amplitude: at the edges, as a share of R omega^2.
        order_before: waves a revolution ahead of the leading edge.
        order_after: waves a revolution behind the trailing edge.
        decay_rad: angle over which a packet falls to 1/e.
        phase_rad: phase at the edges.
    """

    amplitude: float
    order_before: float = 35.0
    order_after: float = 45.0
    decay_rad: float = 1.0
    phase_rad: float = 0.0

    def radial(self, theta_rad: FloatArray, leading_rad: float, trailing_rad: float) -> FloatArray:
        """Return the packets' contribution to the radial axis in R omega^2, over one uniform revolution (N,).

        Orders 0 and 1 are removed: the curvature of a closed belt has a mean of one turn and no first order of its own.
        """
        ahead_rad = np.mod(leading_rad - theta_rad, 2.0 * np.pi)
        behind_rad = np.mod(theta_rad - trailing_rad, 2.0 * np.pi)
        free_rad = 2.0 * np.pi - (trailing_rad - leading_rad)
        wave = np.zeros_like(theta_rad)
        for distance, order in ((ahead_rad, self.order_before), (behind_rad, self.order_after)):
            onset = 1.0 - np.exp(-((distance / _ONSET_RAD) ** 2))
            packet = onset * np.exp(-distance / self.decay_rad) * np.cos(order * distance + self.phase_rad)
            wave += np.where(distance < free_rad, packet, 0.0)
        spectrum = np.fft.rfft(wave)
        spectrum[:2] = 0.0
        return self.amplitude * np.fft.irfft(spectrum, n=len(theta_rad))


@dataclass(frozen=True, slots=True)
class TreadPitch:
    """Tread blocks that bend the belt where they press on the road: one wave per block, the same in every revolution.

    Attributes:
        amplitude: in the contact, as a share of R omega^2.
        blocks: number on the circumference.
        reach_rad: standard deviation of the Gaussian with which the wave decays beyond the contact edges.
        phase_rad: of the pattern at the sensor.
    """

    amplitude: float
    blocks: float = 70.0
    reach_rad: float = 0.15
    phase_rad: float = 0.0

    def radial(self, theta_rad: FloatArray, leading_rad: float, trailing_rad: float) -> FloatArray:
        """Return the blocks' contribution to the radial axis in R omega^2, over one uniform revolution (N,)."""
        distance = np.maximum(np.maximum(leading_rad - theta_rad, theta_rad - trailing_rad), 0.0)
        envelope = np.exp(-0.5 * (distance / self.reach_rad) ** 2)
        wave: FloatArray = self.amplitude * envelope * np.cos(self.blocks * theta_rad + self.phase_rad)
        return wave
