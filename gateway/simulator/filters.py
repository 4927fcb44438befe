"""Causal second-order filters in blocks. A banded solve runs the recursion, which avoids importing scipy.signal."""

import cmath
import math

import numpy as np
from scipy.linalg.lapack import dtbtrs

from gateway.core.types import FloatArray


class Biquad:
    """y[n] = b0 x[n] + b1 x[n-1] + b2 x[n-2] - a1 y[n-1] - a2 y[n-2], several channels at once, with memory.

    The first block starts from the steady state of its first sample.
    """

    def __init__(self, forward: tuple[float, float, float], feedback: tuple[float, float]) -> None:
        """Take (b0, b1, b2) and (a1, a2)."""
        self._b = forward
        self._a = feedback
        self._state: tuple[FloatArray, FloatArray] | None = None

    def __call__(self, block: FloatArray) -> FloatArray:
        """Filter the next block (n, channels); n may be 0."""
        if not len(block):
            return block
        (b0, b1, b2), (a1, a2) = self._b, self._a
        if self._state is None:
            gain = (b0 + b1 + b2) / (1.0 + a1 + a2)
            self._state = np.repeat(block[:1], 2, axis=0), gain * np.repeat(block[:1], 2, axis=0)
        past_in, past_out = self._state
        source = np.concatenate([past_in, block])
        driven = b0 * source[2:] + b1 * source[1:-1] + b2 * source[:-2]
        driven[0] -= a1 * past_out[1] + a2 * past_out[0]
        driven[1:2] -= a2 * past_out[1]
        band = np.empty((3, len(block)))
        band[0], band[1], band[2] = 1.0, a1, a2
        out, info = dtbtrs(band, driven, uplo="L")
        if info != 0:
            raise FloatingPointError("a filter's recursion cannot be solved")
        self._state = source[-2:], np.concatenate([past_out, out])[-2:]
        filtered: FloatArray = out
        return filtered


def lowpass(corner_hz: float, rate_hz: float) -> Biquad:
    """Return a two-pole Butterworth low-pass, -3 dB at `corner_hz` (bilinear transform, prewarped)."""
    k = math.tan(math.pi * corner_hz / rate_hz)
    scale = 1.0 + math.sqrt(2.0) * k + k * k
    b0 = k * k / scale
    return Biquad((b0, 2.0 * b0, b0), (2.0 * (k * k - 1.0) / scale, (1.0 - math.sqrt(2.0) * k + k * k) / scale))


def highpass(corner_hz: float, rate_hz: float) -> Biquad:
    """Return a one-pole high-pass, -3 dB at `corner_hz`: the coupling capacitor of an AC-coupled sensor."""
    k = math.tan(math.pi * corner_hz / rate_hz)
    b0 = 1.0 / (1.0 + k)
    return Biquad((b0, -b0, 0.0), ((k - 1.0) / (1.0 + k), 0.0))


def resonator(centre_hz: float, width_hz: float, rate_hz: float) -> Biquad:
    """Return a two-pole band-pass of gain 1 at its centre and -3 dB at the ends of its width."""
    k = math.tan(math.pi * centre_hz / rate_hz)
    across = k * width_hz / centre_hz
    scale = 1.0 + across + k * k
    return Biquad((across / scale, 0.0, -across / scale), (2.0 * (k * k - 1.0) / scale, (1.0 - across + k * k) / scale))


def loose_mass(resonance_hz: float, quality: float, rate_hz: float) -> Biquad:
    """Return the transmissibility of a damped spring-mass: gain 1 below, sqrt(1 + Q^2) at the resonance.

    T = (1 + i x / Q) / (1 - x^2 + i x / Q), x = f / resonance. The poles are those of the mass. The zeros make gain,
    delay and curvature at low frequencies exact: a bilinear transform warps them, for 2.5 kHz at 9600 Hz by 40 % of
    T - 1.
    """
    step_rad = 2.0 * math.pi * resonance_hz / rate_hz
    pole = cmath.exp(step_rad * (-0.5 / quality + 1j * math.sqrt(max(1.0 - 0.25 / quality**2, 0.0))))
    a1, a2 = -2.0 * pole.real, abs(pole) ** 2
    # Moments of b: those of a, the second with T = 1 + x^2 + ...
    gain = 1.0 + a1 + a2
    delay, curvature = a1 + 2.0 * a2, a1 + 4.0 * a2 - 2.0 * gain / step_rad**2
    b2 = 0.5 * (curvature - delay)
    b1 = delay - 2.0 * b2
    return Biquad((gain - b1 - b2, b1, b2), (a1, a2))


def lowpass_noise_gain(corner_hz: float, rate_hz: float) -> float:
    """Return the standard deviation of unit white noise after `lowpass`."""
    # The poles lie within corner_hz, so this many samples hold all of the impulse response.
    return _noise_gain(lowpass(corner_hz, rate_hz), max(64, round(8.0 * rate_hz / corner_hz)))


def band_noise_gain(centre_hz: float, width_hz: float, rate_hz: float) -> float:
    """Return the standard deviation of unit white noise after `resonator`."""
    return _noise_gain(resonator(centre_hz, width_hz, rate_hz), max(64, round(8.0 * rate_hz / width_hz)))


def _noise_gain(probe: Biquad, samples: int) -> float:
    """Return the root of the sum of the squared impulse response."""
    impulse = np.zeros((samples, 1))
    probe(np.zeros((1, 1)))
    impulse[0] = 1.0
    return float(np.sqrt((probe(impulse) ** 2).sum()))
