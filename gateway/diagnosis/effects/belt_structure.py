"""Belt and sidewall structure: extension, shear flexibility, rotary inertia, stiffening of the sidewall."""

import math
from dataclasses import replace
from typing import Final

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import Confounder, GroupConditions, Parameter, RingEffect
from gateway.diagnosis.effects.ring_options import RingOptions


class BeltExtension(RingEffect):
    """Compliance 1 / EA on top of that of the baseline model, which is practically zero."""

    name = "belt extension"
    rank = 70
    summary = "The belt is extensible: it shortens where the contact reduces its tension."
    equation = "T = T_0 + EA strain; parameter 1 / EA, in 1/MN"
    source = "Hooke's law on the exact ring"
    # Steel belts have EA of 3 to 20 MN, 0.05 to 0.33 1/MN; a textile one 1 MN.
    parameters = (
        Parameter(
            "compliance_pn", "1/N", low=0.0, high=1e-6, prior_std=5e-7, step=1e-8, factor=1e6, display_unit="1/MN"
        ),
    )
    observed_in = "radial axis, orders 0 to 3, a fraction of a percent of them; circumferential axis likewise"
    confounders = (
        Confounder(("tangential sidewall number (Ts)",)),
        Confounder(("gain",), "it scales every order alike"),
        Confounder(("mounting offset",), "the circumferential axis", "0.6 to 0.7 without the circumferential axis"),
    )
    # A steel belt of 5 MN.
    start_values = ((2e-7,),)

    def options(self, options: RingOptions, parameters: FloatArray, conditions: GroupConditions) -> RingOptions:
        """Return the options with the compliance added.

        Raises:
            ValueError: a compliance so negative that the total is not positive.
        """
        compliance = float(parameters[0])
        if compliance == 0.0:
            return options
        total = 1.0 / options.extension_stiffness_n + compliance
        if not total > 0.0:
            raise ValueError(f"the belt's compliance must be positive, not {total:g} 1/N")
        return replace(options, extension_stiffness_n=1.0 / total)


class ShearFlexibility(RingEffect):
    """Square of the shear length, EI / GA: the belt's response is regular in it."""

    name = "shear flexibility"
    rank = 80
    summary = "The belt shears between its cords (a Timoshenko belt): sharper contact edges than bending allows."
    equation = "section's turn from the tangent = shear force / GA; parameter EI / GA, the shear length squared"
    source = "Timoshenko beam theory on the exact ring"
    # A belt of 20 to 30 cm^2 of rubber of 3 to 5 MPa has GA of 6 to 15 kN, and with EI of 2 to 10 N m^2 lengths of 10
    # to 40 mm, which is all of the layer sqrt(EI / T) at a contact edge; cords make it less. Shear never stiffens.
    # Below 1 mm the belt's own grid, and the grid of whatever made the data, look the same.
    parameters = (
        Parameter(
            "length_squared_m2",
            "m^2",
            low=1e-6,
            high=1.6e-3,
            prior_std=4e-4,
            step=5e-6,
            factor=1e6,
            display_unit="mm^2",
        ),
    )
    observed_in = (
        "radial axis, orders 20 and up at the contact edges; circumferential axis, which the section's turn tilts"
    )
    confounders = (
        Confounder(
            ("bending stiffness (Bs)", "tread stiffness"),
            "they absorb half of it on the radial axis; the circumferential axis separates them",
        ),
        Confounder(("sidewall stiffening",), "the circumferential axis", "0.6"),
    )
    # Shear lengths of 3 and of 10 mm.
    start_values = ((1e-5,), (1e-4,))

    def options(self, options: RingOptions, parameters: FloatArray, conditions: GroupConditions) -> RingOptions:
        """Return the options with the shear length.

        Raises:
            ValueError: a negative square.
        """
        square = options.shear_length_m**2 + float(parameters[0])
        if square < 0.0:
            raise ValueError(f"the square of the shear length must not be negative, not {square:g} m^2")
        return replace(options, shear_length_m=math.sqrt(square))


class RotaryInertia(RingEffect):
    """Bending stiffness EI - rho I V^2."""

    name = "rotary inertia"
    rank = 90
    summary = "Rotating the belt's sections at the contact edges takes a moment that softens the belt with speed."
    equation = "EI less rho I (R omega)^2"
    source = "Rayleigh beam theory on the exact ring"
    # rho A h^2 / 12 of a ring of 2 to 8 kg/m, 10 to 30 mm thick: 2e-5 to 6e-4 kg m.
    parameters = (
        Parameter(
            "inertia_kgm", "kg m", low=0.0, high=1e-3, prior_std=5e-4, step=1e-5, factor=1e6, display_unit="mg m"
        ),
    )
    observed_in = "radial axis, as bending stiffness that falls with speed: two speeds, the faster the better"
    confounders = (
        Confounder(("bending stiffness (Bs)", "tread stiffness"), "two speeds: at one speed they absorb all of it"),
        # These change with speed as well.
        Confounder(("anti-alias filter", "tread damping (shifted pressure)")),
    )
    # A ring of 3.5 kg/m, 20 mm thick.
    start_values = ((1.2e-4,),)
    option = "rotary_inertia_kgm"


class SidewallStiffening(RingEffect):
    """Relative growth of kw and kv per metre of deflection."""

    name = "sidewall stiffening"
    rank = 110
    summary = "The sidewall is nonlinear: its stiffness grows with its deflection (negative: falls)."
    equation = "kw and kv times (1 + growth |u|), u the deflection of each"
    source = "first-order expansion of the sidewall's stiffness on the exact ring"
    # 10 % either way over a deflection of 20 mm is 5 per metre; twice that bounds what is a sidewall.
    parameters = (Parameter("growth_pm", "1/m", low=-10.0, high=15.0, prior_std=6.0, step=0.1),)
    observed_in = "radial axis, orders 2 to 12, as omega^2; several loads with their own deflections"
    confounders = (
        Confounder(
            ("the four numbers (Bs, Cw, Rs, Ts) and the tread stiffness",),
            "several loads; at one load they absorb 97 % of it",
        ),
        Confounder(("drum curvature",), similarity="-0.7"),
        Confounder(("shear flexibility",), "the circumferential axis", "0.6"),
    )
    # 10 % at 20 mm, either way.
    start_values = ((5.0,), (-5.0,))
    option = "stiffening_pm"


EFFECTS: Final = (BeltExtension(), ShearFlexibility(), RotaryInertia(), SidewallStiffening())
