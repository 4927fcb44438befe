"""Result of a diagnosis: the closure before and after, with every figure that the report shows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from gateway.core.reasons import Reason
from gateway.core.revolutions.effect_correction import CorrectionTable
from gateway.core.shown_units import ShownUnits
from gateway.core.types import FloatArray
from gateway.diagnosis.data.campaign_data import Remark
from gateway.diagnosis.effects.effect import InverseDisplay


class Verdict(StrEnum):
    """The outcome for a candidate effect.

    NAMED: present with a probability of at least 0.99. INDISTINGUISHABLE: one of several is, but no single one;
    `Finding.rivals` holds the others and `Finding.decide_with` the recording that would decide. REFUSED: below 0.99, or
    only at implausible values, or not needed by the exact ring; `Finding.reason` holds which.
    """

    NAMED = "named"
    INDISTINGUISHABLE = "indistinguishable"
    REFUSED = "refused"


class TireState(NamedTuple):
    """A load and inflation pressure, each with its own parameters of the ring.

    Where they are those of earlier states as well, as assumed ones are, `number` is that of the contact, from 2.
    """

    load_n: float
    pressure_pa: float
    number: int = 0


class ScalingStatus(StrEnum):
    """State of knowledge of a residual's growth with speed: known, or the reason why not."""

    KNOWN = "known"
    UNCERTAIN = "uncertain"
    ONE_SPEED = "one_speed"
    SEEN_AT_ONE_SPEED = "seen_at_one_speed"
    SPEED_WITH_LOAD = "speed_with_load"
    TOO_WEAK = "too_weak"
    NON_STATIONARY = "non_stationary"


@dataclass(frozen=True, slots=True)
class Scaling:
    """Growth of a residual with wheel speed: its size is proportional to omega^exponent.

    Attributes:
        status: whether the exponent is known.
        exponent: whole where the data agree with a whole one; NaN unless the status is KNOWN or UNCERTAIN.
        std: standard error of an UNCERTAIN exponent, NaN otherwise.
    """

    status: ScalingStatus
    exponent: float = math.nan
    std: float = math.nan


@dataclass(frozen=True, slots=True)
class Fitted:
    """A number with unit and standard error.

    Attributes:
        value: in `unit`, which is SI.
        std: one standard error, likewise.
        unit: of both; empty for a pure number.
        factor: conversion from `unit` to `display_unit`.
        display_unit: of the number in tables; `unit` when empty.
        inverse_display: where tables show an inverse instead; as in `Parameter`.
        quantity: name of an estimate without its state; empty where that is its key.
        state: load and pressure of an estimate, None for the state of the most revolutions.
    """

    value: float
    std: float
    unit: str = ""
    factor: float = 1.0
    display_unit: str = ""
    inverse_display: InverseDisplay | None = None
    quantity: str = ""
    state: TireState | None = None


@dataclass(frozen=True, slots=True)
class SingleSize:
    """Size of an effect in one recording alone, or in one group of a single recording, everything free.

    Attributes:
        label: of the recording or group.
        parameter: of the effect.
        value: in SI.
        std: standard error, likewise.
    """

    label: Remark
    parameter: str
    value: float
    std: float


@dataclass(frozen=True, slots=True)
class Finding:
    """One effect of the catalogue for which the data hold evidence.

    Attributes:
        name: of the effect.
        verdict: the outcome.
        parameters: by name.
        chi2: reduction of the misfit (chi-square) on all data.
        rms_mps2: size of its contribution, rms over the signal of the axes it acts on.
        rms_before_mps2: held-out rms before it was added; NaN for refused effects.
        rms_after_mps2: and after.
        estimates: every estimate before and after the effect was added: name -> (before, after).
        rivals: names of its confounders: effects that explain the same data.
        decide_with: the deciding recording, when indistinguishable.
        reason: why it was refused or not distinguished; None otherwise.
        summary: a description of the effect.
        equation: its contribution.
        lock: "angle", "time", "contact" for what scatters from one contact to the next, or "revolution" for what has
            another size in each.
        probability: that the effect is present.
        log_odds: logarithm of its odds by the best sets with and without it; NaN for an impossible one.
        single_sizes: its sizes in each recording alone.
    """

    name: str
    verdict: Verdict
    parameters: Mapping[str, Fitted]
    chi2: float
    rms_mps2: float
    rms_before_mps2: float = float("nan")
    rms_after_mps2: float = float("nan")
    estimates: Mapping[str, tuple[Fitted, Fitted]] = field(default_factory=dict)
    rivals: tuple[str, ...] = ()
    decide_with: Reason | None = None
    reason: Reason | None = None
    summary: str = ""
    equation: str = ""
    lock: str = "angle"
    probability: float = math.nan
    log_odds: float = math.nan
    single_sizes: tuple[SingleSize, ...] = ()


@dataclass(frozen=True, slots=True)
class Drift:
    """Change of one quantity during a group of revolutions.

    Attributes:
        name: of the effect, of the number of the tire, or "load" or "pressure"; the last three as logarithms about
            their mean.
        parameter: of the effect; the name again for the others.
        label: of the group.
        per_minute: rate from the first to the last block, NaN where their times are not known.
        begin: value in the first block.
        end: value in the last one.
        rivals: names of other quantities whose drift explains the data as well.
    """

    name: str
    parameter: str
    label: Remark
    per_minute: Fitted
    begin: Fitted
    end: Fitted
    rivals: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Unexplained:
    """A residual above the noise that no effect of the catalogue explains.

    Attributes:
        axis: "circumferential", "lateral" or "radial".
        lock: "angle" (repeats with the wheel), "time" (remains when the mean revolution is subtracted), "place" (at one
            angle, with another waveform each turn), "turns" (differs between odd and even turns) or "samples" (error
            by samples that repeat the one before).
        orders: (lowest, highest) order of the wheel, None when not locked to it.
        hz: (lowest, highest) frequency at the campaign's speeds, None where only orders are known.
        angle_rad: (from, to) material angle that holds most of it, None when spread out or not locked.
        scaling: growth with speed.
        rms_mps2: size.
        std_mps2: one standard error.
        lock_known: False for "time" at multiples of the wheel's frequency: it may be locked to the wheel all the same,
            and vary from revolution to revolution.
        changes: True for a non-stationary one: it repeats with the wheel but changes during the recording; its size is
            that of the change.
        narrow: True for a spectral line, False for a band; only of "time".
        centre_order: mean order of a "time" residual whose frequency moves with speed, NaN otherwise.
        road_m: length of the road after which such a residual repeats, NaN otherwise and where it may be of the wheel.
        centre_hz: mean frequency of a line that keeps its frequency, NaN otherwise.
        speeds: (with it, recorded) number of speeds of a "time" residual that keeps its frequency over several.
        other_axes: (axis, rms) of the other axes that show a "time" residual.
        largest_in: label of the group where a non-stationary one changes most.
        timing_s: rms error of the sampling times that makes the scatter of a "place", NaN where another cause does.
        drifts: what changes in each group, of a non-stationary one that the drift of one quantity explains.
    """

    axis: str
    lock: str
    orders: tuple[int, int] | None
    hz: tuple[float, float] | None
    angle_rad: tuple[float, float] | None
    scaling: Scaling
    rms_mps2: float
    std_mps2: float
    lock_known: bool = True
    changes: bool = False
    narrow: bool = False
    centre_order: float = math.nan
    centre_hz: float = math.nan
    road_m: float = math.nan
    speeds: tuple[int, int] | None = None
    other_axes: tuple[tuple[str, float], ...] = ()
    largest_in: Remark = ""
    timing_s: float = math.nan
    drifts: tuple[Drift, ...] = ()


class UnseenError(NamedTuple):
    """Error of one axis of a recording, rms in m/s^2, that an effect has not seen.

    Attributes:
        recording: index.
        axis: "circumferential", "lateral" or "radial".
        before_mps2: without the effect.
        after_mps2: with the effect as the other recordings determine it.
        noise_mps2: that a perfect model would leave.
        contribution_mps2: of the effect, beyond what the tire's own parameters take.
        fall_std: by which noise alone changes the mean square that the effect takes away, (m/s^2)^2.
        coefficients: real coefficients compared.
    """

    recording: int
    axis: str
    before_mps2: float
    after_mps2: float
    noise_mps2: float
    contribution_mps2: float
    fall_std: float
    coefficients: int


@dataclass(frozen=True, slots=True)
class EffectCurves:
    """What an identified effect adds to the signal, in the group where that is most, for the figure.

    Attributes:
        name: of the effect.
        label: of the group.
        theta_rad: (n,).
        added_mps2: (3, n).
        std_mps2: (3, n) one standard error, by the errors of its parameters.
    """

    name: str
    label: Remark
    theta_rad: FloatArray
    added_mps2: FloatArray
    std_mps2: FloatArray


@dataclass(frozen=True, slots=True)
class Curves:
    """Waveforms of one group of revolutions (one recording at one speed) for the figures.

    Attributes:
        label: recording, speed, load, pressure.
        theta_rad: (n,).
        measured_mps2: (3, n) mean of all revolutions; NaN rows for absent axes.
        before_mps2: (3, n) baseline model, fitted.
        after_mps2: (3, n) with the named effects.
        noise_mps2: (3,) rms noise of the measured mean waveform, within the orders used.
        order_noise_mps2: (3, m) standard error of one real coefficient of each order of the mean.
    """

    label: Remark
    theta_rad: FloatArray
    measured_mps2: FloatArray
    before_mps2: FloatArray
    after_mps2: FloatArray
    noise_mps2: FloatArray
    order_noise_mps2: FloatArray


@dataclass(frozen=True, slots=True)
class Spectra:
    """Power spectral densities of the signal that is not locked to the wheel, one group.

    Attributes:
        label: as in `Curves`.
        frequency_hz: (m,).
        measured_m2ps3: (3, m) NaN rows for absent axes.
        before_m2ps3: (3, m) white sensor noise alone.
        after_m2ps3: (3, m) with the named effects.
    """

    label: Remark
    frequency_hz: FloatArray
    measured_m2ps3: FloatArray
    before_m2ps3: FloatArray
    after_m2ps3: FloatArray


@dataclass(frozen=True, slots=True)
class Trend:
    """The residual of one axis against one quantity, over groups.

    Attributes:
        axis: "circumferential", "lateral" or "radial".
        against: "speed", "load", "pressure", "temperature" or "time", unit included: "speed_kmh".
        at: (g,) values of it.
        before_mps2: (g,) rms of the residual of the group's mean, noise power subtracted.
        after_mps2: (g,).
        noise_mps2: (g,) noise of the group's mean.
    """

    axis: str
    against: str
    at: FloatArray
    before_mps2: FloatArray
    after_mps2: FloatArray
    noise_mps2: FloatArray


@dataclass(frozen=True, slots=True)
class AxisError:
    """Error of one axis on held-out revolutions.

    Attributes:
        axis: "circumferential", "lateral" or "radial".
        before_mps2: rms of the baseline model's.
        after_mps2: with the effects that the other revolutions determine.
        with_discrepancy_mps2: with the mean of what no effect explains added.
        noise_mps2: rms that a perfect model would leave.
        before_weighted: root mean square of the error over the scatter, 1 for a perfect model.
        after_weighted: likewise.
    """

    axis: str
    before_mps2: float
    after_mps2: float
    with_discrepancy_mps2: float
    noise_mps2: float
    before_weighted: float
    after_weighted: float


@dataclass(frozen=True, slots=True)
class BlockError:
    """Error on one block of revolutions of one group, predicted from the others, rms over axes and orders used.

    Attributes:
        group: label.
        revolutions: of the block; 1 where each revolution is a fold.
        time_s: mean host time.
        before_mps2: of the baseline model.
        after_mps2: with effects.
    """

    group: Remark
    revolutions: int
    time_s: float
    before_mps2: float
    after_mps2: float


class AsRecorded(NamedTuple):
    """The same errors on revolutions whose contact edges are not aligned.

    Attributes:
        rms_before_mps2: of the baseline model.
        rms_after_mps2: with effects.
        revolutions: whose edges are aligned otherwise.
        parameters: that this takes at most, over all revolutions.
    """

    rms_before_mps2: float
    rms_after_mps2: float
    revolutions: int
    parameters: int


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Error on revolutions that were used by no fit and no selection, rms over axes and orders used.

    Attributes:
        rms_before_mps2: of the baseline model.
        rms_after_mps2: with effects.
        revolutions: held out.
        folds: number of folds.
        axes: the same by axis.
        std_before_mps2: one standard error of the rms before, by the blocks' differences (jackknife).
        std_after_mps2: after.
        std_ratio: of after over before.
        blocks: error of each block.
        as_recorded: the errors without alignment of contact edges; None where nothing is aligned.
    """

    rms_before_mps2: float
    rms_after_mps2: float
    revolutions: int
    folds: int
    axes: tuple[AxisError, ...] = ()
    std_before_mps2: float = math.nan
    std_after_mps2: float = math.nan
    std_ratio: float = math.nan
    blocks: tuple[BlockError, ...] = ()
    as_recorded: AsRecorded | None = None


class RecordingOrigin(NamedTuple):
    """Identity of a recording.

    Attributes:
        path: as given.
        sha256: of its content, hexadecimal; empty where it is no file.
        first_s: host time of the first revolution used, s since 1970; 0 where none is.
        last_s: of the last.
    """

    path: str
    sha256: str
    first_s: float
    last_s: float


@dataclass(frozen=True, slots=True)
class Origin:
    """What a diagnosis was made of, and how.

    Attributes:
        recordings: in the order given.
        sensor_id: serial number of the sensor, None if unknown or not the same in all recordings.
        vehicle: name of the vehicle or test rig, empty if unknown or not the same in all recordings.
        tire: size of the tire, likewise.
        command: as given, empty where no command was.
        commit: of the program, empty where it is not known.
    """

    recordings: tuple[RecordingOrigin, ...]
    sensor_id: int | None = None
    vehicle: str = ""
    tire: str = ""
    command: str = ""
    commit: str = ""


@dataclass(frozen=True, slots=True)
class SelfTest:
    """Diagnoses of recordings that were simulated from a result and from what it leaves.

    Attributes:
        count: of simulations.
        wrong: of those in which an effect was identified that was not in them.
        false: number of simulations by the name of such an effect.
        missed: number of simulations by the name of an identified effect that was not identified again.
        failed: number of further simulations that have no diagnosis.
        pulls: differences of determined numbers and of parameters from the truth over their standard errors.
    """

    count: int
    wrong: int
    failed: int
    false: Mapping[str, int]
    missed: Mapping[str, int]
    pulls: tuple[float, ...]

    @property
    def pull_rms(self) -> float:
        """Root mean square of the pulls, NaN without any."""
        return math.sqrt(sum(pull**2 for pull in self.pulls) / len(self.pulls)) if self.pulls else math.nan


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """A finished diagnosis of one wheel.

    Attributes:
        model: baseline model.
        wheel: position.
        recordings: paths as given.
        assumed: inputs that were assumed.
        revolutions: used.
        rejected: left out.
        noise_floor_mps2: rms that the held-out error would have if the model were right.
        held_out: errors of the nested hold-out.
        findings: named first, in the order in which they were added, then indistinguishable, then refused.
        unexplained: largest first.
        estimates_before: of the baseline model, by name (`Bs`, `contact_half_angle_rad`, ...).
        estimates_after: with the named effects.
        determined: estimate with the named effects -> False when the data do not determine it.
        determined_before: likewise for the baseline model's.
        curves: for figures.
        effect_curves: for figures.
        spectra: for figures.
        trends: for figures.
        empirical_rms_mps2: held-out rms with the fitted empirical correction, None when not requested.
        notes: limitations: groups left out, few revolutions, one speed only.
        folds_of: unit of a fold: "recordings", "blocks of revolutions" or "revolutions".
        correction: contributions of the named effects, for `live` and `estimate` to subtract; None when nothing was
            named, or where the baseline model is not the exact ring.
        stated: inputs that were stated or measured, with their source.
        load_known: False where the load of a group was assumed.
        pressure_known: False where the pressure of a group was assumed.
        complete: False where the search for effects ended because its time was over.
        outvoted: recordings that most others contradict, by index, and why.
        left_out: recordings that were given but not used, each with its reason.
        origin: what it was made of; None where that is not known.
        self_test: how simulations of the result are diagnosed; None where none was asked for.
        taken_from: where the effects were found, if nothing was searched for and they are as found there.
        units: that screens and pages show.
    """

    model: str
    wheel: str
    recordings: tuple[str, ...]
    assumed: tuple[Remark, ...]
    revolutions: int
    rejected: int
    noise_floor_mps2: float
    held_out: HeldOut
    findings: tuple[Finding, ...]
    unexplained: tuple[Unexplained, ...]
    estimates_before: Mapping[str, Fitted]
    estimates_after: Mapping[str, Fitted]
    determined: Mapping[str, bool] = field(default_factory=dict)
    determined_before: Mapping[str, bool] = field(default_factory=dict)
    curves: tuple[Curves, ...] = ()
    effect_curves: tuple[EffectCurves, ...] = ()
    spectra: tuple[Spectra, ...] = ()
    trends: tuple[Trend, ...] = ()
    empirical_rms_mps2: float | None = None
    notes: tuple[Reason, ...] = ()
    folds_of: str = "blocks of revolutions"
    correction: CorrectionTable | None = None
    stated: tuple[Reason, ...] = ()
    load_known: bool = True
    pressure_known: bool = True
    complete: bool = True
    outvoted: Mapping[int, Reason] = field(default_factory=dict)
    left_out: tuple[Reason, ...] = ()
    origin: Origin | None = None
    self_test: SelfTest | None = None
    taken_from: str = ""
    units: ShownUnits = ShownUnits.SI

    @property
    def named(self) -> tuple[Finding, ...]:
        """The effects that were added."""
        return tuple(finding for finding in self.findings if finding.verdict is Verdict.NAMED)
