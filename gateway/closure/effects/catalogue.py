"""The one list of effects. Adding one is adding a module, with `EFFECT = ...` in it, and a line here."""

from __future__ import annotations

import importlib
from functools import cache
from typing import Final

from gateway.closure.effects.base import Effect, StartModel

# Modules of gateway.closure.effects, in the order in which signal effects of the same stage are applied.
MODULES: Final[tuple[str, ...]] = (
    # what the ring is solved for
    "belt_kinematics",
    "pressure_shape",
    "tension_loss",
    "structural_damping",
    "tread_damping",
    "contact_asymmetry",
    "belt_extension",
    "shear_flexibility",
    "rotary_inertia",
    "drum_curvature",
    "sidewall_stiffening",
    "mounting_offset",
    "runout",
    # BELT
    "gravity",
    "speed_drift",
    "imbalance",
    "edge_waves",
    "standing_waves",
    "tread_pitch",
    "ply_steer",
    "conicity",
    "carcass_compliance",
    "rolling_radius",
    "clock_error",
    # this one acts on all that the belt does
    "torsional_ripple",
    # a constant that no ripple touches
    "camber",
    # MOUNTING
    "yaw_tilt",
    "roll_tilt",
    "pitch_tilt",
    # ELEMENT
    "gain",
    "gain_temperature",
    "sensor_nonlinearity",
    "zero_g_offset",
    # ELECTRIC
    "clipping",
    "anti_alias_filter",
    "ac_coupling",
    # not locked to the wheel
    "road_vibration",
    "hub_vibration",
    "cavity_resonance",
    # how revolutions differ
    "edge_scatter",
)


@cache
def catalogue() -> dict[str, Effect]:
    """Return every effect by name."""
    effects: list[Effect] = [importlib.import_module(f"gateway.closure.effects.{name}").EFFECT for name in MODULES]
    return {effect.name: effect for effect in effects}


def candidates(model: StartModel) -> dict[str, Effect]:
    """Return the effects that a starting model lacks and can take.

    Some ring effects act on the exact ring only: a series has no belt that they could act on.
    """
    return {
        name: effect
        for name, effect in catalogue().items()
        if model not in effect.already_in and (model is StartModel.EXACT or not getattr(effect, "needs_exact", False))
    }
