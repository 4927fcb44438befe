"""Spectral density of the nonsynchronous signal: sensor noise, effects of the catalogue and strange bands."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Final

import numpy as np

from gateway.core.types import FloatArray, IntArray
from gateway.diagnosis import criteria
from gateway.diagnosis.effects.effect import GroupConditions, SpectrumEffect
from gateway.diagnosis.spectrum.nonsynchronous_spectra import GroupSpectra

LOW_PASS: Final = "low-pass behind the sensor"

_HANN: Final = (1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0)
# Fits may go this far beyond the physical range, so that an implausible value is seen as one.
_LOW_FACTOR, _HIGH_FACTOR = 0.7, 1.4
_MAX_SIZE_FACTOR: Final = 4.0
# A strange band may lie anywhere in the spectrum.
_STRANGE_RANGE: Final = 5.0


@dataclass(frozen=True, slots=True)
class Prior:
    """Normal priors of parameters and the ends between which they are fitted, (P,) each."""

    low: FloatArray
    high: FloatArray
    mean: FloatArray
    std: FloatArray


# ln of the corner frequency over 1 Hz; roll-off m, |H|^2 = 1 / (1 + (f / corner)^(2 m)), two poles m = 2.
_FILTER: Final = Prior(
    np.array([math.log(50.0), 1.0]),
    np.array([math.log(1e4), 6.0]),
    np.array([math.log(1e3), 2.0]),
    np.array([1.0, 0.4]),
)
FILTER_TERMS: Final = len(_FILTER.mean)
FILTER_STARTS: Final = tuple(np.array([math.log(hz), 2.0]) for hz in (300.0, 600.0, 1000.0, 1500.0))


class Component:
    """Additive part of the density: an effect of the catalogue, or a strange band of its shape.

    An effect has one size for all groups and axes, scaled by its law. The size of a strange band is free on every axis
    of every group: it is what no effect explains. Its parameters are those of the effect, then ln of the size on each
    axis of each group over the common one. A band that keeps the law needs none of these; the effect itself is then
    the better explanation.

    Attributes:
        effect: whose shape it has.
        strange: whether its size is free.
        name: of the effect, or of the band.
        prior: of its parameters; the first is the size.
        decades: ln of the largest over the smallest size.
    """

    def __init__(self, effect: SpectrumEffect, free_groups: int = 0) -> None:
        """Take the effect, and the number of groups where its size is free, 0 where it keeps its law."""
        self.effect = effect
        self.strange = free_groups > 0
        self.name = strange_name(effect.name) if self.strange else effect.name
        self.decades = math.log(effect.parameters[0].high / effect.parameters[0].low)
        self._number = len(effect.parameters)
        range_factor = _STRANGE_RANGE if self.strange else 1.0
        limits = []
        for number, parameter in enumerate(effect.parameters):
            low, high = (
                (0.0, _MAX_SIZE_FACTOR * parameter.high)
                if number == 0
                else (_LOW_FACTOR * parameter.low, _HIGH_FACTOR * parameter.high)
            )
            limits.append((low / range_factor, high * range_factor, parameter.prior_mean, parameter.prior_std))
        size_std = criteria.FREE_SIZE
        limits += [(-range_factor * size_std, range_factor * size_std, 0.0, size_std)] * (3 * free_groups)
        self.prior = Prior(*np.array(limits, dtype=np.float64).T)

    def density(
        self, site: int, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """Return its one-sided density in a group, (3, m), (m/s^2)^2 per Hz."""
        shape = self.effect.density(conditions, frequency_hz, parameters[: self._number])
        return self._on_all_axes(shape) * self._sizes(site, parameters) if self.strange else shape

    def derivative(
        self, site: int, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """Return d density / d parameters, (P, 3, m)."""
        shape = self.effect.density_derivative(conditions, frequency_hz, parameters[: self._number])
        if not self.strange:
            return shape
        rows = np.zeros((len(parameters), 3, len(frequency_hz)))
        sizes = self._sizes(site, parameters)
        for number, row in enumerate(shape):
            rows[number] = self._on_all_axes(row) * sizes
        density = self.density(site, conditions, frequency_hz, parameters)
        for axis in range(3):
            rows[self._number + 3 * site + axis, axis] = 2.0 * density[axis]
        return rows

    def _on_all_axes(self, density: FloatArray) -> FloatArray:
        """Return a density (3, m) with the mean of its axes on those on which the effect does not act."""
        result = density.copy()
        inactive = [axis for axis in range(3) if axis not in self.effect.axes]
        result[inactive] = density[list(self.effect.axes)].mean(axis=0)
        return result

    def _sizes(self, site: int, parameters: FloatArray) -> FloatArray:
        first = self._number + 3 * site
        sizes: FloatArray = np.exp(2.0 * parameters[first : first + 3])[:, None]
        return sizes


def strange_name(name: str) -> str:
    """Return the name of the strange band of an effect's shape."""
    return f"band like {name}"


@dataclass(frozen=True, slots=True)
class Parts:
    """Components of a model of the density.

    Attributes:
        components: effects of the catalogue and strange bands, in the order of their parameters.
        low_pass: whether the sensor's noise and all mechanical signals are low-pass filtered.
    """

    components: tuple[Component, ...] = ()
    low_pass: bool = False

    @property
    def names(self) -> frozenset[str]:
        """Names of all parts."""
        return frozenset((*(component.name for component in self.components), *((LOW_PASS,) if self.low_pass else ())))

    @property
    def shared(self) -> int:
        """Number of parameters that all groups share."""
        return self.filter_at + FILTER_TERMS * self.low_pass

    @property
    def slices(self) -> tuple[tuple[Component, slice], ...]:
        """Each component with the slice of its parameters among the shared ones."""
        ends = accumulate((len(component.prior.mean) for component in self.components), initial=0)
        return tuple(zip(self.components, (slice(*ends_of) for ends_of in pairwise(ends)), strict=True))

    @property
    def sizes(self) -> tuple[tuple[int, float], ...]:
        """Index of the size of each component, and ln of the range in which its order of magnitude is not known."""
        return tuple((columns.start, component.decades) for component, columns in self.slices)

    @property
    def filter_at(self) -> int:
        """Index of the first parameter behind those of the components."""
        return sum(len(component.prior.mean) for component in self.components)

    @property
    def prior(self) -> Prior:
        """Priors of all shared parameters."""
        priors = [*(component.prior for component in self.components), *((_FILTER,) if self.low_pass else ())]
        empty = np.empty(0)
        return Prior(
            np.concatenate([empty, *(part.low for part in priors)]),
            np.concatenate([empty, *(part.high for part in priors)]),
            np.concatenate([empty, *(part.mean for part in priors)]),
            np.concatenate([empty, *(part.std for part in priors)]),
        )

    def columns_of(self, name: str) -> slice:
        """Return the slice of a component's parameters among the shared ones.

        Raises:
            ValueError: there is no such component.
        """
        for component, columns in self.slices:
            if component.name == name:
                return columns
        raise ValueError(f"{name} is not in the model")


@dataclass(frozen=True, slots=True)
class Site:
    """One group in the form that the model needs.

    Attributes:
        index: of the group.
        spectra: spectra of the group.
        dense: bins below this index are fitted one by one, or nearly so; above, the centre represents a wide bin.
        grid_hz: (q,) frequencies at which effects are evaluated.
        first: (b,) index in `grid_hz` of the first frequency of each wide bin.
    """

    index: int
    spectra: GroupSpectra
    dense: int
    grid_hz: FloatArray
    first: IntArray

    @classmethod
    def of(cls, index: int, spectra: GroupSpectra) -> Site:
        """Return the site of a group."""
        broad = np.flatnonzero(spectra.count >= 10)
        begin = int(broad[0]) if len(broad) else len(spectra.first)
        dense = int(spectra.first[begin]) if begin < len(spectra.first) else len(spectra.frequency_hz)
        centres = spectra.wide(spectra.frequency_hz)[begin:]
        return cls(
            index,
            spectra,
            dense,
            np.concatenate((spectra.frequency_hz[:dense], centres)),
            np.concatenate((spectra.first[:begin], dense + np.arange(len(centres)))).astype(np.intp),
        )

    def wide(self, values: FloatArray) -> FloatArray:
        """Return means over wide bins, (..., b), of values at `grid_hz`, convolved with the spectral window."""
        convolved = through_window(values, self.dense)
        count = np.diff(np.append(self.first, len(self.grid_hz)))
        result: FloatArray = np.add.reduceat(convolved, self.first, axis=-1) / count
        return result


def through_window(density: FloatArray, dense: int) -> FloatArray:
    """Return a density convolved with the Hann window; the first `dense` values belong to neighbouring bins."""
    if dense < 3:
        return density
    convolved = density.copy()
    part = density[..., :dense]
    convolved[..., 1 : dense - 1] = _HANN[0] * part[..., :-2] + _HANN[1] * part[..., 1:-1] + _HANN[2] * part[..., 2:]
    return convolved


def wide_density(
    site: Site, parts: Parts, level: FloatArray, shared: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return density (3, b), its part that is white noise (3, b), and derivatives by shared parameters (K, 3, b).

    Args:
        site: the group.
        parts: of the model.
        level: (3,) ln of the noise's density.
        shared: (K,) parameters of the components, then of the low-pass.
    """
    grid, conditions = site.grid_hz, site.spectra.conditions
    bins = len(site.first)
    rows = np.zeros((parts.shared, 3, bins))
    total = np.zeros((3, bins))
    for component, columns in parts.slices:
        total += site.wide(component.density(site.index, conditions, grid, shared[columns]))
        rows[columns] = site.wide(component.derivative(site.index, conditions, grid, shared[columns]))
    noise = np.repeat(np.exp(level)[:, None], bins, axis=1)
    if parts.low_pass:
        gain, slopes = _low_pass_gain(site.grid_hz, shared[parts.filter_at :])
        wide_gain = site.wide(gain)
        rows *= wide_gain
        rows[parts.filter_at :] = (total + noise) * site.wide(slopes)[:, None]
        total, noise = total * wide_gain, noise * wide_gain
    return total + noise, noise, rows


def _low_pass_gain(frequency_hz: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return |H|^2 of the low-pass, (m,), and its derivatives by ln of the corner and by the roll-off, (2, m)."""
    log_ratio = np.log(frequency_hz) - float(parameters[0])
    power = np.exp(np.clip(2.0 * float(parameters[1]) * log_ratio, -300.0, 300.0))
    gain = 1.0 / (1.0 + power)
    gain_slope = power * np.square(gain)
    return gain, np.stack((2.0 * float(parameters[1]) * gain_slope, -2.0 * log_ratio * gain_slope))


def full_density(
    site: Site, parts: Parts, level: FloatArray, shared: FloatArray, included: frozenset[str]
) -> tuple[FloatArray, FloatArray]:
    """Return the density of noise and the components `included`, and its part that is noise, all bins, (3, m)."""
    frequency = site.spectra.frequency_hz
    total = np.zeros((3, len(frequency)))
    for component, columns in parts.slices:
        if component.name in included:
            density = component.density(site.index, site.spectra.conditions, frequency, shared[columns])
            total += through_window(density, len(frequency))
    noise = np.repeat(np.exp(level)[:, None], len(frequency), axis=1)
    if parts.low_pass:
        gain, _ = _low_pass_gain(frequency, shared[parts.filter_at :])
        total, noise = total * gain, noise * gain
    return total + noise, noise
