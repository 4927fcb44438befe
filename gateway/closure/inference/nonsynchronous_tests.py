"""Acceptance tests of nonsynchronous effects: axes, speed, steadiness, sign and residual."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

import numpy as np

from gateway.closure.effects.effect import CIRCUMFERENTIAL, RADIAL, GroupConditions, SpectrumEffect
from gateway.closure.inference.narrow_lines import envelope_moment
from gateway.closure.inference.nonsynchronous_density import Site, wide_density
from gateway.closure.inference.nonsynchronous_selection import place_of
from gateway.closure.inference.nonsynchronous_spectra import held_scaling
from gateway.closure.inference.parameter_range import outside_range
from gateway.closure.inference.whittle_fit import Observed, SpectrumFit
from gateway.constants import AXIS_NAMES
from gateway.reasons import Code, Reason
from gateway.types import FloatArray

# Largest ratio of rms between axes that must agree, and largest share of power on an axis that must be quiet.
_AXES_RATIO: Final = 1.6
_QUIET: Final = 0.1
# Largest ratio of a group's rms to that of the common parameters, either way; tolerance of the speed exponent about 1.
_GROUPS_RATIO: Final = 1.6
_EXPONENT: Final = 0.35
_KNOWN_EXPONENT: Final = 0.5
# Relative error of the density where the effect dominates it.
_REST: Final = 0.25
_MOST: Final = 0.3
_SIGMAS: Final = 3.0
_QUADRATURE: Final = 0.35


@runtime_checkable
class Rotating(Protocol):
    """An effect fixed in space: the radial and circumferential axes measure it in quadrature."""

    def quadrature(self, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the imaginary part of the cross density, (m,)."""
        ...


@runtime_checkable
class NarrowNoise(Protocol):
    """An effect that is noise in a narrow band."""

    def noise_band(self, parameters: FloatArray) -> tuple[float, float]:
        """Return the band that holds most of its power, (from, to), Hz."""
        ...


@dataclass(frozen=True, slots=True)
class Size:
    """Power of an effect on each axis of each group, relative to the fit.

    Attributes:
        factor: (g, 3) in power; for axes it does not act on, relative to the mean of those it acts on.
        std: (g, 3) standard errors; infinite for absent axes.
        share: number of bins in which it dominates the density.
    """

    factor: FloatArray
    std: FloatArray
    share: int


def effect_size(sites: Sequence[Site], observed: Sequence[Observed], fit: SpectrumFit, effect: SpectrumEffect) -> Size:
    """Return the measured power of an effect on each axis of each group."""
    own = fit.shared[place_of(fit.parts, effect)]
    factor, std = np.zeros((len(sites), 3)), np.full((len(sites), 3), np.inf)
    share = 0
    for g, (site, one) in enumerate(zip(sites, observed, strict=True)):
        density, noise, _ = wide_density(site, fit.parts, fit.levels[g], fit.shared)
        shape = site.wide(effect.density(site.spectra.conditions, site.grid_hz, own))
        share += int((shape > _MOST * density).sum())
        for axis in range(3):
            if not site.spectra.present[axis]:
                continue
            acts = axis in effect.axes
            added = shape[axis] if acts else shape[list(effect.axes)].mean(axis=0)
            weight = one.freedom[axis] / np.square(density[axis] if acts else np.maximum(density[axis], added))
            white = noise[axis]
            power = float((weight * white * white).sum()) + 1e-12
            clear = added - float((weight * white * added).sum()) / power * white
            below = float((weight * clear * clear).sum())
            if below > 0.0:
                factor[g, axis] = acts + float((weight * clear * (one.power[axis] - density[axis])).sum()) / below
                std[g, axis] = below**-0.5
    return Size(factor, std, share)


def objection(
    sites: Sequence[Site], observed: Sequence[Observed], fit: SpectrumFit, effect: SpectrumEffect
) -> tuple[Reason | None, bool]:
    """Return why an effect fails, None if it passes, and whether another speed would resolve it."""
    own = fit.shared[place_of(fit.parts, effect)]
    for one, value in zip(effect.parameters, own, strict=True):
        if not one.low <= value <= one.high:
            if value == 0.0:
                return Reason(Code.NOTHING_REMAINS), False
            return outside_range(one, float(value)), False
    size = effect_size(sites, observed, fit, effect)
    reason = _axes_differ(effect, size) or _groups_differ(effect, size, sites, own)
    if reason is None and isinstance(effect, Rotating):
        reason = _wrong_sense(sites, fit, effect, own)
    if reason is None and isinstance(effect, NarrowNoise):
        band = effect.noise_band(own)
        reason = _not_alone(sites, effect, band) or _steady(sites, band)
    if reason is None:
        reason = _rest(sites, observed, fit, effect, own)
    if reason is not None:
        return reason, False
    return _unusual(sites, effect, own)


def _unusual(sites: Sequence[Site], effect: SpectrumEffect, own: FloatArray) -> tuple[Reason | None, bool]:
    usual: tuple[str, float, float] | None = getattr(effect, "usual", None)
    if usual is None or several_speeds(sites):
        return None, False
    at = [one.name for one in effect.parameters].index(usual[0])
    if usual[1] <= own[at] <= usual[2]:
        return None, False
    parameter = effect.parameters[at]
    return Reason(
        Code.UNUSUAL_PARAMETER,
        parameter=parameter.name,
        value=float(own[at]) * parameter.factor,
        unit=parameter.display_unit or parameter.unit,
    ), True


def several_speeds(sites: Sequence[Site]) -> bool:
    """Return whether the groups differ in speed."""
    speeds = [site.spectra.speed_mps for site in sites]
    return max(speeds) > 1.08 * min(speeds)


def _pooled(size: Size, axis: int) -> tuple[float, float]:
    weight = 1.0 / np.square(size.std[:, axis])
    total = float(weight.sum())
    if not total > 0.0:
        return 0.0, math.inf
    return float(weight @ size.factor[:, axis]) / total, total**-0.5


def _axes_differ(effect: SpectrumEffect, size: Size) -> Reason | None:
    pooled = [_pooled(size, axis) for axis in range(3)]
    acting = [axis for axis in effect.axes if math.isfinite(pooled[axis][1])]
    mean = float(np.mean([pooled[axis][0] for axis in acting])) if acting else 0.0
    for axis in acting:
        factor, std = pooled[axis]
        high, low = factor + _SIGMAS * std, factor - _SIGMAS * std
        if (
            high < mean / _AXES_RATIO**2
            or low > mean * _AXES_RATIO**2
            or factor < _SIGMAS * std < mean / _AXES_RATIO**2
        ):
            ratio = math.sqrt(max(factor, 0.0) / mean)
            return Reason(Code.AXIS_HAS_OTHER_SHARE, axis=AXIS_NAMES[axis], ratio=ratio)
    for axis in range(3):
        factor, std = pooled[axis]
        if axis not in effect.axes and factor - _SIGMAS * std > _QUIET * mean:
            ratio = math.sqrt(max(factor, 0.0))
            return Reason(Code.AXIS_SHOULD_BE_QUIET, axis=AXIS_NAMES[axis], ratio=ratio)
    return None


def group_sizes(effect: SpectrumEffect, size: Size) -> tuple[FloatArray, FloatArray]:
    """Return the power in each group relative to the fit, and its standard error, (g,) each."""
    axes = list(effect.axes)
    weight = 1.0 / np.square(size.std[:, axes])
    total = np.maximum(weight.sum(axis=1), 1e-12)
    return (weight * size.factor[:, axes]).sum(axis=1) / total, total**-0.5


def _groups_differ(effect: SpectrumEffect, size: Size, sites: Sequence[Site], own: FloatArray) -> Reason | None:
    if len(sites) < 2:
        return None
    factor, std = group_sizes(effect, size)
    for site, value, error in zip(sites, factor.tolist(), std.tolist(), strict=True):
        away = _SIGMAS * error
        if value + away < _GROUPS_RATIO**-2 or value - away > _GROUPS_RATIO**2:
            ratio = math.sqrt(max(value, 0.0))
            return Reason(Code.RECORDING_HAS_OTHER_SIZE, recording=site.spectra.label, ratio=ratio)
    beyond = np.sqrt(np.maximum(factor, 0.05))
    error = 0.5 * std / np.maximum(factor, 0.05) * beyond
    exponent, unsure = held_scaling([site.spectra for site in sites], beyond.tolist(), error.tolist())
    if unsure < _KNOWN_EXPONENT and abs(exponent) > _EXPONENT + 2.0 * unsure:
        names = [parameter.name for parameter in effect.parameters]
        grown = float(own[names.index("growth")]) if "growth" in names else 1.0
        return Reason(Code.WRONG_SPEED_EXPONENT, exponent=grown + exponent, exponent_std=unsure)
    return None


def _wrong_sense(sites: Sequence[Site], fit: SpectrumFit, effect: Rotating, own: FloatArray) -> Reason | None:
    """Compare the cross density of the two axes with that of a force fixed in space."""
    top = below = 0.0
    seen = False
    for g, site in enumerate(sites):
        spectra = site.spectra
        if not (spectra.present[RADIAL] and spectra.present[CIRCUMFERENTIAL]):
            continue
        seen = True
        expected = effect.quadrature(spectra.conditions, spectra.frequency_hz, own)
        wide, _, _ = wide_density(site, fit.parts, fit.levels[g], fit.shared)
        variance = 0.5 * wide[RADIAL] * wide[CIRCUMFERENTIAL]
        weight = spectra.count * spectra.freedom.sum() / variance
        expected = spectra.wide(expected)
        top += float((weight * expected * spectra.wide(spectra.cross.imag)).sum())
        below += float((weight * expected * expected).sum())
    if not seen:
        return None if several_speeds(sites) else Reason(Code.NEEDS_AXIS_OR_SPEED)
    ratio, std = top / below, below**-0.5
    if abs(ratio - 1.0) > _QUADRATURE + _SIGMAS * std or std > _QUADRATURE:
        return Reason(Code.WRONG_QUADRATURE, ratio=ratio, ratio_std=std)
    return None


def _not_alone(sites: Sequence[Site], effect: SpectrumEffect, band: tuple[float, float]) -> Reason | None:
    """Detect the narrow band on axes that must be quiet, relative to neighbouring frequencies rather than the fit."""
    above = np.zeros((len(sites), 3))
    std = np.full((len(sites), 3), np.inf)
    width = band[1] - band[0]
    for g, site in enumerate(sites):
        frequency, power = site.spectra.frequency_hz, site.spectra.mean_power()
        away = np.abs(frequency - 0.5 * (band[0] + band[1])) / max(width, 2.0 * site.spectra.step_hz)
        inside, beside = away <= 0.5, (away > 1.5) & (away <= 3.0)
        for axis in np.flatnonzero(site.spectra.present).tolist():
            around = float(np.median(power[axis, beside]))
            above[g, axis] = float((power[axis, inside] - around).sum())
            error = float(np.square(power[axis, inside]).sum()) + inside.sum() ** 2 / beside.sum() * around**2
            std[g, axis] = math.sqrt(error / float(site.spectra.freedom.sum()))
    own = float(above[:, list(effect.axes)].sum())
    if own <= 0.0:
        return Reason(Code.BELOW_SURROUNDINGS)
    for axis in range(3):
        seen = np.isfinite(std[:, axis])
        if axis in effect.axes or not seen.any():
            continue
        total, error = float(above[seen, axis].sum()), math.sqrt(float(np.square(std[seen, axis]).sum()))
        if math.isfinite(error) and total - _SIGMAS * error > _QUIET * own:
            return Reason(Code.AXIS_SHOWS_SAME_BAND, axis=AXIS_NAMES[axis], ratio=math.sqrt(total / own))
    return None


def _steady(sites: Sequence[Site], band: tuple[float, float]) -> Reason | None:
    """Distinguish a tone, whose frequency may drift, from noise, whose envelope fluctuates."""
    values, weights = [], []
    for site in sites:
        value, number = envelope_moment(site.spectra.runs, site.spectra.rate_hz, RADIAL, band)
        values.append(value)
        weights.append(number)
    total = float(sum(weights))
    mean = float(np.average(values, weights=weights)) if total > 0.0 else 2.0
    # The moment is 2 for noise and 1 for a tone; its standard error for noise is 2 / sqrt(number).
    if mean < 2.0 - max(0.3, _SIGMAS * 2.0 / math.sqrt(max(total, 1.0))):
        return Reason(Code.ENVELOPE_TOO_STEADY, fourth_moment=mean)
    return None


def _rest(
    sites: Sequence[Site], observed: Sequence[Observed], fit: SpectrumFit, effect: SpectrumEffect, own: FloatArray
) -> Reason | None:
    """Return the residual share of the density where the effect dominates, if that share is not small."""
    top = below = 0.0
    for g, (site, one) in enumerate(zip(sites, observed, strict=True)):
        density = wide_density(site, fit.parts, fit.levels[g], fit.shared)[0]
        added = site.wide(effect.density(site.spectra.conditions, site.grid_hz, own))
        weight = np.where(added > _MOST * density, one.freedom, 0.0) * (added / density)
        known = one.freedom > 0.0
        noise = np.divide(1.0, one.freedom, out=np.zeros_like(density), where=known)
        top += float((weight * (np.square(one.power / density - 1.0) - noise)).sum())
        below += float(weight.sum())
    error = math.sqrt(max(top, 0.0) / below) if below > 0.0 else 0.0
    return Reason(Code.LEAVES_DENSITY, residual_share=error) if error > _REST else None
