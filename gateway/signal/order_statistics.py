"""Order spectra of many revolutions: mean amplitudes, amplitudes against speed, and the power on integer orders."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.signal.angle_resampling import GRID_SIZE
from gateway.signal.order_spectrum import ORDER_COUNT, order_coefficients
from gateway.types import ComplexArray, FloatArray, IntArray

BLOCK_REVOLUTIONS: Final = 8
"""Consecutive revolutions of one fine spectrum; its resolution is 1/8 order."""
_AXES: Final = 3
_FINE_COUNT: Final = BLOCK_REVOLUTIONS * ORDER_COUNT
# Largest change of the speed within a block: beyond it, lines of the time axis smear over orders.
_MAX_SPEED_RATIO: Final = 1.1
_MOST_SPEEDS: Final = 200


@dataclass(frozen=True, slots=True)
class SpeedBin:
    """Amplitudes of the revolutions in a range of speeds.

    Attributes:
        low_radps: lower end of the angular speed.
        high_radps: upper end.
        revolutions: number of revolutions.
        amplitude_mps2: (3, 61) root mean square of the amplitude of each order; NaN where no revolution carries it.
    """

    low_radps: float
    high_radps: float
    revolutions: int
    amplitude_mps2: FloatArray


@dataclass(frozen=True, slots=True)
class OrderStatistics:
    """Orders of the axes circumferential, lateral and radial, as measured; absent axes are NaN.

    Attributes:
        revolutions: number of revolutions.
        omega_range_radps: lowest and highest mean angular speed of a revolution.
        amplitude_mps2: (3, 61) root mean square over the revolutions of the amplitude of each order; order 0 is the
            mean of the axis.
        repeated_mps2: (3, 61) root mean square of the part that is the same in every revolution but for its scale,
            the square of the angular speed: of the waveform b Omega^2 that fits all coefficients best. At most the
            amplitude.
        speeds: amplitudes by speed, slowest first; ranges without a revolution are left out.
        blocks: number of blocks of BLOCK_REVOLUTIONS consecutive revolutions; fine spectra rest on them.
        fine_order: (488,) orders in steps of 1/8.
        fine_mps2: (3, 488) root mean square amplitude over the blocks; NaN without a block.
        integer_share: (3,) share of the power above order 0 that lies on integer orders, mean over the blocks. White
            noise alone has 1/8.
        integer_share_std: (3,) one standard error; NaN for a single block.
    """

    revolutions: int
    omega_range_radps: tuple[float, float]
    amplitude_mps2: FloatArray
    repeated_mps2: FloatArray
    speeds: tuple[SpeedBin, ...]
    blocks: int
    fine_order: FloatArray
    fine_mps2: FloatArray
    integer_share: FloatArray
    integer_share_std: FloatArray


class _Squares:
    """Mean squares of amplitudes that are not all known."""

    def __init__(self, size: int) -> None:
        self._sum: FloatArray = np.zeros((_AXES, size))
        self.count: IntArray = np.zeros((_AXES, size), np.intp)
        self.added = 0

    def add(self, amplitude_mps2: FloatArray) -> None:
        known = np.isfinite(amplitude_mps2)
        self._sum += np.where(known, np.square(amplitude_mps2), 0.0)
        self.count += known
        self.added += 1

    def root(self) -> FloatArray:
        mean = np.full(self._sum.shape, math.nan)
        np.divide(self._sum, self.count, out=mean, where=self.count > 0)
        result: FloatArray = np.sqrt(mean)
        return result


class OrderAccumulator:
    """Adds revolutions one by one; memory is that of a few revolutions and of the ranges of speed."""

    def __init__(self, speed_step_radps: float) -> None:
        """Start empty.

        Args:
            speed_step_radps: width of the ranges of angular speed.

        Raises:
            ValueError: the width is not positive.
        """
        if not speed_step_radps > 0.0:
            raise ValueError(f"ranges of speed need a positive width, not {speed_step_radps}")
        self._step = speed_step_radps
        self._all = _Squares(ORDER_COUNT)
        self._speeds: dict[int, _Squares] = {}
        self._repeated: ComplexArray = np.zeros((_AXES, ORDER_COUNT), np.complex128)
        self._fourth: FloatArray = np.zeros((_AXES, ORDER_COUNT))
        self._range = (math.inf, -math.inf)
        self._block: list[tuple[FloatArray, float, int]] = []
        self._next: int | None = None
        self._fine = _Squares(_FINE_COUNT)
        self._shares: list[FloatArray] = []

    def add(self, index: int, axes_mps2: FloatArray, omega_radps: float, order_max: int) -> None:
        """Add a revolution.

        Args:
            index: its running number; revolutions that follow each other form the blocks of the fine spectra.
            axes_mps2: (3, n) axes on the angle grid; NaN rows for absent axes.
            omega_radps: mean angular speed.
            order_max: highest order that the sampling carries.
        """
        orders = order_coefficients(axes_mps2, order_max)
        amplitude: FloatArray = np.abs(orders)
        self._all.add(amplitude)
        place = min(int(omega_radps / self._step), _MOST_SPEEDS)
        self._speeds.setdefault(place, _Squares(ORDER_COUNT)).add(amplitude)
        known = np.isfinite(amplitude)
        self._repeated += np.where(known, orders, 0.0) * omega_radps**2
        self._fourth += known * omega_radps**4
        self._range = min(self._range[0], omega_radps), max(self._range[1], omega_radps)
        self._add_to_block(index, axes_mps2, omega_radps, order_max)

    def statistics(self) -> OrderStatistics | None:
        """Return the statistics of the revolutions so far, None without any."""
        if not self._all.added:
            return None
        # b = sum(c Omega^2) / sum(Omega^4), least squares; its mean square is |b|^2 sum(Omega^4) / count.
        repeated = np.full(self._repeated.shape, math.nan)
        weight = np.sqrt(self._fourth * self._all.count)
        np.divide(np.abs(self._repeated), weight, out=repeated, where=weight > 0.0)
        shares = np.array(self._shares).reshape(-1, _AXES)
        share, share_std = np.full(_AXES, math.nan), np.full(_AXES, math.nan)
        if len(shares):
            share = shares.mean(axis=0)
        if len(shares) > 1:
            share_std = shares.std(axis=0, ddof=1) / math.sqrt(len(shares))
        return OrderStatistics(
            revolutions=self._all.added,
            omega_range_radps=self._range,
            amplitude_mps2=self._all.root(),
            repeated_mps2=repeated,
            speeds=tuple(
                SpeedBin(place * self._step, (place + 1) * self._step, squares.added, squares.root())
                for place, squares in sorted(self._speeds.items())
            ),
            blocks=len(shares),
            fine_order=np.arange(_FINE_COUNT) / BLOCK_REVOLUTIONS,
            fine_mps2=self._fine.root(),
            integer_share=share,
            integer_share_std=share_std,
        )

    def _add_to_block(self, index: int, axes_mps2: FloatArray, omega_radps: float, order_max: int) -> None:
        if index != self._next:
            self._block.clear()
        self._next = index + 1
        # In the order of time: a revolution begins at angle 0, in the middle of the grid.
        self._block.append((np.roll(axes_mps2, -(GRID_SIZE // 2), axis=1), omega_radps, order_max))
        if len(self._block) < BLOCK_REVOLUTIONS:
            return
        block, self._block = self._block, []
        speeds = np.array([omega for _, omega, _ in block])
        if speeds.max() > _MAX_SPEED_RATIO * speeds.min():
            return
        # A waveform scales with the square of the speed; without it, a change of speed would look like noise.
        mean_square = float(np.square(speeds).mean())
        curve = np.concatenate([axes * (mean_square / omega**2) for axes, omega, _ in block], axis=1)
        amplitude = np.abs(np.fft.rfft(curve, axis=1)[:, :_FINE_COUNT]) * (2.0 / curve.shape[1])
        amplitude[:, 0] *= 0.5
        end = BLOCK_REVOLUTIONS * min(most for _, _, most in block) + BLOCK_REVOLUTIONS // 2 + 1
        amplitude[:, end:] = math.nan
        self._fine.add(amplitude)
        power = np.square(amplitude[:, :end])
        on_integers = power[:, BLOCK_REVOLUTIONS::BLOCK_REVOLUTIONS].sum(axis=1)
        total = power[:, 1:].sum(axis=1)
        self._shares.append(np.where(total > 0.0, on_integers / np.where(total > 0.0, total, 1.0), math.nan))
