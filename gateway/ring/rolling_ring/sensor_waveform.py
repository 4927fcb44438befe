"""Waveform of a sensor on the belt: exact kinematics of a steadily passing shape, and periodic curves by FFT."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import ComplexArray, FloatArray


class SensorWaveform(NamedTuple):
    """Specific force over one revolution, split into its parts by angular speed, gravity and angular acceleration.

    All arrays are (..., N) over material angles theta = -pi + 2 pi i / N; radial is positive inward, circumferential
    along +theta. Specific force = omega^2 * shape + g * gravity + domega/dt * spin (`specific_force`).

    Attributes:
        radial_m: radial shape, acceleration per omega^2 (about R outside the contact, 0 inside).
        circumferential_m: circumferential shape.
        gravity_radial: projection of minus gravity on the radial axis, cos of the belt's inclination.
        gravity_circumferential: projection of minus gravity on the circumferential axis.
        spin_radial_m: radial reaction to angular acceleration, the axle's own acceleration included.
        spin_circumferential_m: circumferential reaction, 0 in the contact, where the belt rests on the road.
    """

    radial_m: FloatArray
    circumferential_m: FloatArray
    gravity_radial: FloatArray
    gravity_circumferential: FloatArray
    spin_radial_m: FloatArray
    spin_circumferential_m: FloatArray

    def specific_force(
        self, omega_radps: float, omega_dot_radps2: float = 0.0, gravity_mps2: float = STANDARD_GRAVITY_MPS2
    ) -> tuple[FloatArray, FloatArray]:
        """Return (radial, circumferential) specific force in m/s^2 at every angle; gravity 0 leaves it out."""
        radial = omega_radps**2 * self.radial_m + gravity_mps2 * self.gravity_radial
        travel = omega_radps**2 * self.circumferential_m + gravity_mps2 * self.gravity_circumferential
        return (radial + omega_dot_radps2 * self.spin_radial_m, travel + omega_dot_radps2 * self.spin_circumferential_m)


def angle_derivatives(values: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return first and second derivative by the angle of periodic complex curves (..., N), by FFT."""
    spectrum = np.fft.fft(values)
    first, second = _factors(values.shape[-1])
    return np.fft.ifft(first * spectrum), np.fft.ifft(second * spectrum)


@lru_cache(maxsize=16)
def _factors(nodes: int) -> ComplexArray:
    """Return the factors of a spectrum (N,) by which the first and the second derivative follow, (2, N)."""
    order = np.fft.fftfreq(nodes, 1.0 / nodes)
    factors: ComplexArray = np.stack([1j * order, -(order**2)])
    if nodes % 2 == 0:
        factors[0, nodes // 2] = 0.0
    factors.setflags(write=False)
    return factors


def waveform_orders(waveform: FloatArray, max_order: int) -> ComplexArray:
    """Return coefficients c_n - i s_n, n = 0 to max_order, of curves (..., N) over theta = -pi + 2 pi i / N."""
    n = waveform.shape[-1]
    spectrum = np.fft.rfft(waveform, axis=-1)[..., : max_order + 1] * (2.0 / n)
    spectrum[..., 0] *= 0.5
    spectrum[..., 1::2] *= -1.0
    result: ComplexArray = spectrum
    return result


def sensor_waveform(
    position_m: FloatArray, radius_m: float, sensor_offset_m: float = 0.0, section_rad: FloatArray | None = None
) -> SensorWaveform:
    """Return the waveform of a sensor `sensor_offset_m` below (inside) the belt's neutral layer.

    The sensor passes the shape z - e n_out once a revolution. Its acceleration omega^2 d2/dtheta2 is taken by FFT and
    projected on its own axes. These follow the belt's normal and tangent, or the belt's section where that turns
    separately (a shear-flexible belt).

    Args:
        position_m: (..., N, 2) neutral layers, axle at the origin, y up, belt counter-clockwise.
        radius_m: rolling circumference / 2 pi; turns angular acceleration into the axle's acceleration.
        sensor_offset_m: e.
        section_rad: (..., N) direction of the belt's section, None when it is the tangent's.
    """
    neutral = np.ascontiguousarray(position_m).view(np.complex128)[..., 0]
    first = _factors(neutral.shape[-1])[0]
    slope = np.fft.ifft(first * np.fft.fft(neutral))
    tangent = slope / np.abs(slope) if section_rad is None else np.exp(1j * section_rad)
    inward = 1j * tangent
    velocity, acceleration = angle_derivatives(neutral + sensor_offset_m * inward)
    # The axle moves towards -x: an angular acceleration adds -R domega/dt along x to every point of the belt.
    spin = velocity - radius_m
    return SensorWaveform(
        radial_m=(acceleration * inward.conj()).real,
        circumferential_m=(acceleration * tangent.conj()).real,
        gravity_radial=inward.imag.copy(),
        gravity_circumferential=tangent.imag.copy(),
        spin_radial_m=(spin * inward.conj()).real,
        spin_circumferential_m=(spin * tangent.conj()).real,
    )
