"""Every quantity that the estimators give, one declaration each.

Tables, schemas, units, frames, trends, the reference page and the rules of doubt are derived from it. It stands apart
from the estimators, since recordings, tables and `--help` need it without the numerical libraries. Signs follow ISO
8855: x forward, y to the left, z up; angles of the contact count from its centre, positive behind it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final

from gateway.core.constants import STANDARD_GRAVITY_MPS2, TIRE_DEGC
from gateway.core.quantity import Basis, BusFrame, OnBus, Quantity, Statement, Trend, Watch
from gateway.core.reasons import CoreCode

# Times of contacts need nothing else; a high-pass passes contact edges and what is not locked to the wheel.
_SIGNAL: Final = frozenset({Basis.SAMPLES})
_LOCKED: Final = frozenset({Basis.SAMPLES, Basis.WAVEFORM, Basis.COUPLING})
# A density over frequencies rests on the whole band.
_BAND: Final = frozenset({Basis.SAMPLES, Basis.COUPLING})
_SIGNED: Final = _LOCKED | {Basis.SIGN}
_SHAPE: Final = _LOCKED | {Basis.OFFSET, Basis.ZERO, Basis.HUB}
_FORCE: Final = _LOCKED | {Basis.HUB}
_BY_PRESSURE: Final = _LOCKED | {Basis.PRESSURE}
# What no tire, sensor, wheel or road has, from karts to earthmovers and aircraft, on a hard road.
_SHARE: Final = (0.0, 1.0)
_LOADS_N: Final = (0.0, 5e5)
_FORCES_N: Final = (-5e5, 5e5)
_MOMENTS_NM: Final = (-3e5, 3e5)
_LOSSES: Final = (0.0, 0.2)
_SLOPES: Final = (-0.6, 0.6)
_ACCELERATIONS: Final = (0.0, 1e5)
_AUDIBLE_HZ: Final = (0.0, 1e5)
# Memories of the running averages of the radial and of the lateral axis.
_AVERAGE: Final = 50
_LATERAL_AVERAGE: Final = 100
_FORCE_AVERAGE: Final = 16
_LONG_AVERAGE: Final = 500
# A lateral slope dy/dx with y = a / Omega^2 and x = R theta.
_SLOPE: Final = {Basis.RADIUS: -1.0, Basis.RATE: -2.0, Basis.GAIN: -1.0, Basis.AXES: 1.0}
_LATERAL_SHIFT: Final = {Basis.RATE: -2.0, Basis.GAIN: -1.0, Basis.AXES: 1.0}
# Both are what a steady value of R Omega^2 leaves.
_STEADY_VALUE: Final = {Basis.RADIUS: 1.0, Basis.RATE: 2.0}
# Accelerometers keep their sensitivity within a few percent and their zero within some g over temperature and shocks;
# self-calibration takes ten times as much for another fault.
_GAINS: Final = (0.5, 1.5)
LARGEST_ZERO_MPS2: Final = 6.0 * STANDARD_GRAVITY_MPS2
"""Zero-g offset that no sensor exceeds."""
_ZEROS: Final = (-LARGEST_ZERO_MPS2, LARGEST_ZERO_MPS2)
# A sensor glued by hand is within some degrees.
_TILTS: Final = (-0.35, 0.35)
_TO_THE_LEFT: Final = "to the left"
# A drift of either shows in the steady value alone where the speed is always the same.
_SCALE: Final = frozenset({Basis.GAIN, Basis.ZERO})
_BY_RADIUS: Final = frozenset({Statement.RADIUS})
_BY_RADIUS_AND_LOAD: Final = frozenset({Statement.RADIUS, Statement.LOAD})
MOTION_FRAME: Final = BusFrame(0, "Motion")
"""CAN frame that also says whether the wheel rolls."""
_CONTACT_FRAME: Final = BusFrame(1, "Contact")
_BELT_FRAME: Final = BusFrame(3, "Belt")
_RING_FRAME: Final = BusFrame(4, "Ring")
_TIRE_FRAME: Final = BusFrame(5, "Tire")
NEW_TIRE_MM: Final = 0.3
"""Wear by which a new tire has less than the one before, at least."""


def _ring_number(
    name: str, description: str, possible: tuple[float, float], bus: OnBus, *, is_over_pressure: bool = True
) -> Quantity:
    return Quantity(
        name,
        description,
        "balance of the rolling ring, scaled by Q / (p0 R^2)",
        powers={Basis.RADIUS: -2.0, Basis.LOAD: 1.0, Basis.PRESSURE: -1.0},
        rests_on=_SHAPE | {Basis.PRESSURE},
        possible=possible,
        is_steady=True,
        memory_revolutions=_AVERAGE,
        bus=bus,
        # 5 % of EI are 0.25 mm of a ring of 15 mm.
        watch=Watch(
            number=name,
            unit="%",
            notable=5.0,
            trend=Trend.STIFFNESS,
            is_logarithm=True,
            # EI falls with the cube of the thickness.
            falls_with_wear=name == "Bs",
            is_over_pressure=is_over_pressure,
            is_drawn=True,
            shifted_by=_BY_RADIUS_AND_LOAD,
        ),
    )


_NUMBERS: Final = (
    _ring_number("Bs", "bending stiffness number EI / (R^4 p0)", (0.0, 0.1), OnBus(_BELT_FRAME, "Bs", 1e-6, 1e-5)),
    _ring_number(
        "Cw", "contact width number b / R", (0.05, 0.45), OnBus(_BELT_FRAME, "Cw", 1e-5, 1e-4), is_over_pressure=False
    ),
    _ring_number("Rs", "radial sidewall stiffness number kw / p0", (0.2, 30.0), OnBus(_RING_FRAME, "Rs", 1e-3, 1e-2)),
    _ring_number(
        "Ts", "tangential sidewall stiffness number kv / p0", (0.05, 30.0), OnBus(_RING_FRAME, "Ts", 1e-3, 1e-2)
    ),
)
RING_NUMBERS: Final = tuple(quantity.name for quantity in _NUMBERS)
"""Dimensionless numbers of the ring: bending stiffness, contact width, radial and tangential stiffness."""
_RATIOS: Final = tuple(
    Quantity(
        f"{name}/Cw",
        "ratio of the numbers, which needs neither load nor pressure",
        "balance of the rolling ring",
        rests_on=_SHAPE,
        possible=possible,
        is_steady=True,
        memory_revolutions=_AVERAGE,
    )
    for name, possible in zip(
        (name for name in RING_NUMBERS if name != "Cw"), ((0.0, 0.5), (1.0, 200.0), (0.5, 200.0)), strict=True
    )
)
RING_RATIOS: Final = tuple(quantity.name for quantity in _RATIOS)
"""Their ratios to Cw, which neither load nor pressure is needed for."""
_RING: Final = (*_NUMBERS, *_RATIOS)


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


CATALOGUE: Final[dict[str, tuple[Quantity, ...]]] = {
    "kinematic": (
        Quantity(
            "speed_mps",
            "rolling speed",
            "R Omega",
            powers={Basis.RADIUS: 1.0, Basis.RATE: 1.0},
            possible=(0.0, 150.0),
            is_in_state=True,
            entity="speed",
            bus=OnBus(MOTION_FRAME, "Speed", 0.01, 0.01),
        ),
        Quantity(
            "angular_speed_radps",
            "angular speed",
            "2 pi over the time between two contact centres",
            powers={Basis.RATE: 1.0},
            possible=(0.0, 700.0),
            live_label="",
        ),
        Quantity(
            "rotation_rpm",
            "revolutions per minute",
            "60 s over the time between two contact centres",
            powers={Basis.RATE: 1.0},
            possible=(0.0, 7000.0),
            is_in_state=True,
        ),
        Quantity(
            "leading_edge_rad",
            "angle of the leading contact edge, negative",
            "end of contact pressure, from the steepest slope of the radial axis",
            "behind the contact centre",
            rests_on=_SIGNAL,
            possible=(-1.4, 0.0),
            bus=OnBus(_CONTACT_FRAME, "LeadingEdge", 1e-4, is_signed=True),
        ),
        Quantity(
            "trailing_edge_rad",
            "angle of the trailing contact edge",
            "end of contact pressure, from the steepest slope of the radial axis",
            "behind the contact centre",
            rests_on=_SIGNAL,
            possible=(0.0, 1.4),
            bus=OnBus(_CONTACT_FRAME, "TrailingEdge", 1e-4, is_signed=True),
        ),
        Quantity(
            "contact_length_m",
            "contact length",
            "R (trailing - leading edge), along the belt",
            powers={Basis.RADIUS: 1.0},
            rests_on=_SIGNAL,
            possible=(0.0, 1.5),
            label="contact length",
            bus=OnBus(_CONTACT_FRAME, "ContactLength", 1e-5),
            # Where no load is calibrated, it shows a load that is not as stated.
            watch=Watch(
                number="contact_length",
                unit="mm",
                factor=1e3,
                notable=5.0,
                shifted_by=_BY_RADIUS,
                explains=frozenset({Basis.LOAD}),
                level=CoreCode.TREND_CONTACT_CHANGED,
            ),
            live_label="contact",
        ),
        # Grows with load over pressure, and is right where radius and rate are stated wrongly.
        Quantity(
            "contact_fraction",
            "fraction of the circumference in contact",
            "(trailing - leading edge) / (2 pi)",
            rests_on=_SIGNAL,
            possible=(0.0, 0.4),
            label="contact fraction",
            is_in_state=True,
            entity="contact fraction",
            bus=OnBus(BusFrame(7, "ContactFraction"), "ContactFraction", 1e-5, 1e-4),
            # 5 mm of 2 m.
            watch=Watch(number="contact_fraction", unit="%", factor=100.0, notable=0.25),
        ),
    ),
    "distance": (
        Quantity(
            "distance_m",
            "distance rolled since the first revolution",
            "2 pi R a turn",
            powers={Basis.RADIUS: 1.0},
            possible=(0.0, 1e9),
            shown_unit=("m", 1.0),
            is_in_state=True,
        ),
    ),
    "self-calibration": (
        Quantity(
            "gain",
            "gain of the radial axis, 1 reads true",
            "mean(s) = G R Omega^2 (1 - e/R mean(k^2)) + z; order 1 = G g",
            powers=_STEADY_VALUE,
            rests_on=_LOCKED,
            possible=_GAINS,
            is_steady=True,
            # As much as 40 K change it by a data sheet's 0.05 % per K.
            watch=Watch(
                number="gain",
                unit="%",
                factor=100.0,
                notable=2.0,
                trend=Trend.SENSOR,
                shifted_by=_BY_RADIUS,
                explains=_SCALE,
                drift=(CoreCode.TREND_SENSOR_GAIN, "share"),
            ),
        ),
        Quantity(
            "zero_g_offset_mps2",
            "zero-g offset of the radial axis",
            "z of mean(s) = G R Omega^2 (1 - e/R mean(k^2)) + z, from several speeds",
            "toward the wheel centre",
            powers=_STEADY_VALUE,
            rests_on=_LOCKED,
            possible=_ZEROS,
            is_steady=True,
            label="zero-g offset",
            # Half of what a data sheet allows.
            watch=Watch(
                number="zero",
                unit="m/s²",
                notable=5.0,
                trend=Trend.SENSOR,
                shifted_by=_BY_RADIUS,
                explains=_SCALE,
                drift=(CoreCode.TREND_SENSOR_ZERO, "change_mps2"),
            ),
        ),
        Quantity(
            "gain_per_degc",
            "temperature coefficient of the gain, 1/K",
            "G' of mean(s) = (G + G' dT) R Omega^2 + z, where the temperature changes",
            "gain grows with warmth",
            rests_on=_LOCKED,
            possible=(-0.02, 0.02),
            label="gain with temperature",
        ),
        Quantity(
            "roll_tilt_rad",
            "tilt of the sensor about the circumferential axis",
            "ratio of the means of lateral and radial axis, over several speeds",
            "lateral axis reads a positive part of the radial one",
            powers={Basis.AXES: 1.0},
            rests_on=_LOCKED,
            possible=_TILTS,
            is_steady=True,
        ),
        Quantity(
            "pitch_tilt_rad",
            "tilt of the sensor about the lateral axis",
            "part of the radial axis in the circumferential one",
            "circumferential axis reads a positive part of the radial one",
            powers={Basis.ALONG: 1.0},
            rests_on=_LOCKED,
            possible=_TILTS,
            is_steady=True,
        ),
        Quantity(
            "sensor_offset_m",
            "distance of the sensor below the neutral layer of the belt",
            "circumferential axis = -e Omega^2 d(kappa R)/dtheta",
            "toward the wheel centre",
            powers={Basis.GAIN: -1.0, Basis.RATE: -2.0, Basis.ALONG: 1.0},
            rests_on=_LOCKED,
            possible=(-0.02, 0.08),
            is_steady=True,
        ),
    ),
    "weak-form": _RING,
    "ring-modal": _RING,
    "ring-paper": _RING,
    "forward": (
        *_RING,
        Quantity(
            "half_angle_rad",
            "contact half angle of the fitted ring",
            "exact rolling ring, fitted to the average",
            rests_on=_SHAPE,
            possible=(0.0, 1.4),
        ),
        Quantity(
            "edge_wave_before",
            "amplitude of the wave packet before the contact over R Omega^2",
            "hypot(a, b) of (a cos(n d) + b sin(n d)) exp(-d / decay)",
            rests_on=_LOCKED,
            possible=_SHARE,
        ),
        Quantity(
            "edge_wave_after",
            "amplitude of the wave packet after the contact over R Omega^2",
            "hypot(a, b) of (a cos(n d) + b sin(n d)) exp(-d / decay)",
            rests_on=_LOCKED,
            possible=_SHARE,
        ),
    ),
    "wear": (
        # A tread does not grow.
        Quantity(
            "wear_mm",
            "loss of ring thickness since the reference",
            "h0 (1 - (Bs p0 / (Bs_new p0_new))^(1/3))",
            rests_on=_BY_PRESSURE,
            possible=(0.0, 60.0),
            is_steady=True,
            label="wear",
            is_in_state=True,
            entity="tread wear",
            bus=OnBus(_TIRE_FRAME, "Wear", 1e-3, 0.02, is_signed=True),
            watch=Watch(
                number="wear",
                unit="mm",
                notable=NEW_TIRE_MM,
                trend=Trend.APART,
                is_drawn=True,
                shifted_by=_BY_RADIUS_AND_LOAD | {Statement.THICKNESS, Statement.REFERENCE},
                follows=frozenset(),
            ),
            scatter_memory_revolutions=_AVERAGE,
        ),
        Quantity(
            "wear_number",
            "wear over R",
            "wear / R (ring paper, Eq. 30)",
            rests_on=_BY_PRESSURE,
            possible=(0.0, 0.2),
            is_steady=True,
            scatter_memory_revolutions=_AVERAGE,
            live_label="",
        ),
        Quantity(
            "wear_drift_mm",
            "change of the wear since its first valid value",
            "line through independent values",
            "loss of thickness",
            rests_on=_BY_PRESSURE,
            possible=(-60.0, 60.0),
            live_label="",
        ),
    ),
    "load": (
        # By the width: Q0 Cw_new / Cw.
        Quantity(
            "load_n",
            "estimated vertical load, by contact angle or belt width",
            "the one with the better status, then the smaller error",
            powers={Basis.RADIUS: 2.0},
            rests_on=_BY_PRESSURE,
            possible=_LOADS_N,
            label="load",
            is_stated_too=True,
            is_in_state=True,
            entity="load",
            bus=OnBus(_TIRE_FRAME, "EstimatedLoad", 1.0, 10.0),
            # 5 % of the load of a car's wheel.
            watch=Watch(
                number="load",
                unit="N",
                notable=200.0,
                trend=Trend.APART,
                is_drawn=True,
                shifted_by=_BY_RADIUS | {Statement.CALIBRATION},
                follows=frozenset(),
                explains=frozenset({Basis.LOAD}),
            ),
            scatter_memory_revolutions=_AVERAGE,
        ),
        Quantity(
            "load_by_angle_n",
            "vertical load from contact angle and pressure",
            "Q0 (theta / theta0)^a (p / p0)^b (EI / EI0)^beta, calibrated",
            rests_on=_BY_PRESSURE,
            possible=_LOADS_N,
        ),
        Quantity(
            "load_by_width_n",
            "vertical load from Cw of the new tire",
            "Q0 Cw_new / Cw, any assumed Q0",
            powers={Basis.RADIUS: 2.0, Basis.PRESSURE: 1.0},
            rests_on=_BY_PRESSURE,
            possible=_LOADS_N,
            scatter_memory_revolutions=_AVERAGE,
        ),
        Quantity(
            "pressure_number",
            "Q / (2 p0 theta R^2)",
            "ring paper, Eq. 33",
            powers={Basis.RADIUS: -2.0, Basis.LOAD: 1.0, Basis.PRESSURE: -1.0},
            rests_on=_BY_PRESSURE,
            possible=(0.05, 1.2),
        ),
    ),
    "longitudinal-force": (
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
    ),
    "ply-steer": (
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
            rests_on=_LOCKED,
            possible=_TILTS,
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
            possible=_ZEROS,
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
    ),
    "slip-angle": (
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
            rests_on=_LOCKED,
        ),
        _slope(
            "slip_angle_mean_rad",
            "slip angle of the mean of the latest revolutions, with a slip calibration",
            "the same of the mean slope",
            "pulls the tire to the left",
            rests_on=_LOCKED,
            scatter_memory=_LONG_AVERAGE,
        ),
    ),
    "side-force": (
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
            rests_on=_BY_PRESSURE,
            possible=_FORCES_N,
            scatter_memory_revolutions=_FORCE_AVERAGE,
        ),
        Quantity(
            "aligning_moment_nm",
            "moment of the road about the vertical axis, positive turns the tire to the left",
            "factor (yaw - zero), calibrated",
            "about z, turns the tire to the left",
            powers=_LATERAL_SHIFT,
            rests_on=_BY_PRESSURE,
            possible=_MOMENTS_NM,
            scatter_memory_revolutions=_FORCE_AVERAGE,
        ),
    ),
    "friction": (
        Quantity(
            "friction_used",
            "horizontal force of the road over the vertical one",
            "hypot(Fx, Fy) / Q",
            rests_on=_BY_PRESSURE,
            possible=(0.0, 2.0),
        ),
        Quantity(
            "sliding_share",
            "share of the contact in which the tread slides, by the brush model",
            "brush model at the ratio of the pneumatic trail to that at no slip",
            rests_on=_BY_PRESSURE,
            possible=(0.0, 1.0),
        ),
    ),
    "asynchronous": (
        Quantity(
            "asynchronous_rms_mps2",
            "root mean square of what is not locked to the wheel, 5 to 800 Hz",
            "root of the spectrum's integral",
            powers={Basis.GAIN: -1.0},
            rests_on=_SIGNAL,
            possible=_ACCELERATIONS,
        ),
        Quantity(
            "asynchronous_line_hz",
            "frequency of the strongest line",
            "peak of the spectrum above its background",
            powers={Basis.RATE: 1.0},
            rests_on=_SIGNAL,
            possible=_AUDIBLE_HZ,
        ),
        Quantity(
            "asynchronous_line_rms_mps2",
            "root mean square of the strongest line",
            "root of the line's integral",
            powers={Basis.GAIN: -1.0},
            rests_on=_SIGNAL,
            possible=_ACCELERATIONS,
        ),
    ),
    "cavity": (
        Quantity(
            "cavity_hz",
            "resonance frequency of the tire cavity",
            "c / L",
            powers={Basis.RATE: 1.0},
            rests_on=_SIGNAL,
            possible=(20.0, 1000.0),
        ),
        # The square of the speed of sound is proportional to the absolute temperature, and to gamma / M.
        Quantity(
            "cavity_temperature_degc",
            "temperature of the gas in the tire, if it is air",
            "(f L)^2 M / (gamma R)",
            "above 0 °C",
            powers={Basis.RATE: 2.0},
            rests_on=_SIGNAL,
            possible=TIRE_DEGC,
            origin=-273.15,
        ),
        Quantity(
            "cavity_gas_ratio",
            "gamma / M of the gas over that of air, at the measured temperature",
            "(f L)^2 / (R T) over gamma / M of air",
            powers={Basis.RATE: 2.0},
            rests_on=_SIGNAL,
            possible=(0.1, 20.0),
        ),
    ),
    "road": (
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
    ),
}
"""Quantities of each estimator of this package, in the order of their columns."""

_OF_PLUGINS: Final[dict[str, tuple[Quantity, ...]]] = {}
_BY_NAME: Final = {quantity.name: quantity for quantities in CATALOGUE.values() for quantity in quantities}


# Suffix of a name -> unit. Longer suffixes first: `_mps2` must not be read as `_mps`.
_UNITS: Final = {
    "_per_degc": "1/K", "_radps2": "rad/s^2", "_radps": "rad/s", "_mps2": "m/s^2", "_mps": "m/s", "_rpm": "1/min",
    "_degc": "degC", "_rad": "rad", "_npm": "N/m", "_nm": "N m", "_bytes": "B", "_pa": "Pa", "_mm": "mm", "_m3": "m^3",
    "_hz": "Hz", "_ns": "ns", "_n": "N", "_m": "m", "_s": "s", "_v": "V",
}  # fmt: skip


@lru_cache(maxsize=1024)
def unit_of(name: str) -> str:
    """Return the unit in the name of a quantity as ASCII text, `m/s^2`; empty for a pure number."""
    return next((unit for suffix, unit in _UNITS.items() if name.endswith(suffix) and len(name) > len(suffix)), "")


def declare(estimator: str, quantities: Sequence[Quantity]) -> tuple[str, str] | None:
    """Take the quantities of a plug-in's estimator, unless one of their names is taken.

    CAN frames and trends are the same with and without plug-ins: these parts of a declaration are dropped.

    Returns:
        The first name that is taken and the estimator that has it; None when all are taken over.
    """
    for owner, theirs in (*CATALOGUE.items(), *_OF_PLUGINS.items()):
        taken = {name for quantity in theirs for name in (quantity.name, quantity.column)}
        for quantity in quantities if owner != estimator else ():
            if quantity.name in taken:
                return quantity.name, owner
    _OF_PLUGINS[estimator] = tuple(replace(quantity, bus=None, watch=None, compared="") for quantity in quantities)
    _BY_NAME.update({quantity.name: quantity for quantity in _OF_PLUGINS[estimator]})
    quantity_of.cache_clear()
    return None


def quantities_of(estimator: str) -> tuple[Quantity, ...]:
    """Return the quantities of an estimator; none where it is not known."""
    return CATALOGUE.get(estimator) or _OF_PLUGINS.get(estimator, ())


def given_by(estimators: Iterable[str]) -> dict[str, Quantity]:
    """Return the quantities of estimators by the names of their estimates in one result, in order.

    A name that an earlier estimator uses has the prefix of the later one: `ring-paper:Bs`.
    """
    given: dict[str, Quantity] = {}
    for estimator in estimators:
        given |= {
            f"{estimator}:{quantity.name}" if quantity.name in given else quantity.name: quantity
            for quantity in quantities_of(estimator)
        }
    return given


def declared() -> tuple[Quantity, ...]:
    """Return every quantity once, in the order of the estimators."""
    return tuple(_BY_NAME.values())


def in_state() -> list[str]:
    """Return the names of the quantities in the state of a wheel."""
    return [quantity.name for quantity in declared() if quantity.is_in_state]


def on_bus() -> dict[BusFrame, list[tuple[Quantity, OnBus]]]:
    """Return the quantities of each CAN frame with their signals, in the order of these."""
    frames: dict[BusFrame, list[tuple[Quantity, OnBus]]] = {}
    for quantity in declared():
        if quantity.bus is not None:
            frames.setdefault(quantity.bus.frame, []).append((quantity, quantity.bus))
    return frames


@lru_cache(maxsize=1024)
def quantity_of(name: str) -> Quantity:
    """Return what is declared of an estimate by its name, with or without the prefix of its estimator.

    An estimate that is not declared rests on the whole signal.
    """
    quantity = _BY_NAME.get(name)
    if quantity is not None:
        return quantity
    plain = name.rpartition(":")[2]
    return _BY_NAME.get(plain) or Quantity(plain, plain, rests_on=_LOCKED)


def rests_on_times_alone(estimator: str) -> bool:
    """Return whether all that an estimator gives follows from the times of contacts, whatever the waveform."""
    quantities = quantities_of(estimator)
    return bool(quantities) and not any(Basis.SAMPLES in quantity.rests_on for quantity in quantities)
