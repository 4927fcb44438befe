"""Spectrum of contact-edge jitter: pulses of the waveform's slope in each revolution."""

from __future__ import annotations

from typing import Final

import numpy as np

from gateway.closure.data.campaign_data import ORDERS, Group
from gateway.types import FloatArray

TERMS: Final = 9
# An edge moves its surroundings; the motion fades over this angle on either side.
_REACH_RAD: Final = 0.5
_POINTS: Final = 256


def edge_jitter_basis(group: Group, frequency_hz: FloatArray) -> FloatArray:
    """Return the spectral densities per covariance of the two edges' timing, (TERMS, 3, m), m/s^2 squared per Hz.

    A contact whose leading edge comes b rad late and whose trailing edge a rad late adds b s'(theta) near the one and
    a s'(theta) near the other. The timing a and b is stationary, and the alignment of each revolution correlates it
    from one to the next. The density is linear in E[b b], E[a a], E[b b+], E[a a+], E[b a], E[b a+], E[b a-],
    E[b a++], E[b a--] (+ next, - last contact), rad^2. Single terms may be negative, their sum is not.

    Args:
        group: its mean waveform and contact.
        frequency_hz: (m,).
    """
    counts = np.array([block.count for block in group.blocks], dtype=np.float64)
    orders = np.nan_to_num(np.tensordot(counts / counts.sum(), [block.orders_mps2 for block in group.blocks], axes=1))
    half = group.half_angle_rad
    theta = np.linspace(-half - _REACH_RAD, half + _REACH_RAD, _POINTS)
    step = float(theta[1] - theta[0])
    n = np.arange(ORDERS)
    # d/dtheta of Re sum (c - i s) exp(i n theta)
    slope = ((1j * n * orders) @ np.exp(1j * n[:, None] * theta)).real
    near = [np.clip(np.abs(theta - edge) / _REACH_RAD, 0.0, 1.0) for edge in (-half, half)]
    windows = [0.5 * (1.0 + np.cos(np.pi * away)) for away in near]
    omega = group.conditions.omega_radps
    turns = frequency_hz * (2.0 * np.pi / omega)
    transform = np.exp(-1j * turns[:, None] * theta) * (step / omega)
    leading, trailing = ((slope * window) @ transform.T for window in windows)
    scale = omega / np.pi  # one-sided, pulses a second
    lag = np.exp(2j * np.pi * turns)
    own = np.square(np.abs(leading)), np.square(np.abs(trailing))
    across = 2.0 * leading * np.conj(trailing)
    basis = np.stack(
        (
            *own,
            *(2.0 * power * lag.real for power in own),
            across.real,
            (across * lag).real,
            (across / lag).real,
            (across * lag**2).real,
            (across / lag**2).real,
        )
    )
    return scale * basis
