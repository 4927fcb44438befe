"""Quantities of forces, ply steer, slip, noise, cavity and road."""

from dataclasses import replace
from typing import Final

from gateway.core.constants import TIRE_DEGC
from gateway.core.quantity import (
    ON_SAMPLES,
    ON_WAVEFORM,
    ON_WAVEFORM_AND_PRESSURE,
    TILTS_RAD,
    ZEROS_MPS2,
    Basis,
    BusFrame,
    OnBus,
    Quantity,
)

# A density over frequencies rests on the whole band.
_BAND: Final = frozenset({Basis.SAMPLES, Basis.COUPLING})
_SIGNED: Final = ON_WAVEFORM | {Basis.SIGN}
_FORCE: Final = ON_WAVEFORM | {Basis.HUB}
# What no tire, sensor, wheel or road has, from karts to earthmovers and aircraft, on a hard road.
_FORCES_N: Final = (-5e5, 5e5)
_MOMENTS_NM: Final = (-3e5, 3e5)
_LOSSES: Final = (0.0, 0.2)
_SLOPES: Final = (-0.6, 0.6)
_ACCELERATIONS: Final = (0.0, 1e5)
_AUDIBLE_HZ: Final = (0.0, 1e5)
_LATERAL_AVERAGE: Final = 100
_FORCE_AVERAGE: Final = 16
_LONG_AVERAGE: Final = 500
# A lateral slope dy/dx with y = a / Omega^2 and x = R theta.
_SLOPE: Final = {Basis.RADIUS: -1.0, Basis.RATE: -2.0, Basis.GAIN: -1.0, Basis.AXES: 1.0}
_LATERAL_SHIFT: Final = {Basis.RATE: -2.0, Basis.GAIN: -1.0, Basis.AXES: 1.0}
# A rate with a = 2 V rate and V = R Omega.
_TURN: Final = {Basis.RADIUS: -1.0, Basis.RATE: -1.0, Basis.GAIN: -1.0, Basis.AXES: 1.0}
_TO_THE_LEFT: Final = "to the left"


def _slope(
    name: str,
    description: str,
    equation: str,
    sign: str = _TO_THE_LEFT,
    memory: int = 0,
    compared: str = "",
    rests_on: frozenset[Basis] = _SIGNED,
    scatter_memory: int = 0,
) -> Quantity:
    return Quantity(
        name,
        description,
        equation,
        sign,
        powers=_SLOPE,
        rests_on=rests_on,
        possible=_SLOPES,
        memory_revolutions=memory,
        scatter_memory_revolutions=scatter_memory,
        compared=compared,
    )


def _ply_steer(
    name: str,
    description: str,
    equation: str,
    sign: str = _TO_THE_LEFT,
    compared: str = "",
    live_label: str | None = None,
) -> Quantity:
    slope = _slope(name, description, equation, sign, _LATERAL_AVERAGE, compared)
    return replace(slope, live_label=live_label)


LONGITUDINAL_FORCE: Final = (
    Quantity(
        "longitudinal_force_n",
        "force of the road on the tire, positive forward",
        "F of the asymmetric balance of the free belt",
        "forward",
        rests_on=_FORCE,
        possible=_FORCES_N,
        scatter_memory_revolutions=_FORCE_AVERAGE,
    ),
    Quantity(
        "axle_torque_nm",
        "torque at the axle, positive when it drives",
        "M of the asymmetric balance of the free belt",
        "drives the vehicle forward",
        rests_on=_FORCE,
        possible=_MOMENTS_NM,
        scatter_memory_revolutions=_FORCE_AVERAGE,
    ),
    Quantity(
        "longitudinal_ratio",
        "longitudinal force over load",
        "F / Q",
        "forward",
        rests_on=_FORCE,
        possible=(-2.0, 2.0),
        scatter_memory_revolutions=_FORCE_AVERAGE,
    ),
    Quantity(
        "rolling_resistance",
        "coefficient of rolling resistance",
        "(M / R - F) / Q",
        rests_on=_FORCE,
        possible=_LOSSES,
        scatter_memory_revolutions=_LONG_AVERAGE,
    ),
    Quantity(
        "damping_loss",
        "part of the rolling resistance that the deformation of belt and sidewall loses",
        "work of the dampings in a turn / (2 pi R Q)",
        "energy lost",
        rests_on=_FORCE,
        possible=_LOSSES,
        scatter_memory_revolutions=_LONG_AVERAGE,
    ),
)

PLY_STEER: Final = (
    _ply_steer(
        "ply_steer_peak_rad",
        "steepest slope of the lateral shape of the belt in the contact",
        "extremum of dy/dx, y = -a_n / (n Omega)^2 by orders (ply steer paper, Eq. 8 and 21)",
        live_label="ply steer",
    ),
    _ply_steer(
        "ply_steer_first_half_rad",
        "mean slope from the leading edge to the middle of the contact",
        "(y(0) - y(leading edge)) / length",
        live_label="ply steer",
    ),
    _ply_steer(
        "ply_steer_adhesion_line_rad",
        "slope of a line through the part of the contact that adheres",
        "least squares, where the slope around the peak keeps its sign",
        live_label="ply steer",
    ),
    _ply_steer(
        "ply_steer_contact_line_rad",
        "slope of a line through the whole contact",
        "least squares from edge to edge",
        compared="ply_steer",
        live_label="ply steer",
    ),
    _ply_steer(
        "conicity_slope_rad",
        "half the change of slope from the first to the second half of the contact",
        "(second - first half) / 2, less the part of ply steer",
        "slope grows to the left toward the trailing edge",
        live_label="conicity",
    ),
    Quantity(
        "sensor_roll_rad",
        "roll of the sensor, from the means of two axes",
        "mean of the lateral over mean of the radial axis",
        "lateral axis reads a positive part of the radial one",
        powers={Basis.AXES: 1.0},
        rests_on=ON_WAVEFORM,
        possible=TILTS_RAD,
        is_steady=True,
        live_label="",
    ),
    _ply_steer(
        "ply_steer_ahead_rad",
        "steepest slope of the free belt ahead of the contact, which leans the other way",
        "extremum of -dy/dx within 0.8 rad of the leading edge",
        "leans against ply steer",
    ),
    Quantity(
        "lateral_offset_mps2",
        "constant in the mean of the lateral axis: zero-g offset and camber",
        "mean of the lateral axis without its part of R Omega^2",
        _TO_THE_LEFT,
        powers={Basis.GAIN: -1.0, Basis.AXES: 1.0},
        rests_on=_SIGNED,
        possible=ZEROS_MPS2,
    ),
    # Of the stated plies alone.
    Quantity(
        "ply_steer_laminate_rad",
        "slope of a belt of the stated plies that is bent flat, 2 phi_z of Eq. 18",
        "B16 / (A66 R), ply steer paper, Eq. 18",
        _TO_THE_LEFT,
        powers={Basis.RADIUS: -1.0},
        possible=_SLOPES,
    ),
    Quantity(
        "laminate_b16_n", "B16 of the stated plies", "ply steer paper, Eq. 10", "as ply steer", possible=(-1e7, 1e7)
    ),
    Quantity("laminate_a66_npm", "A66 of the stated plies", "ply steer paper, Eq. 10", possible=(0.0, 1e10)),
)

_TURNING_FRAME: Final = BusFrame(9, "Turning")
TURNING: Final = (
    Quantity(
        "turn_rate_radps",
        "yaw rate of the wheel, by its path and by steering",
        "lateral axis = -2 V turn cos(theta) + V turn, beyond what straights and side force make",
        "turns to the left",
        powers=_TURN,
        rests_on=_SIGNED,
        possible=(-6.0, 6.0),
        live_label="turn rate",
        is_in_state=True,
        bus=OnBus(_TURNING_FRAME, "TurnRate", 2e-4, 1e-3, is_signed=True),
    ),
    Quantity(
        "curve_radius_m",
        "radius of the wheel's path",
        "V / turn",
        "center of the curve to the left",
        powers={Basis.RADIUS: 2.0, Basis.RATE: 2.0, Basis.GAIN: 1.0, Basis.AXES: -1.0},
        rests_on=_SIGNED,
        possible=(-1e5, 1e5),
        live_label="curve radius",
        shown_unit=("m", 1.0),
        is_in_state=True,
        bus=OnBus(BusFrame(10, "Curve"), "CurveRadius", 0.1, 2.0, is_signed=True),
    ),
    Quantity(
        "camber_rate_radps",
        "rate of camber of the wheel",
        "lateral axis = -2 V rate sin(theta), beyond what straights make",
        "left side rises",
        powers=_TURN,
        rests_on=_SIGNED,
        possible=(-6.0, 6.0),
        live_label="",
    ),
    Quantity(
        "lateral_acceleration_mps2",
        "lateral acceleration of the wheel's path",
        "V turn",
        _TO_THE_LEFT,
        powers={Basis.GAIN: -1.0, Basis.AXES: 1.0},
        rests_on=_SIGNED,
        possible=(-100.0, 100.0),
        live_label="",
        bus=OnBus(_TURNING_FRAME, "LateralAcceleration", 2e-3, 2e-2, is_signed=True),
    ),
)

GRADE: Final = (
    Quantity(
        "road_grade_rad",
        "grade of the road under the wheel",
        "(first order of the circumferential axis - dV/dt) / g, beyond what is constant in the tire",
        "uphill in the direction of rolling",
        powers={Basis.GAIN: -1.0, Basis.ALONG: 1.0},
        rests_on=_FORCE,
        possible=(-0.6, 0.6),
        live_label="road grade",
    ),
)

SLIP_ANGLE: Final = (
    _slope(
        "slip_apparent_rad",
        "first-half slope of this revolution less that at zero slip",
        "(y(0) - y(leading edge)) / length - zero",
    ),
    Quantity(
        "slip_direction",
        "direction of slip, -1, 0 or 1",
        "sign of the apparent slip beyond three errors",
        "pulls the tire to the left",
        powers=_SLOPE,
        rests_on=_SIGNED,
        possible=(-1.0, 1.0),
        is_of_axle=True,
    ),
    Quantity(
        "lateral_asymmetry",
        "(max + min) / (max - min) of the lateral waveform",
        "(max + min) / (max - min)",
        _TO_THE_LEFT,
        powers={Basis.AXES: 1.0},
        rests_on=_SIGNED,
        possible=(-1.0, 1.0),
    ),
    Quantity(
        "left_right_asymmetry",
        "sum of the means of the asymmetry at left and right slip",
        "mean at left slip + mean at right slip",
        _TO_THE_LEFT,
        powers={Basis.AXES: 1.0},
        rests_on=_SIGNED,
        possible=(-2.0, 2.0),
    ),
    _slope(
        "slip_angle_rad",
        "slip angle, with a slip calibration",
        "alpha of slope = zero + share alpha (1 - saturation |alpha|)",
        "pulls the tire to the left",
        compared="slip",
        rests_on=ON_WAVEFORM,
    ),
    _slope(
        "slip_angle_mean_rad",
        "slip angle of the mean of the latest revolutions, with a slip calibration",
        "the same of the mean slope",
        "pulls the tire to the left",
        rests_on=ON_WAVEFORM,
        scatter_memory=_LONG_AVERAGE,
    ),
)

SIDE_FORCE: Final = (
    Quantity(
        "belt_shift_m",
        "mean lateral displacement of the belt against the wheel, positive to the left",
        "y0 of y - t D2 y + b D4 y = 0 in the free belt, D = d/dtheta",
        _TO_THE_LEFT,
        powers=_LATERAL_SHIFT,
        rests_on=_SIGNED,
        possible=(-0.1, 0.1),
        scatter_memory_revolutions=_FORCE_AVERAGE,
    ),
    Quantity(
        "belt_yaw_rad",
        "yaw of the belt against the wheel",
        "order 1 of y - t D2 y + b D4 y = 0 in the free belt, D = d/dtheta",
        "rear of the belt to the left",
        powers=_SLOPE,
        rests_on=_SIGNED,
        possible=_SLOPES,
        scatter_memory_revolutions=_FORCE_AVERAGE,
    ),
    Quantity(
        "side_force_n",
        "lateral force of the road on the tire, positive to the left",
        "factor (shift - zero), calibrated",
        _TO_THE_LEFT,
        powers=_LATERAL_SHIFT,
        rests_on=ON_WAVEFORM_AND_PRESSURE,
        possible=_FORCES_N,
        scatter_memory_revolutions=_FORCE_AVERAGE,
    ),
    Quantity(
        "aligning_moment_nm",
        "moment of the road about the vertical axis, positive turns the tire to the left",
        "factor (yaw - zero), calibrated",
        "about z, turns the tire to the left",
        powers=_LATERAL_SHIFT,
        rests_on=ON_WAVEFORM_AND_PRESSURE,
        possible=_MOMENTS_NM,
        scatter_memory_revolutions=_FORCE_AVERAGE,
    ),
)

FRICTION: Final = (
    Quantity(
        "friction_used",
        "horizontal force of the road over the vertical one",
        "hypot(Fx, Fy) / Q",
        powers={Basis.AXES: 1.0},  # at most, where all of it is side force
        rests_on=ON_WAVEFORM_AND_PRESSURE,
        possible=(0.0, 2.0),
    ),
    Quantity(
        "sliding_share",
        "share of the contact in which the tread slides, by the brush model",
        "brush model at the ratio of the pneumatic trail to that at no slip",
        rests_on=ON_WAVEFORM_AND_PRESSURE,
        possible=(0.0, 1.0),
    ),
)

ASYNCHRONOUS: Final = (
    Quantity(
        "asynchronous_rms_mps2",
        "root mean square of what is not locked to the wheel, 5 to 800 Hz",
        "root of the spectrum's integral",
        powers={Basis.GAIN: -1.0},
        rests_on=ON_SAMPLES,
        possible=_ACCELERATIONS,
    ),
    Quantity(
        "asynchronous_line_hz",
        "frequency of the strongest line",
        "peak of the spectrum above its background",
        powers={Basis.RATE: 1.0},
        rests_on=ON_SAMPLES,
        possible=_AUDIBLE_HZ,
    ),
    Quantity(
        "asynchronous_line_rms_mps2",
        "root mean square of the strongest line",
        "root of the line's integral",
        powers={Basis.GAIN: -1.0},
        rests_on=ON_SAMPLES,
        possible=_ACCELERATIONS,
    ),
)

CAVITY: Final = (
    Quantity(
        "cavity_hz",
        "resonance frequency of the tire cavity",
        "c / L",
        powers={Basis.RATE: 1.0},
        rests_on=ON_SAMPLES,
        possible=(20.0, 1000.0),
    ),
    # The square of the speed of sound is proportional to the absolute temperature, and to gamma / M.
    Quantity(
        "cavity_temperature_degc",
        "temperature of the gas in the tire, if it is air",
        "(f L)^2 M / (gamma R)",
        "above 0 °C",
        powers={Basis.RATE: 2.0},
        rests_on=ON_SAMPLES,
        possible=TIRE_DEGC,
        origin=-273.15,
    ),
    Quantity(
        "cavity_gas_ratio",
        "gamma / M of the gas over that of air, at the measured temperature",
        "(f L)^2 / (R T) over gamma / M of air",
        powers={Basis.RATE: 2.0},
        rests_on=ON_SAMPLES,
        possible=(0.1, 20.0),
    ),
)

ROAD: Final = (
    Quantity(
        "road_class",
        "class of the road's roughness after ISO 8608, 1 in the middle of A, 8 in that of H",
        "1 + log4(G(n0) / 16e-6 m^3)",
        "rougher than the middle of the class before A",
        rests_on=_BAND,
        possible=(-1.0, 9.0),
    ),
    Quantity(
        "road_roughness_m3",
        "density of the road's height at 0.1 cycles per m",
        "G(n0) from the variance of ln(contact width), ISO 8608:2016",
        powers={Basis.RADIUS: 2.0},
        rests_on=_BAND,
        possible=(0.0, 0.1),
    ),
)
