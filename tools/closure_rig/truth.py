"""True values of what a diagnosis estimates: the tire's numbers in each state, and the parameters of effects."""

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from closure_rig.bench import Run
from closure_rig.draw import Case
from closure_rig.record import SECONDS, scenario_of
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.diagnosis.effects.lateral_response import (
    BENDING_STIFFNESS_NM2,
    SIDEWALL_STIFFNESS_NPM2,
    TREAD_STIFFNESS_NPM2,
)
from gateway.simulator.disturbances import REFERENCE_MPS
from gateway.simulator.wheel_plan import WheelPlan, wheel_plans

# The closure's own belt has this extension stiffness, and so has the rig's without the effect.
_STIFF_N: Final = 2e10
_HUB_WIDTH_HZ: Final = 8.0
_PASSES: Final = 20


class State(NamedTuple):
    """A load and an inflation pressure."""

    load_n: float
    pressure_pa: float


def numbers_of(case: Case, *, rolling: bool = False) -> dict[State, dict[str, float]]:
    """Return the true numbers of every state of a case's runs, and the half angle of its contact.

    Args:
        case: the case.
        rolling: Bs of the bending stiffness that a belt without rotary inertia needs at the speeds of the state's runs,
            EI - rho I V^2, in place of EI.
    """
    results: dict[State, dict[str, float]] = {}
    for run in case.bench.runs:
        state = _state(run)
        if state in results:
            continue
        plan = _plan(case, run)
        numbers = plan.tire.numbers(state.pressure_pa)
        values = dict(numbers._asdict())
        if rolling:
            speeds_kmh = [other.speed_kmh for other in case.bench.runs if _state(other) == state]
            square = sum((speed / 3.6) ** 2 for speed in speeds_kmh) / len(speeds_kmh)
            ring = plan.tire.ring_at(state.pressure_pa)
            values["Bs"] *= 1.0 - ring.rotary_inertia_kgm * square / ring.bending_stiffness_nm2
        values |= {f"{name}/Cw": values[name] / values["Cw"] for name in ("Bs", "Rs", "Ts")}
        values["tread_stiffness_npm2"] = case.bench.tread_mpa * 1e6
        omega_radps = run.speed_kmh / 3.6 / plan.radius_m
        values["contact_half_angle_rad"] = _half_angle_rad(plan, state, omega_radps)
        results[state] = values
    return results


def _state(run: Run) -> State:
    return State(run.load_n, run.pressure_kpa * 1e3)


def _half_angle_rad(plan: WheelPlan, state: State, omega_radps: float) -> float:
    """Return half of the angle between the edges that the sensor meets, each at its own deflection with run-out."""
    leading_rad, trailing_rad = plan.table().edges_rad(*state, omega_radps)
    return 0.5 * (trailing_rad - leading_rad)


def parameters_of(case: Case) -> dict[str, dict[str, float]]:
    """Return the true parameters of a case's effects, by the catalogue's names; those without a sure one are absent.

    A number that has a value of its own in every state, or that depends on the sense of rotation, has none when the
    runs differ in it.
    """
    names = case.label["truth"]
    results: dict[str, dict[str, float]] = {}
    for name in names:
        values = _parameters(name, case)
        if values:
            results[name] = values
    return results


def _plan(case: Case, run: Any) -> WheelPlan:
    (plan,) = wheel_plans(scenario_of(case, run, 1, SECONDS))
    return plan


def _parameters(name: str, case: Case) -> dict[str, float]:
    tables: Mapping[str, Mapping[str, Any]] = case.tables
    sensor, tire, vibration = (tables.get(key, {}) for key in ("sensor", "tire", "vibration"))
    stated, wheel = tables.get("stated", {}), tables.get("wheel", {})
    bench = case.bench
    if name in _SIMPLE:
        table, key, parameter, factor = _SIMPLE[name]
        return {parameter: factor * float(tables[table][key])}
    if name == "mounting offset":
        return {"offset_m": 1e-3 * (sensor["offset_mm"] - bench.offset_mm)}
    if name == "gain":
        return {"error": 1e-2 * sensor["gain_error_percent"][2]}
    if name == "circumferential gain":
        return {"error": 1e-2 * sensor["gain_error_percent"][0]}
    if name == "gain-temperature drift":
        return {"drift_per_k": 1e-2 * sensor["gain_drift_percent_per_k"][2]}
    if name == "sensor nonlinearity":
        return dict(case.label["bend"])
    if name == "zero-g offset":
        axes = ("circumferential", "lateral", "radial")
        return {
            f"{axis}_mps2": g * STANDARD_GRAVITY_MPS2 for axis, g in zip(axes, sensor["zero_g_offset_g"], strict=True)
        }
    if name == "anti-alias filter":
        return {"inverse_corner_s": 1.0 / sensor["bandwidth_hz"]}
    if name == "mounting resonance":
        return {
            "inverse_resonance_s2": (2.0 * math.pi * tables["defect"]["loose_hz"]) ** -2,
            "radial_over_tangential": 1.0,
        }
    if name == "clipping":
        return {"inverse_limit_s2pm": 1.0 / (tables["defect"]["clip_g"] * STANDARD_GRAVITY_MPS2)}
    if name == "rolling radius":
        return {"error": bench.radius_mm / stated["radius_mm"] - 1.0}
    if name == "contact edge scatter":
        return {f"{side}_m": 1e-3 * tables["road"][f"{side}_jitter_mm"] for side in ("leading", "trailing")}
    if name == "road vibration":
        return {"rms_mps2": tables["road"]["rms_mps2"], "corner_hz": tables["road"]["bandwidth_hz"]}
    if name == "hub vibration":
        return {"rms_mps2": vibration["hub_rms_mps2"], "centre_hz": vibration["hub_hz"], "width_hz": _HUB_WIDTH_HZ}
    if name == "cavity resonance":
        centre, width = vibration["cavity_hz"], vibration["cavity_bandwidth_hz"]
        return {"rms_mps2": vibration["cavity_rms_mps2"], "centre_hz": centre, "width_hz": width}
    if name in ("ply steer", "conicity", "carcass compliance"):
        return _lateral(name, case, wheel)
    return _of_the_belt(name, case, tire, vibration)


def _lateral(name: str, case: Case, wheel: Mapping[str, Any]) -> dict[str, float]:
    belt = _plan(case, case.bench.runs[0]).tire.lateral
    backwards = case.bench.runs[0].reverse
    stiffness = {
        "bending_ln": math.log(belt.bending_stiffness_nm2 / BENDING_STIFFNESS_NM2),
        "sidewall_ln": math.log(belt.sidewall_stiffness_npm2 / SIDEWALL_STIFFNESS_NPM2),
        "tread_ln": math.log(belt.tread_stiffness_npm2 / TREAD_STIFFNESS_NPM2),
    }
    if name == "ply steer":
        return {"coupling_length_m": (-1.0 if backwards else 1.0) * belt.coupling_length_m, **stiffness}
    if name == "conicity":
        return {"cone_rad": belt.conicity_rad, **stiffness}
    return {"slip_angle_rad": math.radians(wheel["slip_angle_deg"]), **stiffness}


def _of_the_belt(name: str, case: Case, tire: Mapping[str, Any], vibration: Mapping[str, Any]) -> dict[str, float]:
    runs = case.bench.runs
    one_pressure = len({run.pressure_kpa for run in runs}) == 1
    forward = not any(run.reverse for run in runs)
    ring = _plan(case, runs[0]).tire.ring_at(runs[0].pressure_kpa * 1e3)
    if name == "structural damping" and one_pressure:
        return {"damping_time_s": ring.foundation_damping_nspm2 / ring.radial_stiffness_npm2}
    if name == "tread damping (shifted pressure)":
        return {"damping_time_s": ring.tread_damping_nspm2 / ring.tread_stiffness_npm2}
    if name == "bending damping":
        return {"damping_time_s": ring.bending_damping_nm2s / ring.bending_stiffness_nm2}
    # A driving torque is stated with the losses in it; they are the traction's only where there are none.
    if name == "contact asymmetry" and forward and not any("damping" in other for other in case.label["truth"]):
        return {"traction": tire["axle_torque_nm"] / (1e-3 * case.bench.radius_mm)}
    if name == "belt extension":
        return {"compliance_pn": 1.0 / ring.extension_stiffness_n - 1.0 / _STIFF_N}
    if name == "shear flexibility":
        return {"length_squared_m2": ring.bending_stiffness_nm2 / ring.shear_stiffness_n}
    if name == "drum curvature":
        return {"curvature_pm": 1e3 / tire["drum_radius_mm"]}
    if name == "run-out":
        return _wave(1e-3 * tire["runout_mm"], tire["runout_deg"])
    if name == "imbalance and hub motion":
        per = (1e-3 * case.bench.radius_mm / REFERENCE_MPS) ** 2
        return _wave(per * vibration["imbalance_mps2"], vibration["imbalance_deg"])
    if name == "torsional ripple" and forward:
        share, order = 1e-2 * vibration["ripple_percent"], vibration["ripple_order"]
        shares = _wave(share, math.degrees(_at_contact(share, math.radians(vibration["ripple_deg"]))))
        return {"cosine": shares["cosine_m"], "sine": shares["sine_m"], "order": order}
    if name == "tread pitch":
        return {"order": case.tables["tread_pitch"]["blocks"]}
    if name == "tire-locked edge waves":
        waves = case.tables["edge_waves"]
        return {"before_order": waves["order_before"], "after_order": waves["order_after"]}
    return {}


def _at_contact(share: float, phase_rad: float) -> float:
    """Return a ripple's phase at the contact's centre, which it moves, from that at angle 0 without ripple."""
    # The order times the angle without ripple at which the wheel's own angle is 0; the share is small.
    early = 0.0
    for _ in range(_PASSES):
        early = -share * math.sin(early + phase_rad)
    return phase_rad + early


def _wave(size: float, phase_deg: float) -> dict[str, float]:
    phase = math.radians(phase_deg)
    return {"cosine_m": size * math.cos(phase), "sine_m": -size * math.sin(phase)}


# Effect -> table, key, parameter, factor.
_SIMPLE: Final[Mapping[str, tuple[str, str, str, float]]] = {
    "roll tilt": ("sensor", "roll_deg", "roll_rad", math.radians(1.0)),
    "pitch tilt": ("sensor", "pitch_deg", "pitch_rad", math.radians(1.0)),
    "yaw tilt": ("sensor", "yaw_deg", "yaw_rad", math.radians(1.0)),
    "AC coupling": ("sensor", "highpass_hz", "corner_hz", 1.0),
    "sample clock error": ("hub", "clock_ppm", "share", 1e-6),
    "rotary inertia": ("tire", "rotary_inertia_kgm", "inertia_kgm", 1.0),
    "sidewall stiffening": ("tire", "sidewall_stiffening_pm", "growth_pm", 1.0),
    "camber": ("wheel", "camber_deg", "camber_rad", math.radians(1.0)),
}
