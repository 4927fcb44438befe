"""Nonuniformity of tire and wheel: run-out, imbalance and an error of the rolling radius."""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.belt_geometry import belt_inertia, gravity_projections, relative_offset
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    RADIAL,
    Confounder,
    GroupConditions,
    LinearSignalEffect,
    ModelledBlock,
    Parameter,
    RingEffect,
    SignalEffect,
    Stage,
)
from gateway.diagnosis.effects.ring_options import RingOptions

_MM: Final = 1e3
# New car tires: 0.5 mm first harmonic, 1 to 1.5 mm the usual limit; a bent rim or flat spot gives 3 mm.
_MAX_RUNOUT_M: Final = 3e-3
# Hub motion: 20 g at 0.2 m on 40 kg of unsprung mass is 0.1 mm; 150 g, and a wheel hop resonance near order 1, is 3 mm.
_MAX_HUB_MOTION_M: Final = 3e-3


def _harmonic(name: str, most_m: float, prior_std_m: float, step_m: float) -> Parameter:
    return Parameter(f"{name}_m", "m", -most_m, most_m, prior_std_m, step_m, factor=_MM, display_unit="mm")


class RunOut(RingEffect):
    """First harmonic of the tire's radius, fixed to the tire and so to the sensor."""

    name = "run-out"
    rank = 130
    summary = (
        "The tire's radius varies once a revolution: the sensor's own radius, and more load when the high spot comes."
    )
    equation = "s (1 + x / R), s that of the round tire with its axle lower by x cos(theta) + y sin(theta)"
    source = "exact rolling ring with a deflection that varies with the first harmonic: the axle keeps its height"
    parameters = (_harmonic("cosine", _MAX_RUNOUT_M, 1e-3, 1e-5), _harmonic("sine", _MAX_RUNOUT_M, 1e-3, 1e-5))
    observed_in = (
        "radial axis, the smooth shape away from the contact, against which the load on the contact varies; it is fixed"
        " to the sensor and never averages out"
    )
    confounders = (
        Confounder(
            ("gain", "rolling radius"),
            "a second sensor half a turn away, or the variation of the load at the axle; a fifth of the cosine part "
            "remains beside the ring's own numbers",
            "0.9",
        ),
        Confounder(("clipping",), "near its onset, a second sensor half a turn away, or the load at the axle"),
        Confounder(
            ("torsional ripple",), "a second sensor half a turn away, or the load at the axle", "0.7 at order 1"
        ),
    )
    # Nearly linear.
    start_values = ((3e-4, 3e-4),)

    def options(self, options: RingOptions, parameters: FloatArray, conditions: GroupConditions) -> RingOptions:
        """Return the options with the high spot; in reverse its sine part changes sign."""
        cosine, sine = (float(value) for value in parameters)
        return replace(options, runout_cosine_m=cosine, runout_sine_m=-sine if conditions.reverse else sine)


class Imbalance(SignalEffect):
    """Vertical acceleration of the hub, synchronous with the wheel.

    A free mass moves by the same distance at every speed. On its tire and suspension the hub moves by more the faster
    it turns, with omega^2 far below wheel hop and steeply near it, so the growth of the distance is a parameter.
    """

    name = "imbalance and hub motion"
    rank = 160
    summary = "The hub moves vertically once a revolution, and the whole wheel with it."
    equation = (
        "omega^2 (v / 65 km/h)^growth (x cos(theta) + y sin(theta)) felt like gravity: times cos(psi) radially, "
        "sin(psi) along"
    )
    source = "specific force of a frame that accelerates vertically"
    parameters = (
        _harmonic("cosine", _MAX_HUB_MOTION_M, 2e-3, 1e-6),
        _harmonic("sine", _MAX_HUB_MOTION_M, 2e-3, 1e-6),
        # 0 above wheel hop, 2 far below it; near it the distance rises by up to the fourth power and falls beyond.
        Parameter("growth", "", -2.0, 4.0, 0.7, 1e-4),
    )
    axes = (CIRCUMFERENTIAL, RADIAL)
    observed_in = (
        "orders 0 and 2 and the orders that the contact makes of them, radial and circumferential alike; grows with"
        " omega^2 or faster"
    )
    confounders = (
        Confounder(("torsional ripple",), "the circumferential axis", "0.9 at orders 1 and 2 on the radial axis"),
        Confounder(
            ("zero-g offset",),
            "two speeds",
            "0.9 on the radial axis, 0.7 with the circumferential axis, 0.55 with two speeds",
        ),
        Confounder(("gain",), "the circumferential axis", "0.8 on the radial axis, 0.6 with the circumferential axis"),
    )
    start_values = ((1e-4, 1e-4, 0.0),)
    stage = Stage.BELT

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the signal of the hub's motion."""
        change: FloatArray = np.tensordot(parameters[:2], self._waves(block, float(parameters[2])), 1)
        return change

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by both parts of the motion and by its growth."""
        rows = np.zeros((3, *block.signal_mps2.shape))
        rows[:2] = self._waves(block, float(parameters[2]))
        rows[2] = math.log(block.conditions.relative_speed) * np.tensordot(parameters[:2], rows[:2], 1)
        return rows

    @staticmethod
    def _waves(block: ModelledBlock, growth: float) -> FloatArray:
        """Return cos(theta) and sin(theta) of the projections for a metre, (2, 3, FIELD_SIZE).

        The heavy spot is fixed to the sensor. In reverse it is the mirror image: what came ahead comes behind.
        """
        conditions = block.conditions
        rows = np.stack([block.zeros()] * 2)
        acceleration = conditions.omega_radps**2 * conditions.relative_speed**growth * gravity_projections(block)
        waves = (np.cos(block.theta_rad), np.sin(block.theta_rad) * (-1.0 if conditions.reverse else 1.0))
        for row, wave in zip(rows, waves, strict=True):
            row[[CIRCUMFERENTIAL, RADIAL]] = wave * acceleration
        return rows


class RollingRadius(LinearSignalEffect):
    """Relative error of the stated belt radius: the ring's own accelerations grow with it, gravity does not.

    Nor does the contribution of the sensor's depth e below the neutral layer: R (k - (e/R) k^2) and -e dk/dtheta,
    k = R kappa.
    """

    name = "rolling radius"
    rank = 230
    summary = "The belt radius (rolling circumference / 2 pi) is larger than stated."
    equation = "adds error (a - gravity - contribution of the offset): R is (1 + error) times the stated one"
    source = "similarity of the ring at fixed numbers"
    # Wear 2 %, make and inflation 1 %, the next tire size 4 %.
    parameters = (Parameter("error", "", -0.1, 0.1, 0.03, 1e-4, factor=100.0, display_unit="%"),)
    axes = (CIRCUMFERENTIAL, RADIAL)
    observed_in = "radial axis, any speed: a closed belt's mean is R omega^2; needs a DC-coupled sensor or a contact"
    confounders = (
        Confounder(("sample clock error",), "a second clock or the stated speed; every waveform is the same"),
        Confounder(("gain",), "it scales gravity too (slow recordings) and leaves the circumferential axis unchanged"),
    )
    start_values = ((0.01,),)
    stage = Stage.BELT

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the ring's accelerations without the contribution of the sensor's depth."""
        row = belt_inertia(block)
        offset = relative_offset(block)
        if offset:
            radius, square = block.conditions.radius_m, block.conditions.omega_radps**2
            level = block.shape.radial_m / radius
            curvature = level + offset * np.square(level)
            row[RADIAL] += square * radius * offset * np.square(curvature)
            row[CIRCUMFERENTIAL] -= square * block.shape.circumferential_m
        return row[None]


ROLLING_RADIUS: Final = RollingRadius()
EFFECTS: Final = (RunOut(), Imbalance(), ROLLING_RADIUS)
