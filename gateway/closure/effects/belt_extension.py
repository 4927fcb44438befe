"""Belt extension: the belt stretches under the tension that inflation, speed and contact leave it."""

from __future__ import annotations

from dataclasses import replace

from gateway.closure.effects.base import NOWHERE, Conditions, Parameter
from gateway.closure.ring_options import RingOptions
from gateway.types import FloatArray


class BeltExtension:
    """Compliance 1 / EA on top of the starting model's, which is as good as none."""

    name = "belt extension"
    summary = "The belt is not inextensible: it shortens where the contact takes tension from it."
    equation = "T = T_0 + EA strain; parameter 1 / EA, in 1/MN"
    # Steel belts have EA of 3 to 20 MN, 0.05 to 0.33 1/MN; a textile one 1 MN.
    parameters = (
        Parameter(
            "compliance_pn", "1/N", low=0.0, high=1e-6, prior_std=5e-7, step=1e-8, factor=1e6, display_unit="1/MN"
        ),
    )
    seen_by = "radial axis, orders 0 to 3, a share of a percent of them; circumferential axis likewise"
    confused_with = (
        "tangential sidewall number Ts; gain (order 0); mounting offset, 0.6 to 0.7 alike without the circumferential "
        "axis"
    )
    already_in = NOWHERE
    needs_exact = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return a steel belt of 5 MN."""
        return ((2e-7,),)

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the compliance added.

        Raises:
            ValueError: a compliance so negative that nothing is left.
        """
        compliance = float(parameters[0])
        if compliance == 0.0:
            return options
        total = 1.0 / options.extension_stiffness_n + compliance
        if not total > 0.0:
            raise ValueError(f"the belt's compliance must be positive, not {total:g} 1/N")
        return replace(options, extension_stiffness_n=1.0 / total)


EFFECT = BeltExtension()
