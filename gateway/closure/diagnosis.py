"""What a diagnosis hands out: the closure before and after, with every figure that the report shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from gateway.closure.observation import Remark
from gateway.signal.effect_correction import CorrectionTable
from gateway.types import FloatArray

FAR_OFF: Final = 1.2
"""An error after that is this many noise floors: what the model still lacks may move estimates beyond their errors.

From `paper` and `series` pulls of Bs, Cw, Rs, Ts stay below 3.3 up to it, and go to 6 and more beyond.
"""


class Verdict(StrEnum):
    """What became of a candidate.

    NAMED: accepted, the model lacks it and the data tell it from the others. INDISTINGUISHABLE: one of several that
    explain the same thing equally well; `Finding.rivals` names them and `Finding.decide_with` the recording that would
    decide. REFUSED: it takes something off the residual, but not as the effect must; `Finding.reason` says why.
    """

    NAMED = "named"
    INDISTINGUISHABLE = "indistinguishable"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class Fitted:
    """A number with unit and standard error.

    Attributes:
        value: in `unit`, which is SI.
        std: one standard error, likewise.
        unit: of both; empty for a pure number.
        factor: what makes it the number that is shown, in `display_unit`.
        display_unit: of the shown number; `unit` when empty.
        inverse_display: (factor, unit) where tables show factor / value instead; as in `Parameter`.
    """

    value: float
    std: float
    unit: str = ""
    factor: float = 1.0
    display_unit: str = ""
    inverse_display: tuple[float, str] | None = None


@dataclass(frozen=True, slots=True)
class Finding:
    """One effect of the catalogue that the data speak about.

    Attributes:
        name: of the effect.
        verdict: what became of it.
        parameters: by name.
        chi2: fall of the misfit (chi-square) on all data.
        held_out_gain: fall of the misfit on revolutions that no fit had seen, sum over folds.
        held_out_std: its standard error over folds.
        rms_mps2: size of what it explains, rms over the signal of the axes it acts on.
        rms_before_mps2: held-out rms before it was added; NaN for what was refused.
        rms_after_mps2: and after.
        estimates: every estimate before and after the effect was added: name -> (before, after).
        rivals: names of effects that explain the same.
        decide_with: the recording that would decide, when indistinguishable.
        reason: why it was refused; empty otherwise.
        summary: what it is.
        equation: its contribution.
        lock: "angle", "time", or "contact" for what scatters from one contact to the next.
    """

    name: str
    verdict: Verdict
    parameters: Mapping[str, Fitted]
    chi2: float
    held_out_gain: float
    held_out_std: float
    rms_mps2: float
    rms_before_mps2: float = float("nan")
    rms_after_mps2: float = float("nan")
    estimates: Mapping[str, tuple[Fitted, Fitted]] = field(default_factory=dict)
    rivals: tuple[str, ...] = ()
    decide_with: str = ""
    reason: str = ""
    summary: str = ""
    equation: str = ""
    lock: str = "angle"


@dataclass(frozen=True, slots=True)
class Unexplained:
    """Something that stands out of the noise and that no effect of the catalogue explains.

    Attributes:
        axis: "circumferential", "lateral" or "radial".
        lock: "angle" (repeats with the wheel) or "time" (what is left when the mean revolution is taken off).
        orders: (lowest, highest) order of the wheel, None when not locked to it.
        hz: (lowest, highest) frequency at the campaign's speeds, None for what spans orders only.
        angle_rad: (from, to) material angle where most of it sits, None when spread out or not locked.
        scaling: how its size goes with speed, in words: "omega^2", "omega^1", "constant", "not known: one speed".
        rms_mps2: size.
        std_mps2: one standard error.
        text: one sentence for the user.
        lock_known: False of what is "time" but at multiples of the wheel's frequency: it may be locked to the wheel
            all the same, and change from revolution to revolution.
        changes: True of what repeats with the wheel, but changes during the recording; its size is that of the change.
    """

    axis: str
    lock: str
    orders: tuple[int, int] | None
    hz: tuple[float, float] | None
    angle_rad: tuple[float, float] | None
    scaling: str
    rms_mps2: float
    std_mps2: float
    text: str
    lock_known: bool = True
    changes: bool = False


@dataclass(frozen=True, slots=True)
class Curves:
    """Waveforms of one group of revolutions (one recording at one speed) for the figures.

    Attributes:
        label: recording, speed, load, pressure.
        theta_rad: (n,).
        measured_mps2: (3, n) mean of all revolutions; NaN rows for absent axes.
        before_mps2: (3, n) starting model, fitted.
        after_mps2: (3, n) with the named effects.
        noise_mps2: (3,) rms noise of the measured mean waveform, within the orders used.
        order_noise_mps2: (3, m) standard error of one real coefficient of each order of the mean.
    """

    label: str
    theta_rad: FloatArray
    measured_mps2: FloatArray
    before_mps2: FloatArray
    after_mps2: FloatArray
    noise_mps2: FloatArray
    order_noise_mps2: FloatArray


@dataclass(frozen=True, slots=True)
class Spectra:
    """Densities of what is not locked to the wheel, one group.

    Attributes:
        label: as in `Curves`.
        frequency_hz: (m,).
        measured_m2ps3: (3, m) NaN rows for absent axes.
        before_m2ps3: (3, m) white sensor noise alone.
        after_m2ps3: (3, m) with the named effects.
    """

    label: str
    frequency_hz: FloatArray
    measured_m2ps3: FloatArray
    before_m2ps3: FloatArray
    after_m2ps3: FloatArray


@dataclass(frozen=True, slots=True)
class Trend:
    """How the residual of one axis goes with one quantity, over groups.

    Attributes:
        axis: which axis.
        against: "speed", "load", "pressure", "temperature" or "time", unit included: "speed_kmh".
        at: (g,) values of it.
        before_mps2: (g,) rms of the residual of the group's mean, noise taken off in power.
        after_mps2: (g,).
        noise_mps2: (g,) noise beside it.
    """

    axis: str
    against: str
    at: FloatArray
    before_mps2: FloatArray
    after_mps2: FloatArray
    noise_mps2: FloatArray


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Error on revolutions that no fit and no selection has seen, rms over axes and orders used."""

    rms_before_mps2: float
    rms_after_mps2: float
    revolutions: int
    folds: int


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """A finished diagnosis of one wheel.

    Attributes:
        model: starting model.
        wheel: position.
        recordings: paths as given.
        assumed: what nobody stated, in words.
        revolutions: used.
        rejected: left out.
        noise_floor_mps2: rms that the held-out error would have if the model were right.
        held_out: the figures of the nested hold-out.
        findings: named first, in the order in which they were added, then indistinguishable, then refused.
        unexplained: largest first.
        estimates_before: of the starting model, by name (`Bs`, `contact_half_angle_rad`, ...).
        estimates_after: with the named effects.
        determined: estimate -> False when the data do not determine it after all.
        curves: for figures.
        spectra: for figures.
        trends: for figures.
        empirical_rms_mps2: held-out rms with the fitted empirical correction, None when not asked for.
        notes: what the user must know: groups left out, few revolutions, one speed only.
        folds_of: what the folds were: "recordings", "blocks of revolutions" or "revolutions".
        correction: what the named effects add, for `live` and `estimate` to take off; None when nothing was named, or
            where the starting model is not the exact ring.
        stated: what was stated or measured beside the samples, and by whom, in words.
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
    curves: tuple[Curves, ...] = ()
    spectra: tuple[Spectra, ...] = ()
    trends: tuple[Trend, ...] = ()
    empirical_rms_mps2: float | None = None
    notes: tuple[Remark, ...] = ()
    folds_of: str = "blocks of revolutions"
    correction: CorrectionTable | None = None
    stated: tuple[Remark, ...] = ()

    @property
    def named(self) -> tuple[Finding, ...]:
        """The effects that were added."""
        return tuple(finding for finding in self.findings if finding.verdict is Verdict.NAMED)
