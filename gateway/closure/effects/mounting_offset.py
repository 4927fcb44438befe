"""The sensor sits deeper below the belt's neutral layer than declared, or less deep."""

from __future__ import annotations

from dataclasses import replace

from gateway.closure.effects.base import NOWHERE, Conditions, Parameter, StartModel
from gateway.closure.ring_options import RingOptions
from gateway.types import FloatArray


class MountingOffset:
    """Distance of the sensor from the neutral layer, beyond the declared one."""

    name = "mounting offset"
    summary = "The sensor sits farther below the belt's neutral layer than declared (negative: less far)."
    equation = (
        "e = declared depth + offset: radial V^2 kappa (1 - e kappa), circumferential -(e / R) times the radial's slope"
    )
    # From the steel belts to a sensor on the liner 3 to 6 mm, in a housing up to 30 mm; declared wrongly or not at all.
    parameters: tuple[Parameter, ...] = (
        Parameter("offset_m", "m", -0.03, 0.04, 0.01, 1e-4, factor=1e3, display_unit="mm"),
    )
    seen_by = "circumferential axis, at any speed; radial axis alone only over several loads"
    confused_with = (
        "gain and rolling radius, on the radial axis at one load: the circumferential axis or more loads tell; "
        "shear flexibility, which adds to the circumferential axis only"
    )
    already_in: frozenset[StartModel] = NOWHERE

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return a sensor deeper and one less deep than declared."""
        return (0.004,), (-0.004,)

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the sensor moved; a sensor sits on one place under all conditions."""
        return replace(options, sensor_offset_m=options.sensor_offset_m + float(parameters[0]))


EFFECT = MountingOffset()
