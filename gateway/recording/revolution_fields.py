"""Fields of a revolution's message: conditions, and the estimates of every estimator with their parts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

_SOLVED: Final = {
    "Bs": "bending stiffness number EI / (R^4 p0)",
    "Cw": "contact width number b / R",
    "Rs": "radial sidewall stiffness number kw / p0",
    "Ts": "tangential sidewall stiffness number kv / p0",
    "Bs_over_Cw": "ratio of the numbers, which needs neither load nor pressure",
    "Rs_over_Cw": "ratio of the numbers, which needs neither load nor pressure",
    "Ts_over_Cw": "ratio of the numbers, which needs neither load nor pressure",
}

QUANTITIES: Final[dict[str, dict[str, str]]] = {
    "kinematic": {
        "speed_mps": "rolling speed",
        "angular_speed_radps": "angular speed",
        "rotation_rpm": "revolutions per minute",
        "leading_edge_rad": "angle of the leading contact edge, negative",
        "trailing_edge_rad": "angle of the trailing contact edge",
        "contact_length_m": "contact length",
    },
    "distance": {"distance_m": "distance rolled since the first revolution"},
    "self-calibration": {
        "gain": "gain of the radial axis, 1 reads true",
        "zero_g_offset_mps2": "zero-g offset of the radial axis",
        "gain_per_degc": "temperature coefficient of the gain, 1/K",
        "roll_tilt_rad": "tilt of the sensor about the circumferential axis",
        "pitch_tilt_rad": "tilt of the sensor about the lateral axis",
        "sensor_offset_m": "distance of the sensor below the neutral layer of the belt",
    },
    "weak-form": _SOLVED,
    "ring-modal": _SOLVED,
    "ring-paper": _SOLVED,
    "forward": {
        **_SOLVED,
        "half_angle_rad": "contact half angle of the fitted ring",
        "edge_wave_before": "amplitude of the wave packet before the contact over R Omega^2",
        "edge_wave_after": "amplitude of the wave packet after the contact over R Omega^2",
    },
    "wear": {
        "wear_mm": "loss of ring thickness since the reference",
        "wear_number": "wear over R",
        "wear_drift_mm": "change of the wear since its first valid value",
    },
    "load": {
        "estimated_load_n": "estimated vertical load, the better of the next two",
        "load_by_angle_n": "vertical load from contact angle and pressure",
        "load_by_width_n": "vertical load from Cw of the new tire",
        "pressure_number": "Q / (2 p0 theta R^2)",
    },
    "longitudinal-force": {
        "longitudinal_force_n": "force of the road on the tire, positive forward",
        "axle_torque_nm": "torque at the axle, positive when it drives",
        "longitudinal_ratio": "longitudinal force over load",
        "rolling_resistance": "coefficient of rolling resistance",
        "damping_loss": "part of the rolling resistance that the deformation of belt and sidewall loses",
    },
    "ply-steer": {
        "ply_steer_peak_rad": "steepest slope of the lateral shape of the belt in the contact",
        "ply_steer_first_half_rad": "mean slope from the leading edge to the middle of the contact",
        "ply_steer_adhesion_line_rad": "slope of a line through the part of the contact that adheres",
        "ply_steer_contact_line_rad": "slope of a line through the whole contact",
        "conicity_slope_rad": "half the change of slope from the first to the second half of the contact",
        "sensor_roll_rad": "roll of the sensor, from the means of two axes",
        "lateral_offset_mps2": "constant in the mean of the lateral axis: zero-g offset and camber",
        "ply_steer_ahead_rad": "steepest slope of the free belt ahead of the contact, which leans the other way",
        "ply_steer_laminate_rad": "slope of a belt of the stated plies that is bent flat, 2 phi_z of Eq. 18",
        "laminate_b16_n": "B16 of the stated plies",
        "laminate_a66_npm": "A66 of the stated plies",
    },
    "slip-angle": {
        "slip_apparent_rad": "first-half slope of this revolution less that at zero slip",
        "slip_angle_rad": "slip angle, with a slip calibration",
        "slip_angle_mean_rad": "slip angle of the mean of the latest revolutions, with a slip calibration",
        "slip_direction": "direction of slip, -1, 0 or 1",
        "lateral_asymmetry": "(max + min) / (max - min) of the lateral waveform",
        "left_right_asymmetry": "sum of the means of the asymmetry at left and right slip",
    },
    "side-force": {
        "belt_shift_m": "mean lateral displacement of the belt against the wheel, positive to the left",
        "belt_yaw_rad": "yaw of the belt against the wheel",
        "side_force_n": "lateral force of the road on the tire, positive to the left",
        "aligning_moment_nm": "moment of the road about the vertical axis, positive turns the tire to the left",
    },
    "friction": {
        "friction_used": "horizontal force of the road over the vertical one",
        "sliding_share": "share of the contact in which the tread slides, by the brush model",
    },
    "asynchronous": {
        "asynchronous_rms_mps2": "root mean square of what is not locked to the wheel, 5 to 800 Hz",
        "asynchronous_line_hz": "frequency of the strongest line",
        "asynchronous_line_rms_mps2": "root mean square of the strongest line",
    },
    "cavity": {
        "cavity_hz": "resonance frequency of the tire cavity",
        "cavity_temperature_degc": "temperature of the gas in the tire, if it is air",
        "cavity_gas_ratio": "gamma / M of the gas over that of air, at the measured temperature",
    },
    "road": {
        "road_class": "class of the road's roughness after ISO 8608, 1 in the middle of A, 8 in that of H",
        "road_roughness_m3": "density of the road's height at 0.1 cycles per m",
    },
    "water-wedge": {
        "leading_edge_shift_rad": "shift of the leading edge into the contact, against the contacts before",
        "trailing_edge_shift_rad": "shift of the trailing edge into the contact, against the contacts before",
        "water_wedge_rad": "shift of the leading edge less that of the trailing edge",
    },
}
"""Description of each estimate of each estimator, as named in messages and tables, where `/` is `_over_`."""

CONDITIONS: Final = {
    "index": ("i", "running number of the wheel's revolutions"),
    "start_s": ("n", "hub time of the first contact centre"),
    "period_s": ("n", "duration of the revolution"),
    "omega_radps": ("n", "mean angular speed"),
    "omega_dot_radps2": ("n", "angular acceleration"),
    "noise_mps2": ("n", "noise of one sample in the angle domain"),
    "missing_fraction": ("n", "share of samples lost on the link"),
    "load_n": ("n", "stated vertical load"),
    "pressure_pa": ("n", "inflation pressure (gauge)"),
    "temperature_degc": ("n", "temperature of the inner liner"),
    "fault_reasons": ("[o]", "why the revolution is not averaged"),
}
"""Type, as in `gateway.recording.schemas`, and description of the fields that are no estimates."""

PARTS: Final = {
    "": ("n", ""),
    "_std": ("n", "standard error"),
    "_status": ("s", "validity"),
    "_reasons": ("[o]", "reasons"),
}
"""Parts of an estimate: suffix of the name, type and description."""


def estimate_descriptions() -> dict[str, str]:
    """Return the description of every estimate by its name.

    A name that an earlier estimator also uses is listed again with the prefix that it then has: `ring-paper:Bs`.
    """
    found: dict[str, str] = {}
    for estimator, names in QUANTITIES.items():
        for name, description in names.items():
            found[f"{estimator}:{name}" if name in found else name] = description
    return found


def fields() -> Iterator[tuple[str, str, str]]:
    """Yield name, type and description of every field of a revolution's message.

    Descriptions of the parts are short, since a recording contains the text twice.
    """
    for name, (kind, description) in CONDITIONS.items():
        yield name, kind, description
    for name, description in estimate_descriptions().items():
        for part, (kind, meaning) in PARTS.items():
            yield name + part, kind, meaning or description
