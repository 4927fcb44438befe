"""What an effect is: something physical that a starting model lacks, with parameters that have units and bounds.

Four kinds, by where they act. A `RingEffect` changes what the exact ring is solved for. A `SignalEffect` adds to what
the sensor reads, locked to the wheel's angle, and is applied in the order of its `stage`. A `SpectrumEffect` adds to
the density of what is not locked to the wheel. A `ScatterEffect` is how revolutions differ. All parameters are 0 where
the effect is absent.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Final, Protocol, runtime_checkable

import numpy as np

from gateway.closure.ring_options import RingOptions
from gateway.physics.rolling_ring.sensor_waveform import SensorWaveform
from gateway.types import FloatArray

CIRCUMFERENTIAL, LATERAL, RADIAL = range(3)
"""What they are called."""

FIELD_SIZE: Final = 512
"""Points of the angle grid theta = -pi + 2 pi k / FIELD_SIZE that the model works on."""
# A parameter whose prior is narrower than this share of its mean is known.
_KNOWN_TO: Final = 0.02


class StartModel(StrEnum):
    """Where a diagnosis starts.

    PAPER is the ring paper's series as printed (Eq. 27: no gravity, no mean). SERIES is the corrected linear series
    with gravity and speed drift. EXACT is the geometrically exact ring, inextensible, undamped, on a flat road, with
    gravity and speed drift; sensor and mounting as declared.
    """

    PAPER = "paper"
    SERIES = "series"
    EXACT = "exact"


class Stage(IntEnum):
    """Order in which signal effects are applied; each sees the signal that those before it have made.

    STRUCTURE: corrections of the series. BELT: specific force at the sensor's place, along the belt's own directions.
    MOUNTING: how the sensor sits. ELEMENT: gain, offset. ELECTRIC: what comes behind: filters, coupling, clipping.
    """

    STRUCTURE = 0
    BELT = 1
    MOUNTING = 2
    ELEMENT = 3
    ELECTRIC = 4


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of an effect.

    Attributes:
        name: with its unit where it has one: `offset_m`.
        unit: for display: `m`; empty for a pure number.
        low: smallest plausible value; a fit below disqualifies the effect.
        high: largest plausible value.
        prior_std: how far from 0 (or from `prior_mean`) it may lie before the data are seen, one standard deviation:
            wide, it only keeps a fit steady.
        step: a small change of it, for numeric derivatives and their tests.
        prior_mean: 0 for all but shapes: a corner frequency, an order.
        factor: display value = value * factor.
        display_unit: unit of the displayed value; `unit` when empty.
        inverse_display: (factor, unit) where the value is 1 / what engineers think in (0 where the effect is absent,
            as it must be): tables show factor / value in that unit, under the name without its leading `inverse`.
        varies: True where it may differ from recording to recording by what it stands for.
    """

    name: str
    unit: str
    low: float
    high: float
    prior_std: float
    step: float
    prior_mean: float = 0.0
    factor: float = 1.0
    display_unit: str = ""
    varies: bool = False
    inverse_display: tuple[float, str] | None = None

    @property
    def known(self) -> bool:
        """Whether physics says beforehand what it is: all that the data tell is whether the effect is there."""
        return self.prior_std <= _KNOWN_TO * abs(self.prior_mean)


@dataclass(frozen=True, slots=True)
class Conditions:
    """Under what a block of revolutions was recorded, as declared and measured.

    Attributes:
        omega_radps: root of the mean square of the angular speed.
        omega_dot_radps2: mean angular acceleration.
        radius_m: belt radius.
        load_n: vertical load; an assumed one where nobody stated it.
        pressure_pa: gauge pressure; likewise.
        temperature_degc: of the inner liner; the campaign's mean where nobody measured it.
        reference_degc: temperature that the campaign's gain is understood at (its mean).
        rate_hz: sampling rate.
        time_s: since the campaign's first revolution.
        reverse: the tire rolls the other way round.
        ac_coupled: the sensor does not pass the steady value.
    """

    omega_radps: float
    omega_dot_radps2: float
    radius_m: float
    load_n: float
    pressure_pa: float
    temperature_degc: float
    reference_degc: float
    rate_hz: float
    time_s: float
    reverse: bool = False
    ac_coupled: bool = False


@dataclass(frozen=True, slots=True)
class Here:
    """One block and what the model says of it so far.

    Attributes:
        conditions: of the block.
        theta_rad: (FIELD_SIZE,) material angle of the sensor, -pi + 2 pi k / FIELD_SIZE, 0 at the contact's centre as
            the model has it; enters the contact at negative theta.
        signal_mps2: (3, FIELD_SIZE) circumferential, lateral, radial (inward +) as the stages before have made it.
        shape: ring's waveform of the same grid: acceleration over omega^2, projections of gravity, reaction to spin.
        leading_edge_rad: of the model's contact, negative.
        trailing_edge_rad: positive.
    """

    conditions: Conditions
    theta_rad: FloatArray
    signal_mps2: FloatArray
    shape: SensorWaveform
    leading_edge_rad: float
    trailing_edge_rad: float


@runtime_checkable
class Described(Protocol):
    """What every effect says of itself; class attributes.

    Attributes:
        name: the field's term, lower case; the key in reports and files.
        summary: what it is, one sentence.
        equation: its contribution in plain text.
        parameters: in the order of the parameter vector.
        seen_by: what data can see it: axes, views, speeds, loads.
        confused_with: effects that look alike, and what tells them apart.
        already_in: starting models that contain it; it is no candidate there.
    """

    name: str
    summary: str
    equation: str
    parameters: tuple[Parameter, ...]
    seen_by: str
    confused_with: str
    already_in: frozenset[StartModel]


@runtime_checkable
class SignalEffect(Described, Protocol):
    """Adds to the signal, locked to the wheel's angle.

    Attributes:
        stage: when it is applied.
        axes: of CIRCUMFERENTIAL, LATERAL, RADIAL, those it acts on.
        linear: True when the contribution is in proportion to the parameters.
    """

    stage: Stage
    axes: tuple[int, ...]
    linear: bool

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return parameter vectors, not zero, from which a fit may begin; one for a linear effect (any size)."""
        ...

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return what it adds to `here.signal_mps2`, (3, FIELD_SIZE), m/s^2; zero at zero parameters."""
        ...

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return d contribution / d parameters, (P, 3, FIELD_SIZE), analytic."""
        ...


@runtime_checkable
class Scanned(Protocol):
    """What an effect may say besides: its misfit has many minima, so one start alone does not do.

    Attributes:
        scan: (place of a parameter, values to try) one after the other, from the best start so far.
    """

    scan: tuple[tuple[int, tuple[float, ...]], ...]


@runtime_checkable
class Form(Protocol):
    """What an effect may say besides: it is one form of something that takes one form only.

    Attributes:
        form_of: what, the same words in all its forms.
    """

    form_of: str


@runtime_checkable
class Checked(Protocol):
    """What an effect may say besides: which values do not go together or cannot be, though each is in its range."""

    def reason_against(self, parameters: FloatArray, std: FloatArray) -> str:
        """Return why these values (p,), with their standard errors, cannot be, in words; empty when they can."""
        ...


@runtime_checkable
class Approximate(Protocol):
    """What an effect may say besides: its equation leaves more of what it adds than others' do.

    Attributes:
        equation_share: share of what it adds that it leaves.
    """

    equation_share: float


@runtime_checkable
class RingEffect(Described, Protocol):
    """Changes what the exact ring is solved for; its derivative is taken through the solver."""

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return parameter vectors, not zero, from which a fit may begin."""
        ...

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the effect in; the same options at zero parameters."""
        ...


@runtime_checkable
class SpectrumEffect(Described, Protocol):
    """Adds to the power spectral density of what is left when the angle-locked mean is taken off.

    Attributes:
        axes: those it acts on.
    """

    axes: tuple[int, ...]

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return parameter vectors, not zero, from which a fit may begin."""
        ...

    def density(self, conditions: Conditions, frequency_hz: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return what it adds, (3, m), (m/s^2)^2 per Hz, one-sided."""
        ...

    def density_derivative(
        self, conditions: Conditions, frequency_hz: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """Return d density / d parameters, (P, 3, m), analytic."""
        ...


@runtime_checkable
class ScatterEffect(Described, Protocol):
    """Moves parts of the waveform, by another amount in each revolution; taken off before revolutions are averaged.

    Attributes:
        axes: those it acts on.
    """

    axes: tuple[int, ...]

    def windows(self, theta_rad: FloatArray, half_angle_rad: float) -> FloatArray:
        """Return how much of each of its movements is felt at angles, (terms, ...), 1 at most."""
        ...


Effect = SignalEffect | RingEffect | SpectrumEffect | ScatterEffect

NOWHERE: Final[frozenset[StartModel]] = frozenset()
CORRECTED: Final = frozenset({StartModel.SERIES, StartModel.EXACT})
EXACT_ONLY: Final = frozenset({StartModel.EXACT})


def bare(here: Here) -> FloatArray:
    """Return zeros to write a contribution into, (3, FIELD_SIZE)."""
    return np.zeros_like(here.signal_mps2)
