"""Spectral density of the nonsynchronous signal: sensor noise, edge jitter and effects of the catalogue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.closure.data.campaign_data import Group
from gateway.closure.effects.effect import SpectrumEffect
from gateway.closure.inference.edge_jitter_spectrum import TERMS, edge_jitter_basis
from gateway.closure.inference.nonsynchronous_spectra import GroupSpectra
from gateway.types import FloatArray, IntArray

JITTER: Final = "jitter of the contact's edges"
LOW_PASS: Final = "low-pass behind the sensor"

_HANN: Final = (1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0)
# The signed terms may sum to less than the sensor's noise where they fit badly; the sum is limited to this share.
_LEAST: Final = 0.2


@dataclass(frozen=True, slots=True)
class Parts:
    """Components of a model of the density.

    Attributes:
        effects: effects of the catalogue, in the order of selection.
        jitter: whether the edges jitter.
        low_pass: whether the sensor's noise and all mechanical signals are low-pass filtered.
    """

    effects: tuple[SpectrumEffect, ...] = ()
    jitter: bool = False
    low_pass: bool = False

    @property
    def shared(self) -> int:
        """Number of parameters that all groups share."""
        return sum(len(effect.parameters) for effect in self.effects) + TERMS * self.jitter + self.low_pass


@dataclass(frozen=True, slots=True)
class Site:
    """One group in the form that the model needs.

    Attributes:
        spectra: spectra of the group.
        basis: (TERMS, 3, m) densities of edge jitter.
        floor: (3, m) shape of the noise; 1 where it is white.
        dense: bins below this index are fitted one by one, or nearly so; above, the centre represents a wide bin.
        grid_hz: (q,) frequencies at which effects are evaluated.
        first: (b,) index in `grid_hz` of the first frequency of each wide bin.
    """

    spectra: GroupSpectra
    basis: FloatArray
    floor: FloatArray
    dense: int
    grid_hz: FloatArray
    first: IntArray
    basis_wide: FloatArray
    floor_wide: FloatArray

    @classmethod
    def of(cls, spectra: GroupSpectra, basis: FloatArray, floor: FloatArray | None = None) -> Site:
        """Return the site of a group."""
        if floor is None:
            floor = np.ones((3, len(spectra.frequency_hz)))
        broad = np.flatnonzero(spectra.count >= 10)
        begin = int(broad[0]) if len(broad) else len(spectra.first)
        dense = int(spectra.first[begin]) if begin < len(spectra.first) else len(spectra.frequency_hz)
        centres = spectra.wide(spectra.frequency_hz)[begin:]
        return cls(
            spectra,
            basis,
            floor,
            dense,
            np.concatenate((spectra.frequency_hz[:dense], centres)),
            np.concatenate((spectra.first[:begin], dense + np.arange(len(centres)))).astype(np.intp),
            spectra.wide(basis),
            spectra.wide(floor),
        )

    def wide(self, values: FloatArray) -> FloatArray:
        """Return means over wide bins, (..., b), of values at `grid_hz`, convolved with the spectral window."""
        seen = through_window(values, self.dense)
        count = np.diff(np.append(self.first, len(self.grid_hz)))
        result: FloatArray = np.add.reduceat(seen, self.first, axis=-1) / count
        return result


def sites_of(groups: Sequence[Group], spectra: Sequence[GroupSpectra]) -> tuple[Site, ...]:
    """Return the sites of groups and their spectra."""
    return tuple(
        Site.of(one, edge_jitter_basis(group, one.frequency_hz)) for group, one in zip(groups, spectra, strict=True)
    )


def through_window(density: FloatArray, dense: int) -> FloatArray:
    """Return a density convolved with the Hann window; the first `dense` values belong to neighbouring bins."""
    if dense < 3:
        return density
    seen = density.copy()
    part = density[..., :dense]
    seen[..., 1 : dense - 1] = _HANN[0] * part[..., :-2] + _HANN[1] * part[..., 1:-1] + _HANN[2] * part[..., 2:]
    return seen


def wide_density(
    site: Site, parts: Parts, level: FloatArray, shared: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return density (3, b), its part that is white noise (3, b), and derivatives by shared parameters (K, 3, b).

    Args:
        site: the group.
        parts: of the model.
        level: (3,) ln of the noise's density.
        shared: (K,) parameters of the effects, then of the jitter, then of the low-pass.
    """
    grid = site.grid_hz
    bins = len(site.first)
    rows = np.zeros((parts.shared, 3, bins))
    total = np.zeros((3, bins))
    at = 0
    for effect in parts.effects:
        own = shared[at : at + len(effect.parameters)]
        total += site.wide(effect.density(site.spectra.conditions, grid, own))
        rows[at : at + len(own)] = site.wide(effect.density_derivative(site.spectra.conditions, grid, own))
        at += len(own)
    if parts.jitter:
        total += np.tensordot(shared[at : at + TERMS], site.basis_wide, axes=1)
        rows[at : at + TERMS] = site.basis_wide
        at += TERMS
    noise = np.exp(level)[:, None] * site.floor_wide
    if parts.low_pass:
        # |H|^2 of a two-pole low-pass, parameter q = (1 / corner)^4; 0 without one.
        reach = site.wide(grid**4)
        passed = 1.0 / (1.0 + max(float(shared[at]), 0.0) * reach)
        rows *= passed
        rows[at] = -(total + noise) * reach * np.square(passed)
        total, noise = total * passed, noise * passed
    return np.maximum(total + noise, _LEAST * noise), noise, rows


def full_density(site: Site, parts: Parts, level: FloatArray, shared: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return density and its part that is white noise at all bins, (3, m)."""
    frequency = site.spectra.frequency_hz
    total = np.zeros((3, len(frequency)))
    at = 0
    for effect in parts.effects:
        own = shared[at : at + len(effect.parameters)]
        total += through_window(effect.density(site.spectra.conditions, frequency, own), len(frequency))
        at += len(own)
    if parts.jitter:
        total += np.tensordot(shared[at : at + TERMS], site.basis, axes=1)
        at += TERMS
    noise = np.exp(level)[:, None] * site.floor
    if parts.low_pass:
        passed = 1.0 / (1.0 + max(float(shared[at]), 0.0) * frequency**4)
        total, noise = total * passed, noise * passed
    return np.maximum(total + noise, _LEAST * noise), noise
