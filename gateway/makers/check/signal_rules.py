"""Order, sign and scale of the samples against the wheel's rotation, which they show themselves."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import HUB_ITSELF, Axis, Coupling, Hello, SampleBlock
from gateway.core.constants import AXIS_NAMES, STANDARD_GRAVITY_MPS2
from gateway.core.contacts.missing_revolutions import mistaken_unit, rotation_period_s
from gateway.core.contacts.reasons import ContactCode
from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.makers.check.clauses import Clause, Ledger
from gateway.makers.check.seen_frame import SeenFrame, SourceKey, signed_step, source_name
from gateway.makers.reasons import FirmwareCode

# Length of the stretches without a gap that are looked at: a few revolutions, in which the speed hardly changes.
_WINDOW_S: Final = 1.5
# So many of them, and so many of those that roll, must agree.
_MIN_WINDOWS: Final = 3
_AGREEING_SHARE: Final = 0.8
# No wheel turns faster.
_MIN_PERIOD_S: Final = 0.02
# A wheel that rolls has at least this R Omega^2, and this standard deviation as a share of full scale: neither depends
# on the stated scale, which may be wrong.
_ROLLING_EXPECTED_MPS2: Final = 100.0
_ROLLING_STD_SHARE: Final = 0.003
# Steady value that only a rotation gives an axis.
_ROLLING_MPS2: Final = 30.0
# Ratio of the mean radial value to R Omega^2 that no radius within the usual range of tires explains.
_MIN_SCALE_RATIO: Final = 1.8
_REST_STD_MPS2: Final = 10.0
# Steps from sample to sample are so many times smaller when the counts are read as they were meant.
_ROUGHNESS_RATIO: Final = 4.0
# Ratio of the steady values of two axes from which the larger one is the radial axis: of a tilt it is 2 and less.
_AXIS_RATIO: Final = 3.0
# Blocks that are compared with a new one: a hub has that many buffers, and a loop of recorded samples is longer.
# Counts that one must span, so that rest or saturation is no copy.
_COMPARED_BLOCKS: Final = 8
_MIN_SPAN_COUNTS: Final = 32


class _Stretch:
    """Samples of a wheel without a gap."""

    __slots__ = ("hello", "length", "next_sample", "recent", "rows")

    def __init__(self, hello: Hello) -> None:
        self.hello = hello
        self.next_sample: int | None = None
        self.rows: list[NDArray[np.int16]] = []
        self.length = 0
        # First samples of recent blocks by their bytes.
        self.recent: dict[bytes, int] = {}


class SignalRules:
    """Compares the steady radial value with R Omega^2, Omega from the time after which the signal repeats."""

    def __init__(self, ledger: Ledger, radius_m: float) -> None:
        """Take the belt radius that the ratio refers to."""
        self._ledger = ledger
        self._radius_m = radius_m
        self._stretches: dict[SourceKey, _Stretch] = {}
        # Level and R Omega^2 of every stretch that rolls.
        self._levels: dict[SourceKey, list[tuple[float, float]]] = {}

    def frame(self, seen: SeenFrame) -> None:
        """Take a frame."""
        if seen.wheel == HUB_ITSELF:
            return
        stretch = self._stretches.get(seen.source)
        if isinstance(seen.message, Hello):
            if stretch is None or stretch.hello != seen.message:
                self._judge(seen.source)
                self._stretches[seen.source] = _Stretch(seen.message)
        elif isinstance(seen.message, SampleBlock) and stretch is not None:
            self._samples(seen.source, stretch, seen.message)

    def finish(self) -> None:
        """Judge the stretches that are left."""
        for source in list(self._stretches):
            self._judge(source)
        for source, levels in self._levels.items():
            self._scale(source, np.array(levels))

    def _samples(self, source: SourceKey, stretch: _Stretch, block: SampleBlock) -> None:
        if block.axes != stretch.hello.axes:
            return
        if stretch.next_sample is not None and signed_step(stretch.next_sample, block.first_sample) != 0:
            self._judge(source)
            stretch.rows, stretch.length = [], 0
        stretch.next_sample = block.first_sample + len(block.counts) & 0xFFFF_FFFF
        self._check_copies(source, stretch.recent, block)
        stretch.rows.append(block.counts)
        stretch.length += len(block.counts)
        if stretch.length >= _WINDOW_S * stretch.hello.rate_hz:
            self._judge(source)
            stretch.rows, stretch.length = [], 0

    def _judge(self, source: SourceKey) -> None:
        stretch = self._stretches.get(source)
        if stretch is None or stretch.length < 0.9 * _WINDOW_S * stretch.hello.rate_hz:
            return
        hello = stretch.hello
        axes = [axis for axis in Axis if hello.axes >> axis & 1]
        counts = np.concatenate(stretch.rows).astype(float) - [hello.offset_counts[axis] for axis in axes]
        values = counts * [hello.scale_mps2[axis] for axis in axes]
        self._ledger.check(Clause.BYTE_ORDER)
        if self._ledger.has_failed(Clause.BYTE_ORDER, Clause.COUPLING):
            return
        mean = values.mean(axis=0)
        self._ledger.check(Clause.ROWS)
        if (misread := _misread(stretch.rows)) is not None:
            self._ledger.fail(Clause.ROWS, source_name(source), misread)
            return
        if Axis.RADIAL not in axes:
            self._ledger.leave(Clause.SCALE, Reason(FirmwareCode.CHECK_NOT_DONE, why="no_radial_axis"))
            return
        radial = values[:, axes.index(Axis.RADIAL)]
        self._axes(source, axes, values, counts, hello)
        period_s = self._rolling_period_s(counts[:, axes.index(Axis.RADIAL)], hello)
        if period_s is None:
            self._note_rest(values, mean)
            return
        self._ledger.check(Clause.COUPLING)
        if hello.coupling == Coupling.AC:
            self._ledger.leave(Clause.SCALE, Reason(FirmwareCode.CHECK_NOT_DONE, why="ac_has_no_scale"))
            return
        self._levels.setdefault(source, []).append((abs(float(radial.mean())), self._expected_mps2(period_s)))

    def _expected_mps2(self, period_s: float) -> float:
        return self._radius_m * (2.0 * math.pi / period_s) ** 2

    def _rolling_period_s(self, counts: FloatArray, hello: Hello) -> float | None:
        """Return the time of a revolution by the counts of an axis; None where the wheel does not roll, or slowly."""
        period_s = rotation_period_s(counts, hello.rate_hz)
        if period_s is None or period_s < _MIN_PERIOD_S or self._expected_mps2(period_s) < _ROLLING_EXPECTED_MPS2:
            return None
        return period_s if float(counts.std()) >= _ROLLING_STD_SHARE * hello.saturation_counts else None

    def _check_copies(self, source: SourceKey, recent: dict[bytes, int], block: SampleBlock) -> None:
        """Compare a block with those before it: noise does not repeat."""
        if int(block.counts.max()) - int(block.counts.min()) < _MIN_SPAN_COUNTS:
            return
        content = block.counts.tobytes()
        earlier_sample = recent.pop(content, None)
        if earlier_sample is not None and earlier_sample != block.first_sample:
            values = {"samples": len(block.counts), "first": block.first_sample, "earlier": earlier_sample}
            self._ledger.fail(
                Clause.ONCE, source_name(source), Reason(FirmwareCode.COUNTS_WRONG, how="repeated", **values)
            )
        recent[content] = block.first_sample
        if len(recent) > _COMPARED_BLOCKS:
            del recent[next(iter(recent))]

    def _axes(self, source: SourceKey, axes: list[Axis], values: FloatArray, counts: FloatArray, hello: Hello) -> None:
        """Judge order and sign of the axes of a stretch that rolls, and that none stands."""
        mean = values.mean(axis=0)
        highest = int(np.argmax(np.abs(mean)))
        if self._rolling_period_s(counts[:, highest], hello) is None:
            return
        subject, radial_mps2 = source_name(source), float(mean[axes.index(Axis.RADIAL)])
        for axis in (axis for axis, span in zip(axes, np.ptp(counts, axis=0), strict=True) if span == 0.0):
            reason = Reason(
                FirmwareCode.COUNTS_WRONG,
                how="axis_stands",
                axis=AXIS_NAMES[axis],
                duration_s=len(values) / hello.rate_hz,
            )
            self._ledger.fail(Clause.ROWS, subject, reason)
        # A zero that is wrong moves an axis as much as the rotation does.
        zero_unknown = self._ledger.has_failed(Clause.HELLO_VALUES)
        if hello.coupling == Coupling.AC or zero_unknown or abs(mean[highest]) < _ROLLING_MPS2:
            return
        if abs(mean[highest]) > _AXIS_RATIO * abs(radial_mps2):
            level = {"level_mps2": float(mean[highest]), "radial_mps2": radial_mps2}
            reason = Reason(FirmwareCode.COUNTS_WRONG, how="axes_order", axis=AXIS_NAMES[axes[highest]], **level)
            self._ledger.fail(Clause.ROWS, subject, reason)
        elif radial_mps2 < -_ROLLING_MPS2:
            self._ledger.fail(Clause.ROWS, subject, Reason(ContactCode.RADIAL_OUTWARD, mean_mps2=radial_mps2))

    def _scale(self, source: SourceKey, levels: FloatArray) -> None:
        """Judge the ratios of all stretches, (k, 2) levels and R Omega^2."""
        # Levels from before those were found may be among them.
        if len(levels) < _MIN_WINDOWS or self._ledger.has_failed(Clause.BYTE_ORDER, Clause.COUPLING):
            return
        self._ledger.check(Clause.SCALE, len(levels))
        ratio = levels[:, 0] / levels[:, 1]
        median_index = int(np.argsort(ratio)[len(ratio) // 2])
        if 1.0 / _MIN_SCALE_RATIO < ratio[median_index] < _MIN_SCALE_RATIO:
            return
        agreeing = np.abs(np.log2(ratio / ratio[median_index])) < 0.5
        if agreeing.mean() < _AGREEING_SHARE:
            return
        level_mps2, expected_mps2 = map(float, levels[median_index])
        reason = mistaken_unit(level_mps2, expected_mps2, self._stretches[source].hello.rate_hz) or Reason(
            FirmwareCode.SCALE_OFF_BY_POWER_OF_TWO,
            level_mps2=level_mps2,
            expected_mps2=expected_mps2,
            ratio=float(ratio[median_index]),
            power=round(math.log2(ratio[median_index])),
            radius_m=self._radius_m,
        )
        self._ledger.fail(Clause.SCALE, source_name(source), reason)

    def _note_rest(self, values: FloatArray, mean: FloatArray) -> None:
        if float(values.std(axis=0).max()) < _REST_STD_MPS2 and values.shape[1] == len(Axis):
            gravity_ratio = float(np.linalg.norm(mean)) / STANDARD_GRAVITY_MPS2
            self._ledger.leave(Clause.SCALE, Reason(FirmwareCode.CHECK_NOT_DONE, why="at_rest", share=gravity_ratio))
        else:
            self._ledger.leave(Clause.SCALE, Reason(FirmwareCode.CHECK_NOT_DONE, why="does_not_roll"))
        self._ledger.leave(Clause.COUPLING, Reason(FirmwareCode.CHECK_NOT_DONE, why="does_not_roll"))


def _misread(blocks: list[NDArray[np.int16]]) -> Reason | None:
    """Return how else the counts of blocks are smooth, None where they are as they are."""
    as_sent = _roughness(blocks)
    if _ROUGHNESS_RATIO * _roughness([block ^ np.int16(-0x8000) for block in blocks]) < as_sent:
        return Reason(FirmwareCode.COUNTS_WRONG, how="offset_binary")
    channels = blocks[0].shape[1]
    if channels > 1:
        by_axis = _roughness([block.reshape(channels, -1).T for block in blocks])
        if _ROUGHNESS_RATIO * by_axis < as_sent:
            return Reason(FirmwareCode.COUNTS_WRONG, how="transposed", ratio=as_sent / max(by_axis, 1))
    return None


def _roughness(blocks: list[NDArray[np.int16]]) -> int:
    """Return the sum of the steps from sample to sample within blocks."""
    return sum(int(np.abs(np.diff(block.astype(np.int64), axis=0)).sum()) for block in blocks)
