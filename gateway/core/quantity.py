"""How a quantity is declared: what it is, what it rests on, the values it can have, and where it is shown."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from math import inf
from typing import Final, NamedTuple

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.reasons import Code, CoreCode


class Basis(StrEnum):
    """What an estimate rests on."""

    # Statements that may be wrong: that an axis is the lateral one, or the one along the belt, and in time.
    AXES = "axes"
    ALONG = "along"
    COUPLING = "coupling"
    GAIN = "gain"
    HUB = "hub"
    LOAD = "load"
    OFFSET = "offset"
    RADIUS = "radius"
    RATE = "rate"
    SIGN = "sign"  # that the lateral axis points to the left
    ZERO = "zero"
    # Measurements.
    PRESSURE = "pressure"
    SAMPLES = "samples"  # more than the times of the contacts
    WAVEFORM = "waveform"  # what repeats with the wheel's angle, and so contains known effects


# Bases of several quantities.
ON_SAMPLES: Final = frozenset({Basis.SAMPLES})
"""Contact edges, and what is not locked to the wheel: a high-pass passes both."""
ON_WAVEFORM: Final = frozenset({Basis.SAMPLES, Basis.WAVEFORM, Basis.COUPLING})
"""What repeats with the angle of the wheel."""
ON_WAVEFORM_AND_PRESSURE: Final = ON_WAVEFORM | {Basis.PRESSURE}
LARGEST_ZERO_MPS2: Final = 6.0 * STANDARD_GRAVITY_MPS2
"""Zero-g offset that no sensor exceeds."""
ZEROS_MPS2: Final = (-LARGEST_ZERO_MPS2, LARGEST_ZERO_MPS2)
TILTS_RAD: Final = (-0.35, 0.35)
"""A sensor glued by hand is within some degrees."""


class Statement(StrEnum):
    """What the configuration states of a tire and trends follow."""

    LOAD = "load"
    RADIUS = "radius"
    THICKNESS = "thickness"
    REFERENCE = "reference"
    CALIBRATION = "calibration"


class BusFrame(NamedTuple):
    """CAN frame of a wheel: its identifier within the sixteen of the wheel, and its name behind that of the wheel.

    2 and 6 are the stated conditions and the alarms.
    """

    offset: int
    name: str


class OnBus(NamedTuple):
    """Signal of a quantity on a CAN bus: 16 bits, and 8 of its standard error.

    Attributes:
        frame: that it is in.
        signal: name in the DBC file.
        resolution: of one count, in the quantity's unit.
        std_resolution: of one count of the error; 0 without one.
        is_signed: whether it may be negative.
    """

    frame: BusFrame
    signal: str
    resolution: float
    std_resolution: float = 0.0
    is_signed: bool = False


class Trend(StrEnum):
    """How a trend is made of a series."""

    LINE = "line"  # over the months
    STIFFNESS = "stiffness"  # of the logarithm, with temperature
    SENSOR = "sensor"  # with a finding when the sensor drifts
    APART = "apart"  # by an analysis of its own


@dataclass(frozen=True, slots=True, kw_only=True)
class Watch:
    """How trends of a fleet follow a series of values over the recordings of a tire.

    Attributes:
        number: begin of the names of its numbers: `Bs` gives `Bs_rate`.
        unit: of the series.
        factor: value of the series over that of the quantity.
        notable: change from which it is a finding, in `unit`.
        trend: how it is made.
        is_logarithm: whether the series is the logarithm in percent.
        falls_with_wear: whether the wear of the tread lowers it as a bending stiffness.
        is_over_pressure: whether it is a stiffness over the pressure, so that its drift is that of the product.
        worse: sign of the changes that are faults; 0 for both.
        is_drawn: whether pages draw it.
        shifted_by: statements that shift its level.
        follows: what of the tire's operation changes it, pressure and load.
        explains: what its change is one of, so that changes of what rests on that, or follows it, are consequences.
        level: finding where its level changes.
        drift: finding where the sensor drifts, and its value that says by how much; None for what is of the tire.
    """

    number: str
    unit: str
    notable: float
    factor: float = 1.0
    trend: Trend = Trend.LINE
    is_logarithm: bool = False
    falls_with_wear: bool = False
    is_over_pressure: bool = False
    worse: float = 0.0
    is_drawn: bool = False
    shifted_by: frozenset[Statement] = frozenset()
    follows: frozenset[Basis] = frozenset({Basis.PRESSURE, Basis.LOAD})
    explains: frozenset[Basis] = frozenset()
    level: Code = CoreCode.TREND_LEVEL_CHANGED
    drift: tuple[Code, str] | None = None


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity that an estimator gives.

    Attributes:
        name: with its unit where it has one, as in `Estimate`.
        description: noun phrase, in one line.
        equation: that defines it, with its source where that is not this package.
        sign: what a positive value means, where it may be negative; axes of ISO 8855.
        powers: exponents in the ratios (true over stated) of belt radius, sampling rate, gain, load and pressure, and
            of the share of the true signal in its axis.
        rests_on: what else it needs; what changes it in a way that no power describes.
        possible: least and greatest value that a tire, a sensor or a road can have.
        origin: value at which what the powers scale is zero.
        is_steady: whether it is of the tire or the sensor, so that driving does not change it.
        memory_revolutions: of the running average that it is, and whose drift is behind; 0 for none.
        scatter_memory_revolutions: of another running average that its scatter comes from; 0 for none.
        label: name on screens; from `name` where it is empty.
        live_label: name where a wheel is watched live, `label` where it is None, not shown there where it is empty; of
            several with one name the estimate that comes first is shown.
        shown_unit: unit on screens, with its factor, where it is not the usual one of the unit in the name.
        is_in_state: whether the state of a wheel that live outputs publish has it.
        plain: name for people who know tires, where the label is a symbol or a term; empty where the label is plain.
        entity: name in Home Assistant and in the short text of a revolution; empty for neither.
        bus: its signal on a CAN bus; None for none.
        watch: how trends follow it; None where they do not.
        compared: begin of the name of the number that compares left and right wheels; empty where trends do not.
        is_of_axle: whether its sign is the same at both wheels of an axle at a time.
        is_stated_too: whether a condition of the same name is stated, so that tables call the estimate otherwise.
    """

    name: str
    description: str
    equation: str = ""
    sign: str = ""
    powers: Mapping[Basis, float] = field(default_factory=dict)
    rests_on: frozenset[Basis] = frozenset()
    possible: tuple[float, float] = (-inf, inf)
    origin: float = 0.0
    is_steady: bool = False
    memory_revolutions: int = 0
    scatter_memory_revolutions: int = 0
    label: str = ""
    live_label: str | None = None
    shown_unit: tuple[str, float] | None = None
    is_in_state: bool = False
    plain: str = ""
    entity: str = ""
    bus: OnBus | None = None
    watch: Watch | None = None
    compared: str = ""
    is_of_axle: bool = False
    is_stated_too: bool = False

    @property
    def column(self) -> str:
        """Name in tables that have the conditions too."""
        return f"estimated_{self.name}" if self.is_stated_too else self.name

    @property
    def correlated_revolutions(self) -> int:
        """Memory of the average that revolutions share the scatter of; 0 where each has its own."""
        return self.memory_revolutions or self.scatter_memory_revolutions

    @property
    def is_radius_times_angle(self) -> bool:
        """Whether it is the stated radius times something measured much better."""
        return self.powers.get(Basis.RADIUS) == 1.0 and Basis.COUPLING not in self.rests_on
