"""Quantities of the fitted exact ring."""

from typing import Final

from gateway.core.quantity import ON_WAVEFORM, Quantity
from gateway.core.ring_quantities import ON_SHAPE, RING

_SHARE: Final = (0.0, 1.0)

FORWARD: Final = (
    *RING,
    Quantity(
        "half_angle_rad",
        "contact half angle of the fitted ring",
        "exact rolling ring, fitted to the average",
        rests_on=ON_SHAPE,
        possible=(0.0, 1.4),
    ),
    Quantity(
        "edge_wave_before",
        "amplitude of the wave packet before the contact over R Omega^2",
        "hypot(a, b) of (a cos(n d) + b sin(n d)) exp(-d / decay)",
        rests_on=ON_WAVEFORM,
        possible=_SHARE,
    ),
    Quantity(
        "edge_wave_after",
        "amplitude of the wave packet after the contact over R Omega^2",
        "hypot(a, b) of (a cos(n d) + b sin(n d)) exp(-d / decay)",
        rests_on=ON_WAVEFORM,
        possible=_SHARE,
    ),
)
