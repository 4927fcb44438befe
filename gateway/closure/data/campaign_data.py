"""Data of a diagnosis: means of revolutions with their measured scatter, by recording and conditions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

from gateway.closure.effects.effect import GroupConditions
from gateway.reasons import Reason
from gateway.types import ComplexArray, FloatArray

Remark: TypeAlias = Reason | str
"""A remark on the data: a reason, or text that a user wrote, as in a configuration."""

ORDERS: Final = 111
"""Orders 0 to 110 are compared: on a measured tire nothing above repeats."""


@dataclass(frozen=True, slots=True)
class Block:
    """Mean of revolutions of one group; one fold of it.

    Attributes:
        count: revolutions.
        conditions: their mean; mean squares for omega.
        orders_mps2: (3, ORDERS) coefficients c - i s of the mean waveform as measured (gravity, drift and all); NaN for
            absent axes and for orders that the sampling does not carry.
    """

    count: int
    conditions: GroupConditions
    orders_mps2: ComplexArray


@dataclass(frozen=True, slots=True)
class EdgeTiming:
    """Relative jitter of the two contact edges from one contact to the next, in one group.

    The leading edge comes early by b, the trailing edge by a. The mean squares are those of b - a from contact to
    contact.

    Attributes:
        freedom: independent values behind each fold's mean square; empty where it is not known.
        power_rad2: (folds) mean square of b - a, what noise makes included.
        noise_rad2: what noise and all that is not at the edges makes of it.
        leading_share: of the leading edge in the mean square of b - a.
        leading_share_std: one standard error.
        explained_m2ps4: mean square over the revolution that moving edges make, all axes.
        left_m2ps4: mean square of the residual near the corrected edges.
    """

    freedom: tuple[float, ...] = ()
    power_rad2: tuple[float, ...] = ()
    noise_rad2: float = 0.0
    leading_share: float = 0.5
    leading_share_std: float = 0.5
    explained_m2ps4: float = 0.0
    left_m2ps4: float = 0.0

    @property
    def scatter_rad2(self) -> float:
        """Mean square of b - a beyond what noise makes, not below zero."""
        total = sum(self.freedom)
        if not total > 0.0:
            return 0.0
        mean = sum(f * p for f, p in zip(self.freedom, self.power_rad2, strict=True)) / total
        return max(0.0, mean - self.noise_rad2)

    def deviances(self, scatter_rad2: float) -> tuple[float, ...]:
        """Return for every fold -2 ln likelihood of normal scatter of a mean square, up to a constant of the data."""
        expected = self.noise_rad2 + scatter_rad2
        return tuple(
            f * (math.log(expected) + p / expected) if f > 0.0 else 0.0
            for f, p in zip(self.freedom, self.power_rad2, strict=True)
        )

    @property
    def chi2(self) -> float:
        """Fall of the deviance that scatter brings."""
        if not (self.freedom and self.noise_rad2 > 0.0):
            return 0.0
        return sum(self.deviances(0.0)) - sum(self.deviances(self.scatter_rad2))


@dataclass(frozen=True, slots=True)
class Group:
    """Revolutions of one recording under one set of conditions (speed within 3 %).

    Attributes:
        label: for the user.
        recording: index.
        state: index of the tire's state (load and pressure); the ring's numbers are the state's own.
        conditions: mean over all of its revolutions.
        blocks: one a fold.
        variance: (3, ORDERS) (m/s^2)^2 of one real coefficient of one revolution, by scatter; NaN as in `Block`.
        half_angle_rad: of the contact as the pipeline saw it.
        load_known: False where the load is assumed.
        pressure_known: False where the pressure is assumed.
        declared_offset_m: sensor below the neutral layer, as configured.
        declared_roll_rad: as configured (positive: the radial axis leaks into +lateral).
        declared_pitch_rad: as configured (positive: it leaks into +circumferential).
        deviations_mps2: for every uninterrupted run of revolutions: (3, k) what is left when the group's mean waveform
            (scaled with omega^2 where the speed drifts) is taken off, evenly sampled in time; NaN rows for absent axes.
        deviation_rate_hz: its rate.
        edges: how the contact's edges move; blocks and deviations have them put back where that is evident.
    """

    label: str
    recording: int
    state: int
    conditions: GroupConditions
    blocks: tuple[Block, ...]
    variance: FloatArray
    half_angle_rad: float
    load_known: bool = True
    pressure_known: bool = True
    declared_offset_m: float = 0.0
    declared_roll_rad: float = 0.0
    declared_pitch_rad: float = 0.0
    deviations_mps2: tuple[FloatArray, ...] = ()
    deviation_rate_hz: float = 0.0
    edges: EdgeTiming = EdgeTiming()


@dataclass(frozen=True, slots=True)
class Campaign:
    """All that one wheel's recordings hold.

    Attributes:
        wheel: position.
        recordings: names.
        groups: in the order of recordings and time.
        states: number of tire states.
        rejected: revolutions left out, and why: reason -> count.
        clock_error: share by which the hub's clock runs fast against the host's, and its standard error; NaN unknown.
        assumed: inputs that were assumed.
        notes: limitations of the recordings: damage, groups left out.
        sensor_id: serial number of the sensor, None when not known or the recordings are of different ones.
        stated: inputs that were stated or measured, with their source.
    """

    wheel: str
    recordings: tuple[str, ...]
    groups: tuple[Group, ...]
    states: int
    rejected: Mapping[Reason, int]
    clock_error: tuple[float, float] = (float("nan"), float("nan"))
    assumed: tuple[Remark, ...] = ()
    notes: tuple[Remark, ...] = ()
    sensor_id: int | None = None
    stated: tuple[Remark, ...] = ()

    @property
    def folds(self) -> int:
        """Number of folds: the most blocks that any group has."""
        return max(len(group.blocks) for group in self.groups)
