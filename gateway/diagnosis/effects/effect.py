"""Base classes of the effects: physical causes that a baseline model lacks, with parameters in units and ranges.

An effect is a class with declarative attributes and the equation in code. There are four kinds, by where they act:

- `RingEffect` changes the options that the ring is solved with.
- `SignalEffect` adds to the sensor signal, locked to the wheel angle.
- `SpectrumEffect` adds to the power spectral density of the part that is not locked to the wheel.
- `ScatterEffect` has another size in each revolution.

All parameters are 0 where the effect is absent, except those that only shape it (a corner frequency, an order).

To add an effect, touch two files:

1. Its module in `gateway/diagnosis/effects`. Choose the module by physics. Write a subclass of one of the four kinds,
   set every attribute that `Effect` lists without a default, write `contribution` and `derivative` (or `options`,
   `density` and `density_derivative`), and append an instance to the module's `EFFECTS`. A new module needs nothing
   else: the catalogue finds every module of the package that has `EFFECTS`.
2. Its test in `tests/diagnosis`. The contract (zero at zero parameters, analytic derivative, start values in range,
   known confounders, complete text) is tested for every effect of the catalogue without a further line. Test the
   equation against something independent of it, such as the simulator.

`rank` places the effect in the catalogue. Choose a free number beside the effects that it belongs with.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum, StrEnum
from typing import Any, Final, NamedTuple

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.ring.rolling_ring import LoadedBelt
from gateway.ring.rolling_ring.sensor_waveform import SensorWaveform

CIRCUMFERENTIAL, LATERAL, RADIAL = range(3)
"""Rows of a signal; `gateway.core.constants.AXIS_NAMES` has their names."""

FIELD_SIZE: Final = 512
"""Points of the angle grid theta = -pi + 2 pi k / FIELD_SIZE that the model works on."""

_REFERENCE_MPS: Final = 65.0 / 3.6
# A parameter whose prior standard deviation is below this share of its prior mean counts as known.
_KNOWN_PRIOR_SHARE: Final = 0.02


class BaselineModel(StrEnum):
    """Model that a diagnosis starts from, before any effect is added.

    PAPER is the ring paper's series as printed (Eq. 27: no gravity, no mean). EXACT is the geometrically exact ring,
    inextensible, undamped, on a flat road, with gravity and angular acceleration; sensor and mounting as declared.
    """

    PAPER = "paper"
    EXACT = "exact"


EXACT_ONLY: Final = frozenset({BaselineModel.EXACT})


class Stage(IntEnum):
    """Order in which signal effects are applied. Each sees the signal that the stages before it have made.

    STRUCTURE: corrections of the series. BELT: specific force at the sensor, in the belt's own directions. MOUNTING:
    orientation of the sensor. ELEMENT: gain and offset of the sensing element. ELECTRIC: the electronics behind it,
    such as filters, coupling and clipping.
    """

    STRUCTURE = 0
    BELT = 1
    MOUNTING = 2
    ELEMENT = 3
    ELECTRIC = 4


class InverseDisplay(NamedTuple):
    """Display of a parameter as the inverse of its root: factor / value^(1 / power).

    Attributes:
        factor: from SI to `unit`.
        unit: of the displayed value.
        power: 1 where the parameter is the inverse, 2 where it is the square of the inverse.
    """

    factor: float
    unit: str
    power: float = 1.0


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of an effect.

    Attributes:
        name: with its unit where it has one: `offset_m`.
        unit: SI unit; empty for a pure number.
        low: smallest plausible value; a fit below it disqualifies the effect.
        high: largest plausible value.
        prior_std: prior standard deviation about `prior_mean`. It is wide and only keeps a fit stable.
        step: a small change of the parameter, for numeric derivatives and their tests.
        prior_mean: 0 for all but shape parameters, such as a corner frequency or an order.
        factor: displayed value = value * factor.
        display_unit: unit of the displayed value; `unit` when empty.
        inverse_display: where the value is the inverse of the quantity that engineers use, so that 0 means absent.
            Tables show that quantity, under the name without its leading `inverse`.
        varies: True where the parameter may physically differ between recordings.
        shared_std: where effects share the parameter of this name, the standard deviation by which each may differ
            from it, as their equations are models. It is a part of the reported error. None where it is the effect's
            own.
        whole: True for a whole number. Start values and scans try its values; a fit keeps the one that it starts from.
        by_gain: True where the value is in proportion to the gain of an axis, which nothing else in the signal shows:
            the gain's standard error is a part of the reported one.
        equation_share: error of the value by the effect's equation, as a share of it, a part of the reported one.
        equation_std: the same where it does not go with the value.
        other_stds: further prior standard deviations, each as likely as `prior_std`, which is the widest: 0 for an
            amplitude that may be zero while others of the effect are not, a small one where some products are far
            better than others. They count in the evidence; a fit uses `prior_std`.
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
    whole: bool = False
    inverse_display: InverseDisplay | None = None
    shared_std: float | None = None
    by_gain: bool = False
    equation_share: float = 0.0
    equation_std: float = 0.0
    other_stds: tuple[float, ...] = ()

    @property
    def known(self) -> bool:
        """Whether physics fixes the value, so that the data only decide whether the effect is present."""
        return self.prior_std <= _KNOWN_PRIOR_SHARE * abs(self.prior_mean)


@dataclass(frozen=True, slots=True)
class Confounder:
    """Something whose signal resembles that of an effect.

    Attributes:
        names: keys of effects in the catalogue; or phrases for anything else, such as `bending stiffness (Bs)`.
        distinction: data that separate the two, or a property that only the confounder has; empty where none is known.
        similarity: cosine between the two waveforms where it was computed, as text: `0.98`, `0.6 to 0.7`.
    """

    names: tuple[str, ...]
    distinction: str = ""
    similarity: str = ""


@dataclass(frozen=True, slots=True)
class GroupConditions:
    """Conditions under which a block or group of revolutions was recorded, as declared and measured.

    Attributes:
        omega_radps: root mean square of the angular speed.
        omega_dot_radps2: mean angular acceleration.
        radius_m: belt radius.
        load_n: vertical load; an assumed one where none is stated.
        pressure_pa: gauge pressure; likewise.
        temperature_degc: of the inner liner; the campaign's mean where it was not measured.
        reference_degc: temperature that the campaign's gain refers to (its mean).
        rate_hz: sampling rate.
        time_s: since the campaign's first revolution.
        reverse: the tire rolls the other way round.
        ac_coupled: the sensor does not pass the steady value.
        offset_known: False where the sensor's distance from the neutral layer is neither stated nor measured.
        offset_measured: True where the recording's own samples measured that distance, and nothing states it.
        gain_std: relative standard error of the gain of the sensor's axes, as stated.
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
    offset_known: bool = True
    offset_measured: bool = False
    gain_std: float = 0.0

    @property
    def relative_speed(self) -> float:
        """Speed over 65 km/h, at which sizes that grow with it are stated."""
        return self.omega_radps * self.radius_m / _REFERENCE_MPS


@dataclass(frozen=True, slots=True)
class ModelledBlock:
    """One block of revolutions as the model has it so far.

    Attributes:
        conditions: of the block.
        theta_rad: (FIELD_SIZE,) material angle of the sensor, -pi + 2 pi k / FIELD_SIZE; 0 at the model's contact
            centre; the sensor enters the contact at negative theta.
        signal_mps2: (3, FIELD_SIZE) circumferential, lateral, radial (inward +) as the stages before have made it.
        shape: ring waveform on the same grid: acceleration over omega^2, projections of gravity, reaction to spin.
        leading_edge_rad: of the model's contact, negative.
        trailing_edge_rad: positive.
        belt: of the model, None for a series.
    """

    conditions: GroupConditions
    theta_rad: FloatArray
    signal_mps2: FloatArray
    shape: SensorWaveform
    leading_edge_rad: float
    trailing_edge_rad: float
    belt: LoadedBelt | None = None

    def zeros(self) -> FloatArray:
        """Return an empty contribution, (3, FIELD_SIZE)."""
        return np.zeros_like(self.signal_mps2)


class Effect(ABC):
    """One physical cause: its description, its parameters and the effects that it is confused with.

    Attributes:
        name: key in reports and files, lower case. It is a JSON value and does not change.
        title: term of the field for display; `name` where that is the term already.
        rank: place in the catalogue, unique. Signal effects of one stage are applied, and candidates are tried, in
            this order.
        summary: the physics in one sentence.
        equation: its contribution in plain text.
        source: where the equation comes from.
        parameters: in the order of the parameter vector.
        axes: of CIRCUMFERENTIAL, LATERAL, RADIAL, those it acts on.
        observed_in: data that show it: axes, orders, speeds, loads.
        confounders: what it is confused with, and the data that tell them apart.
        start_values: parameter vectors, not zero, from which a fit may begin.
        already_in: baseline models that contain it; it is no candidate there.
        needs_exact: True where it acts on the exact ring only; a series has no belt that it could act on.
        form_of: name of a phenomenon of which only one form can be present; empty for most effects.
        refinements: number of times that starts around the best one are tried, where good starts are narrow.
        scan: (index of a parameter, values to try), one after the other from the best start so far, for effects whose
            misfit has many minima.
    """

    name: str
    title: str = ""
    rank: int
    summary: str
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    axes: tuple[int, ...]
    observed_in: str
    confounders: tuple[Confounder, ...]
    start_values: tuple[tuple[float, ...], ...] = ()
    already_in: frozenset[BaselineModel] = frozenset()
    needs_exact: bool = False
    form_of: str = ""
    refinements: int = 0
    scan: tuple[tuple[int, tuple[float, ...]], ...] = ()

    def starts(self, conditions: Sequence[GroupConditions]) -> tuple[tuple[float, ...], ...]:
        """Return parameter vectors, not zero, from which a fit may begin under these conditions."""
        return self.start_values

    def expected(self, conditions: Sequence[GroupConditions]) -> bool:
        """Return whether the effect is to be expected: it is the error of something that is merely assumed."""
        return False

    def reach(self, start: Sequence[float]) -> tuple[float, ...] | None:
        """Return the changes from a start, (p,), within which a linear step holds; None where it always does."""
        return None

    def nearer(
        self, stage: int, start: Sequence[float], conditions: Sequence[GroupConditions]
    ) -> tuple[tuple[float, ...], ...]:
        """Return starts around the best one so far, from stage 0 on, for effects with `refinements`."""
        return ()

    def reason_against(self, parameters: FloatArray, std: FloatArray) -> Reason | None:
        """Return why these values (p,) with their standard errors are impossible; None when they are possible.

        Each value is in its range; this rejects combinations and ranges that depend on the standard error.
        """
        return None

    @property
    def display_title(self) -> str:
        """The term of the field for this effect."""
        return self.title or self.name


class SignalEffect(Effect):
    """Effect that adds to the sensor signal, locked to the wheel angle.

    Attributes:
        stage: stage at which it is applied.
        linear: True when the contribution is proportional to the parameters.
        sizes: number of its first parameters that make its size; the others shape it.
        scaling: growth with speed, load and pressure, in words, of an effect that may be proposed as a law.
        jumps: True where it jumps as the contact's edges pass nodes of the belt's grid: a step that improves a fit may
            then be far shorter than one that does not.
        needs_other_conditions: True where one recording cannot show it, since what others leave may look like it:
            recordings of other conditions must confirm it.
    """

    stage: Stage
    linear: bool = False
    sizes: int = 1
    scaling: str = ""
    jumps: bool = False
    needs_other_conditions: bool = False

    @abstractmethod
    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return what the effect adds to `block.signal_mps2`, (3, FIELD_SIZE), m/s^2; zero at zero parameters."""

    @abstractmethod
    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return d contribution / d parameters, (P, 3, FIELD_SIZE), analytic."""


class LinearSignalEffect(SignalEffect):
    """Signal effect whose contribution is its parameters times its derivative."""

    linear = True

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the rows of the derivative, each times its parameter."""
        rows = self.derivative(block, parameters)
        if len(rows) == 1:
            return np.asarray(float(parameters[0]) * rows[0])
        return np.asarray(np.tensordot(parameters, rows, 1))


class RingEffect(Effect):
    """Effect on the ring; its derivative is taken through the solver.

    Attributes:
        option: field of `RingOptions` that its only parameter adds to; empty where `options` is overridden.
    """

    axes: tuple[int, ...] = (CIRCUMFERENTIAL, RADIAL)
    needs_exact = True
    option: str = ""

    def options(self, options: RingOptions, parameters: FloatArray, conditions: GroupConditions) -> RingOptions:
        """Return the options with the effect; the same options at zero parameters."""
        changed: dict[str, Any] = {self.option: getattr(options, self.option) + float(parameters[0])}
        return replace(options, **changed)


class SpectrumEffect(Effect):
    """Effect on the power spectral density of what remains when the angle-locked mean is removed.

    Its first parameter is its size, whose square the density is in proportion to.
    """

    @abstractmethod
    def density(self, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the one-sided density that it adds, (3, m), (m/s^2)^2 per Hz."""

    @abstractmethod
    def density_derivative(
        self, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """Return d density / d parameters, (P, 3, m), analytic."""


class ScatterEffect(Effect):
    """Effect that has another size in each revolution.

    It is estimated from single revolutions and removed before revolutions are averaged. Its parameters are root mean
    squares over revolutions, which differ between recordings.
    """
