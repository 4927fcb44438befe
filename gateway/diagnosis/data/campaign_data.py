"""Data of a diagnosis: means of revolutions with their measured scatter, by recording and conditions."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.shown_units import ShownUnits
from gateway.core.types import BoolArray, ComplexArray, FloatArray
from gateway.diagnosis.data.wheel_rates import WheelRate
from gateway.diagnosis.effects.effect import GroupConditions

Remark: TypeAlias = Reason | str
"""A remark on the data: a reason, or text that a user wrote, as in a configuration."""

PROFILE_SIZE: Final = 128
"""Angles of a scatter profile."""


@dataclass(frozen=True, slots=True)
class Block:
    """Mean of revolutions of one group; one fold of it.

    Attributes:
        count: revolutions.
        conditions: their mean; mean squares for omega.
        orders_mps2: (3, ORDERS) coefficients c - i s of the mean waveform as measured, gravity and drift included; NaN
            for absent axes and for orders beyond the bandwidth of the sampling.
        as_recorded_mps2: the same without alignment of the contact edges; None where they are not aligned.
    """

    count: int
    conditions: GroupConditions
    orders_mps2: ComplexArray
    as_recorded_mps2: ComplexArray | None = None


@dataclass(frozen=True, slots=True)
class EdgeTiming:
    """Relative jitter of the two contact edges from one contact to the next, in one group.

    The leading edge comes early by b, the trailing edge by a. The mean squares are those of b - a from contact to
    contact.

    Attributes:
        freedom: independent values behind each fold's mean square; empty where it is not known.
        power_rad2: (folds) mean square of b - a, noise included.
        noise_rad2: contribution of noise and of everything away from the edges.
        leading_share: share of the leading edge in the mean square of b - a.
        leading_share_std: one standard error.
        explained_m2ps4: mean square over the revolution due to moving edges, all axes.
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
        """Mean square of b - a beyond noise, at least zero."""
        total = sum(self.freedom)
        if not total > 0.0:
            return 0.0
        mean = sum(f * p for f, p in zip(self.freedom, self.power_rad2, strict=True)) / total
        return max(0.0, mean - self.noise_rad2)

    @property
    def explains(self) -> bool:
        """Whether moving edges explain more of the scatter near them than they leave."""
        return self.left_m2ps4 < self.explained_m2ps4

    def deviances(self, scatter_rad2: float) -> tuple[float, ...]:
        """Return for every fold -2 ln likelihood of normal scatter of a mean square, up to a constant of the data."""
        expected = self.noise_rad2 + scatter_rad2
        return tuple(
            f * (math.log(expected) + p / expected) if f > 0.0 else 0.0
            for f, p in zip(self.freedom, self.power_rad2, strict=True)
        )

    @property
    def chi2(self) -> float:
        """Decrease of the deviance when jitter is included."""
        if not (self.freedom and self.noise_rad2 > 0.0):
            return 0.0
        return sum(self.deviances(0.0)) - sum(self.deviances(self.scatter_rad2))


@dataclass(frozen=True, slots=True)
class AngleScatter:
    """Power of single revolutions' deviations from their mean, in equal cells of angle from -pi.

    Attributes:
        power_m2ps4: (3, cells) mean over revolutions.
        successive_m2ps4: (3, cells) half the mean square of the difference of a revolution and the next one: as much as
            the power where each has another waveform, less where they change slowly or in a step.
        alternating_m2ps4: (3, cells) mean square of the difference of odd and even revolutions, on a scale on which
            noise has the same power.
        freedom: (3,) independent complex values of one cell of one revolution; 0 for absent axes.
        count: revolutions.
        at_limit: (3, cells) where the signal stays at the end of the sensor's range, which hides all scatter.
    """

    power_m2ps4: FloatArray
    successive_m2ps4: FloatArray
    alternating_m2ps4: FloatArray
    freedom: FloatArray
    count: int
    at_limit: BoolArray


@dataclass(frozen=True, slots=True)
class Repeats:
    """Samples that repeat the one before on all axes more often than by chance.

    Attributes:
        runs: stretches of three or more equal samples.
        samples: samples that repeat the one before, in these.
        total: samples.
        error_mps2: (3,) root mean square of the error over all samples, by the step to the next sound one.
    """

    runs: int
    samples: int
    total: int
    error_mps2: tuple[float, float, float]


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
        scatter_profile: (3, PROFILE_SIZE) power of that scatter over the angle from -pi, mean 1; None where it is even.
        half_angle_rad: of the contact as the pipeline saw it.
        load_known: False where the load is assumed.
        pressure_known: False where the pressure is assumed.
        declared_offset_m: sensor below the neutral layer, as configured, or measured.
        declared_roll_rad: as configured (positive: the radial axis leaks into +lateral).
        declared_pitch_rad: as configured (positive: it leaks into +circumferential).
        deviations_mps2: for every uninterrupted run of revolutions: (3, k) the signal minus the group's mean waveform
            (scaled with omega^2 if the speed drifts), uniformly sampled in time; NaN rows for absent axes.
        deviation_rate_hz: its rate.
        edges: jitter of the contact's edges; blocks and deviations are corrected for it where it is evident.
        edge_errors_mps2: (m, 3, ORDERS) changes of the group's mean by one standard error of its mean edge angles each,
            independent; NaN as in `Block`; None where the edges do not jitter.
        by_angle: power of the deviations by angle; None for too few revolutions.
        repeats: repeated samples of the group's recording; None without.
        step_mps2: of the sensor's converter by axis; 0 where it is not known.
        rates: of the wheel, in the group's recording; revolutions are without those that it shows.
        sensor_doubted: True where the pipeline raised an alarm about the sensor that makes every shape doubtful.
    """

    label: Remark
    recording: int
    state: int
    conditions: GroupConditions
    blocks: tuple[Block, ...]
    variance: FloatArray
    half_angle_rad: float
    scatter_profile: FloatArray | None = None
    load_known: bool = True
    pressure_known: bool = True
    declared_offset_m: float = 0.0
    declared_roll_rad: float = 0.0
    declared_pitch_rad: float = 0.0
    deviations_mps2: tuple[FloatArray, ...] = ()
    deviation_rate_hz: float = 0.0
    edges: EdgeTiming = EdgeTiming()
    edge_errors_mps2: ComplexArray | None = None
    by_angle: AngleScatter | None = None
    repeats: Repeats | None = None
    step_mps2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rates: tuple[WheelRate, ...] = ()
    sensor_doubted: bool = False

    @property
    def revolutions(self) -> int:
        """Number of revolutions in its blocks."""
        return sum(block.count for block in self.blocks)

    @property
    def counts(self) -> FloatArray:
        """Number of revolutions in each of its blocks, (blocks,)."""
        return np.array([block.count for block in self.blocks], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Campaign:
    """Data of all recordings of one wheel.

    Attributes:
        wheel: position.
        recordings: names.
        groups: in the order of recordings and time.
        states: number of tire states.
        rejected: number of rejected revolutions by reason.
        clock_error: relative error of the hub's clock against the host's, positive if fast, and its standard error; NaN
            if unknown.
        assumed: inputs that were assumed.
        notes: limitations of the recordings: damage, groups left out.
        sensor_id: serial number of the sensor, None if unknown or not the same in all recordings.
        stated: inputs that were stated or measured, with their source.
        vehicle: name of the vehicle or test rig, empty if unknown or not the same in all recordings.
        tire: size of the tire, likewise.
        units: that screens show.
        times_s: host times of the first and the last revolution used of each recording, 0 where none is.
    """

    wheel: str
    recordings: tuple[str, ...]
    groups: tuple[Group, ...]
    states: int
    rejected: Mapping[Reason, int]
    clock_error: tuple[float, float] = (float("nan"), float("nan"))
    assumed: tuple[Remark, ...] = ()
    notes: tuple[Reason, ...] = ()
    sensor_id: int | None = None
    stated: tuple[Reason, ...] = ()
    vehicle: str = ""
    tire: str = ""
    units: ShownUnits = ShownUnits.SI
    times_s: tuple[tuple[float, float], ...] = ()

    @property
    def folds(self) -> int:
        """Number of folds: the most blocks that any group has."""
        return max(len(group.blocks) for group in self.groups)

    @property
    def revolutions(self) -> int:
        """Number of revolutions in all groups."""
        return sum(group.revolutions for group in self.groups)
