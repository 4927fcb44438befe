"""Every quantity that the estimators give, one declaration each; a feature declares those of its estimators.

Tables, schemas, units, frames, trends, the reference page and the rules of doubt are derived from it. It stands apart
from the estimators, since recordings, tables and `--help` need it without the numerical libraries. Signs follow ISO
8855: x forward, y to the left, z up; angles of the contact count from its centre, positive behind it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final

from gateway.core.feature import Registry, added, object_of
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
    Statement,
    Trend,
    Watch,
)
from gateway.core.reasons import CoreCode
from gateway.core.ring_quantities import BY_RADIUS_AND_LOAD, RING_AVERAGE

_LOADS_N: Final = (0.0, 5e5)
# Both are what a steady value of R Omega^2 leaves.
_STEADY_VALUE: Final = {Basis.RADIUS: 1.0, Basis.RATE: 2.0}
# Accelerometers keep their sensitivity within a few percent and their zero within some g over temperature and shocks;
# self-calibration takes ten times as much for another fault.
_GAINS: Final = (0.5, 1.5)
# A drift of either shows in the steady value alone where the speed is always the same.
_SCALE: Final = frozenset({Basis.GAIN, Basis.ZERO})
_BY_RADIUS: Final = frozenset({Statement.RADIUS})
MOTION_FRAME: Final = BusFrame(0, "Motion")
"""CAN frame that also says whether the wheel rolls."""
_CONTACT_FRAME: Final = BusFrame(1, "Contact")
_TIRE_FRAME: Final = BusFrame(5, "Tire")
NEW_TIRE_MM: Final = 0.3
"""Wear by which a new tire has less than the one before, at least."""

_OF_FEATURES: Final = added(Registry.QUANTITIES)


def _added_quantities(registry: Registry) -> dict[str, tuple[Quantity, ...]]:
    """Return the quantities of the estimators that features add to a registry."""
    return {name: object_of(_OF_FEATURES[name]) for name in added(registry)}


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
            plain="contact begins at",
            rests_on=ON_SAMPLES,
            possible=(-1.4, 0.0),
            bus=OnBus(_CONTACT_FRAME, "LeadingEdge", 1e-4, is_signed=True),
        ),
        Quantity(
            "trailing_edge_rad",
            "angle of the trailing contact edge",
            "end of contact pressure, from the steepest slope of the radial axis",
            "behind the contact centre",
            plain="contact ends at",
            rests_on=ON_SAMPLES,
            possible=(0.0, 1.4),
            bus=OnBus(_CONTACT_FRAME, "TrailingEdge", 1e-4, is_signed=True),
        ),
        Quantity(
            "contact_length_m",
            "contact length",
            "R (trailing - leading edge), along the belt",
            powers={Basis.RADIUS: 1.0},
            rests_on=ON_SAMPLES,
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
            rests_on=ON_SAMPLES,
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
            rests_on=ON_WAVEFORM,
            possible=_GAINS,
            is_steady=True,
            # As much as 30 K change it by a data sheet's 0.05 % per K.
            watch=Watch(
                number="gain",
                unit="%",
                factor=100.0,
                notable=1.5,
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
            rests_on=ON_WAVEFORM,
            possible=ZEROS_MPS2,
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
            rests_on=ON_WAVEFORM,
            possible=(-0.02, 0.02),
            label="gain with temperature",
        ),
        Quantity(
            "roll_tilt_rad",
            "tilt of the sensor about the circumferential axis",
            "ratio of the means of lateral and radial axis, over several speeds",
            "lateral axis reads a positive part of the radial one",
            powers={Basis.AXES: 1.0},
            rests_on=ON_WAVEFORM,
            possible=TILTS_RAD,
            is_steady=True,
        ),
        Quantity(
            "pitch_tilt_rad",
            "tilt of the sensor about the lateral axis",
            "part of the radial axis in the circumferential one",
            "circumferential axis reads a positive part of the radial one",
            powers={Basis.ALONG: 1.0},
            rests_on=ON_WAVEFORM,
            possible=TILTS_RAD,
            is_steady=True,
        ),
        Quantity(
            "sensor_offset_m",
            "distance of the sensor below the neutral layer of the belt",
            "circumferential axis = -e Omega^2 d(kappa R)/dtheta",
            "toward the wheel centre",
            powers={Basis.GAIN: -1.0, Basis.RATE: -2.0, Basis.ALONG: 1.0},
            rests_on=ON_WAVEFORM,
            possible=(-0.02, 0.08),
            is_steady=True,
        ),
    ),
    **_added_quantities(Registry.NUMBERS),
    "wear": (
        # A tread does not grow.
        Quantity(
            "wear_mm",
            "loss of ring thickness since the reference",
            "h0 (1 - (Bs p0 / (Bs_new p0_new))^(1/3))",
            rests_on=ON_WAVEFORM_AND_PRESSURE,
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
                shifted_by=BY_RADIUS_AND_LOAD | {Statement.THICKNESS, Statement.REFERENCE},
                follows=frozenset(),
            ),
            scatter_memory_revolutions=RING_AVERAGE,
        ),
        Quantity(
            "wear_number",
            "wear over R",
            "wear / R (ring paper, Eq. 30)",
            rests_on=ON_WAVEFORM_AND_PRESSURE,
            possible=(0.0, 0.2),
            is_steady=True,
            scatter_memory_revolutions=RING_AVERAGE,
            live_label="",
        ),
        Quantity(
            "wear_drift_mm",
            "change of the wear since its first valid value",
            "line through independent values",
            "loss of thickness",
            rests_on=ON_WAVEFORM_AND_PRESSURE,
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
            rests_on=ON_WAVEFORM_AND_PRESSURE,
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
            scatter_memory_revolutions=RING_AVERAGE,
        ),
        Quantity(
            "load_by_angle_n",
            "vertical load from contact angle and pressure",
            "Q0 (theta / theta0)^a (p / p0)^b (EI / EI0)^beta, calibrated",
            rests_on=ON_WAVEFORM_AND_PRESSURE,
            possible=_LOADS_N,
        ),
        Quantity(
            "load_by_width_n",
            "vertical load from Cw of the new tire",
            "Q0 Cw_new / Cw, any assumed Q0",
            powers={Basis.RADIUS: 2.0, Basis.PRESSURE: 1.0},
            rests_on=ON_WAVEFORM_AND_PRESSURE,
            possible=_LOADS_N,
            scatter_memory_revolutions=RING_AVERAGE,
        ),
        Quantity(
            "pressure_number",
            "Q / (2 p0 theta R^2)",
            "ring paper, Eq. 33",
            powers={Basis.RADIUS: -2.0, Basis.LOAD: 1.0, Basis.PRESSURE: -1.0},
            rests_on=ON_WAVEFORM_AND_PRESSURE,
            possible=(0.05, 1.2),
        ),
    ),
    **_added_quantities(Registry.ESTIMATORS),
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
    for owner, declared in (*CATALOGUE.items(), *_OF_PLUGINS.items()):
        names = {name for quantity in declared for name in (quantity.name, quantity.column)}
        for quantity in quantities if owner != estimator else ():
            if quantity.name in names:
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
    quantities: dict[str, Quantity] = {}
    for estimator in estimators:
        quantities |= {
            f"{estimator}:{quantity.name}" if quantity.name in quantities else quantity.name: quantity
            for quantity in quantities_of(estimator)
        }
    return quantities


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
    return _BY_NAME.get(plain) or Quantity(plain, plain, rests_on=ON_WAVEFORM)


def rests_on_times_alone(estimator: str) -> bool:
    """Return whether all that an estimator gives follows from the times of contacts, whatever the waveform."""
    quantities = quantities_of(estimator)
    return bool(quantities) and not any(Basis.SAMPLES in quantity.rests_on for quantity in quantities)
