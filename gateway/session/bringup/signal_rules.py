"""Scale of the samples against the wheel's rotation, which they show themselves."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import HUB_ITSELF, Axis, Coupling, Hello, SampleBlock
from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.pipeline.missing_revolutions import rotation_period_s
from gateway.reasons import Code, Reason
from gateway.session.bringup.clauses import Clause, Ledger
from gateway.session.bringup.seen_frame import SeenFrame, SourceKey, signed_step, source_name
from gateway.types import FloatArray

# Length of the stretches without a gap that are looked at: a few revolutions, in which the speed hardly changes.
_WINDOW_S: Final = 1.5
# So many of them, and so many of those that roll, must agree.
_LEAST_WINDOWS: Final = 3
_AGREEING_SHARE: Final = 0.8
# No wheel turns faster.
_LEAST_PERIOD_S: Final = 0.02
_ROLLING_MPS2: Final = 30.0
# Ratio of the mean radial value to R Omega^2 that no radius within the usual range of tires explains.
_LEAST_RATIO: Final = 1.8
_REST_STD_MPS2: Final = 10.0


class _Stretch:
    """Samples of a wheel without a gap."""

    __slots__ = ("hello", "length", "next_sample", "rows")

    def __init__(self, hello: Hello | None) -> None:
        self.hello = hello
        self.next_sample: int | None = None
        self.rows: list[NDArray[np.int16]] = []
        self.length = 0


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
        elif isinstance(seen.message, SampleBlock) and stretch is not None and stretch.hello is not None:
            self._samples(seen.source, stretch, stretch.hello, seen.message)

    def finish(self) -> None:
        """Judge the stretches that are left."""
        for source in list(self._stretches):
            self._judge(source)
        for source, levels in self._levels.items():
            self._scale(source, np.array(levels))

    def _samples(self, source: SourceKey, stretch: _Stretch, hello: Hello, block: SampleBlock) -> None:
        if block.axes != hello.axes:
            return
        if stretch.next_sample is not None and signed_step(stretch.next_sample, block.first_sample) != 0:
            self._judge(source)
            stretch.rows, stretch.length = [], 0
        stretch.next_sample = block.first_sample + len(block.counts) & 0xFFFF_FFFF
        stretch.rows.append(block.counts)
        stretch.length += len(block.counts)
        if stretch.length >= _WINDOW_S * hello.rate_hz:
            self._judge(source)
            stretch.rows, stretch.length = [], 0

    def _judge(self, source: SourceKey) -> None:
        stretch = self._stretches.get(source)
        if stretch is None or stretch.hello is None or stretch.length < 0.9 * _WINDOW_S * stretch.hello.rate_hz:
            return
        hello = stretch.hello
        axes = [axis for axis in Axis if hello.axes >> axis & 1]
        counts = np.concatenate(stretch.rows).astype(float) - [hello.offset_counts[axis] for axis in axes]
        values = counts * [hello.scale_mps2[axis] for axis in axes]
        self._ledger.check(Clause.BYTE_ORDER)
        if self._ledger.has_failed(Clause.BYTE_ORDER, Clause.COUPLING):
            return
        mean = values.mean(axis=0)
        if Axis.RADIAL not in axes:
            self._ledger.leave(Clause.SCALE, Reason(Code.CHECK_NO_RADIAL_AXIS))
            return
        radial = values[:, axes.index(Axis.RADIAL)]
        period_s = rotation_period_s(radial, hello.rate_hz)
        if period_s is None or period_s < _LEAST_PERIOD_S or float(radial.std()) < _ROLLING_MPS2:
            self._at_rest(values, mean)
            return
        self._ledger.check(Clause.COUPLING)
        if hello.coupling == Coupling.AC:
            self._ledger.leave(Clause.SCALE, Reason(Code.CHECK_AC_HAS_NO_SCALE))
            return
        expected = self._radius_m * (2.0 * math.pi / period_s) ** 2
        self._levels.setdefault(source, []).append((abs(float(radial.mean())), expected))

    def _scale(self, source: SourceKey, levels: FloatArray) -> None:
        """Judge the ratios of all stretches, (k, 2) levels and R Omega^2."""
        # Levels from before those were found may be among them.
        if len(levels) < _LEAST_WINDOWS or self._ledger.has_failed(Clause.BYTE_ORDER, Clause.COUPLING):
            return
        self._ledger.check(Clause.SCALE, len(levels))
        ratio = levels[:, 0] / levels[:, 1]
        middle = int(np.argsort(ratio)[len(ratio) // 2])
        if 1.0 / _LEAST_RATIO < ratio[middle] < _LEAST_RATIO:
            return
        alike = np.abs(np.log2(ratio / ratio[middle])) < 0.5
        if alike.mean() < _AGREEING_SHARE:
            return
        reason = Reason(
            Code.SCALE_OFF_BY_POWER_OF_TWO,
            level_mps2=float(levels[middle, 0]),
            expected_mps2=float(levels[middle, 1]),
            ratio=float(ratio[middle]),
            power=round(math.log2(ratio[middle])),
            radius_m=self._radius_m,
        )
        self._ledger.fail(Clause.SCALE, source_name(source), reason)

    def _at_rest(self, values: FloatArray, mean: FloatArray) -> None:
        if float(values.std(axis=0).max()) < _REST_STD_MPS2 and values.shape[1] == len(Axis):
            share = float(np.linalg.norm(mean)) / STANDARD_GRAVITY_MPS2
            self._ledger.leave(Clause.SCALE, Reason(Code.CHECK_AT_REST, share=share))
        else:
            self._ledger.leave(Clause.SCALE, Reason(Code.CHECK_DOES_NOT_ROLL))
        self._ledger.leave(Clause.COUPLING, Reason(Code.CHECK_DOES_NOT_ROLL))
