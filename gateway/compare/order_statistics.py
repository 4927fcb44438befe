"""Order spectra of many revolutions: mean amplitudes, amplitudes against speed, and the power on integer orders."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from gateway.core.revolutions.angle_resampling import GRID_SIZE
from gateway.core.revolutions.order_spectrum import ORDER_COUNT, order_coefficients
from gateway.core.types import ComplexArray, FloatArray, IntArray

BLOCK_REVOLUTIONS: Final = 8
"""Consecutive revolutions of one fine spectrum; its resolution is 1/8 order."""
# A recording without a block has one spectrum of its longest run of revolutions, if that is at least half a block.
_LEAST_REVOLUTIONS: Final = BLOCK_REVOLUTIONS // 2
_AXES: Final = 3
# Largest change of the speed within a block: beyond it, lines of the time axis smear over orders.
_MAX_SPEED_RATIO: Final = 1.1
_MOST_SPEEDS: Final = 200


@dataclass(frozen=True, slots=True)
class SpeedBin:
    """Amplitudes and spectra of the revolutions in a range of speeds.

    Attributes:
        low_radps: lower end of the angular speed.
        high_radps: upper end.
        revolutions: number of revolutions.
        amplitude_mps2: (3, 61) root mean square of the amplitude of each order; NaN where no revolution carries it.
        blocks: number of blocks whose median speed lies in the range.
        blocks_by_order: (m,) number of them that carry each order of `fine_mps2`.
        fine_mps2: (3, m) as in `OrderStatistics`, of these blocks.
        integer_share: (3,) as in `OrderStatistics`, of these blocks; NaN without one.
        integer_share_std: (3,) one standard error; NaN for less than two blocks.
    """

    low_radps: float
    high_radps: float
    revolutions: int
    amplitude_mps2: FloatArray
    blocks: int
    blocks_by_order: IntArray
    fine_mps2: FloatArray
    integer_share: FloatArray
    integer_share_std: FloatArray


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
        blocks: number of blocks of consecutive revolutions; fine spectra rest on them.
        block_revolutions: k, revolutions of a block: BLOCK_REVOLUTIONS, or fewer where the only block is a shorter run.
        fine_order: (61 k,) orders in steps of 1/k.
        fine_mps2: (3, 61 k) root mean square amplitude over the blocks; NaN without a block.
        integer_share: (3,) share of the power above order 0 that lies on integer orders, mean over the blocks. White
            noise alone has 1/k.
        integer_share_std: (3,) one standard error; NaN for a single block.
        block_mps2: (3, k n) the first block in the order of time, from the middle of a contact on; (3, 0) without one.
    """

    revolutions: int
    omega_range_radps: tuple[float, float]
    amplitude_mps2: FloatArray
    repeated_mps2: FloatArray
    speeds: tuple[SpeedBin, ...]
    blocks: int
    block_revolutions: int
    fine_order: FloatArray
    fine_mps2: FloatArray
    integer_share: FloatArray
    integer_share_std: FloatArray
    block_mps2: FloatArray

    @property
    def noise_share(self) -> float:
        """Share of the power of white noise on integer orders."""
        return 1.0 / self.block_revolutions


class _Squares:
    """Mean squares of amplitudes that are not all known."""

    def __init__(self, size: int) -> None:
        self._sum: FloatArray = np.zeros((_AXES, size))
        self.count: IntArray = np.zeros((_AXES, size), np.intp)
        self.added = 0

    def add(self, amplitude_mps2: FloatArray) -> None:
        finite = np.isfinite(amplitude_mps2)
        self._sum += np.where(finite, np.square(amplitude_mps2), 0.0)
        self.count += finite
        self.added += 1

    def root(self) -> FloatArray:
        mean = np.full(self._sum.shape, math.nan)
        np.divide(self._sum, self.count, out=mean, where=self.count > 0)
        result: FloatArray = np.sqrt(mean)
        return result


class _Spectra:
    """Spectra of blocks of `revolutions` revolutions and their power on integer orders."""

    def __init__(self, revolutions: int = BLOCK_REVOLUTIONS) -> None:
        self.revolutions = revolutions
        self.squares = _Squares(revolutions * ORDER_COUNT)
        self._shares: list[FloatArray] = []

    @property
    def blocks(self) -> int:
        return len(self._shares)

    def add(self, amplitude_mps2: FloatArray) -> None:
        """Add a block: (3, revolutions * 61) amplitudes, NaN above the highest order."""
        self.squares.add(amplitude_mps2)
        power = np.nan_to_num(np.square(amplitude_mps2))
        on_integers = power[:, self.revolutions :: self.revolutions].sum(axis=1)
        total = power[:, 1:].sum(axis=1)
        self._shares.append(np.where(total > 0.0, on_integers / np.where(total > 0.0, total, 1.0), math.nan))

    def share(self) -> tuple[FloatArray, FloatArray]:
        """Return the share of the power on integer orders and its standard error, (3,) each."""
        shares = np.array(self._shares).reshape(-1, _AXES)
        share, std = np.full(_AXES, math.nan), np.full(_AXES, math.nan)
        if len(shares):
            share = shares.mean(axis=0)
        if len(shares) > 1:
            std = shares.std(axis=0, ddof=1) / math.sqrt(len(shares))
        return share, std


class _Turn(NamedTuple):
    """A revolution of a block: its axes in the order of time, its angular speed and its highest order."""

    axes_mps2: FloatArray
    omega_radps: float
    order_max: int


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
        self._totals = _Squares(ORDER_COUNT)
        self._speeds: dict[int, _Squares] = {}
        self._repeated: ComplexArray = np.zeros((_AXES, ORDER_COUNT), np.complex128)
        self._fourth: FloatArray = np.zeros((_AXES, ORDER_COUNT))
        self._range = (math.inf, -math.inf)
        self._block: list[_Turn] = []
        self._longest_run: list[_Turn] = []
        self._next: int | None = None
        self._fine = _Spectra()
        self._fine_speeds: dict[int, _Spectra] = {}
        self._first_block: FloatArray = np.zeros((_AXES, 0))

    def add(
        self, index: int, axes_mps2: FloatArray, omega_radps: float, order_max: int, *, follows: bool = True
    ) -> None:
        """Add a revolution.

        Args:
            index: its running number; revolutions that follow each other form the blocks of the fine spectra.
            axes_mps2: (3, n) axes on the angle grid; NaN rows for absent axes.
            omega_radps: mean angular speed.
            order_max: highest order that the sampling carries.
            follows: whether it begins with the contact that ended the revolution of the number before.
        """
        orders = order_coefficients(axes_mps2, order_max)
        amplitude: FloatArray = np.abs(orders)
        self._totals.add(amplitude)
        self._speeds.setdefault(self._bin_index(omega_radps), _Squares(ORDER_COUNT)).add(amplitude)
        finite = np.isfinite(amplitude)
        self._repeated += np.where(finite, orders, 0.0) * omega_radps**2
        self._fourth += finite * omega_radps**4
        self._range = min(self._range[0], omega_radps), max(self._range[1], omega_radps)
        if index != self._next or not follows:
            self._end_run()
        self._next = index + 1
        self._add_to_block(axes_mps2, omega_radps, order_max)

    def statistics(self) -> OrderStatistics | None:
        """Return the statistics of the revolutions so far, None without any."""
        if not self._totals.added:
            return None
        # b = sum(c Omega^2) / sum(Omega^4), least squares; its mean square is |b|^2 sum(Omega^4) / count.
        repeated = np.full(self._repeated.shape, math.nan)
        weight = np.sqrt(self._fourth * self._totals.count)
        np.divide(np.abs(self._repeated), weight, out=repeated, where=weight > 0.0)
        fine, fine_speeds, block = self._fine, self._fine_speeds, self._first_block
        if not fine.blocks:
            fine, fine_speeds, block = self._short_spectrum()
        share, share_std = fine.share()
        return OrderStatistics(
            revolutions=self._totals.added,
            omega_range_radps=self._range,
            amplitude_mps2=self._totals.root(),
            repeated_mps2=repeated,
            speeds=tuple(
                self._speed_bin(index, squares, fine_speeds.get(index, _Spectra(fine.revolutions)))
                for index, squares in sorted(self._speeds.items())
            ),
            blocks=fine.blocks,
            block_revolutions=fine.revolutions,
            fine_order=np.arange(fine.revolutions * ORDER_COUNT) / fine.revolutions,
            fine_mps2=fine.squares.root(),
            integer_share=share,
            integer_share_std=share_std,
            block_mps2=block,
        )

    def _bin_index(self, omega_radps: float) -> int:
        return min(int(omega_radps / self._step), _MOST_SPEEDS)

    def _speed_bin(self, index: int, squares: _Squares, spectra: _Spectra) -> SpeedBin:
        share, std = spectra.share()
        return SpeedBin(
            low_radps=index * self._step,
            # The last one holds all that is faster.
            high_radps=max((index + 1) * self._step, self._range[1] if index == _MOST_SPEEDS else 0.0),
            revolutions=squares.added,
            amplitude_mps2=squares.root(),
            blocks=spectra.blocks,
            blocks_by_order=spectra.squares.count.max(axis=0),
            fine_mps2=spectra.squares.root(),
            integer_share=share,
            integer_share_std=std,
        )

    def _add_to_block(self, axes_mps2: FloatArray, omega_radps: float, order_max: int) -> None:
        # In the order of time: a revolution begins at angle 0, in the middle of the grid.
        self._block.append(_Turn(np.roll(axes_mps2, -(GRID_SIZE // 2), axis=1), omega_radps, order_max))
        if len(self._block) < BLOCK_REVOLUTIONS:
            return
        block, self._block = self._block, []
        spectrum = _block_spectrum(block)
        if spectrum is None:
            return
        curve, amplitude = spectrum
        self._fine.add(amplitude)
        self._fine_speeds.setdefault(self._median_bin_index(block), _Spectra()).add(amplitude)
        if not self._first_block.size:
            self._first_block = curve

    def _end_run(self) -> None:
        """Keep a run that ends before it is a block, if it is the longest; not needed after the first block."""
        if not self._fine.blocks and len(self._block) > len(self._longest_run):
            self._longest_run = self._block
        self._block = []

    def _short_spectrum(self) -> tuple[_Spectra, dict[int, _Spectra], FloatArray]:
        """Return the spectrum of the longest run below a block, by speed too, and its curve."""
        run = max(self._longest_run, self._block, key=len)
        spectrum = _block_spectrum(run) if len(run) >= _LEAST_REVOLUTIONS else None
        if spectrum is None:
            return self._fine, self._fine_speeds, self._first_block
        curve, amplitude = spectrum
        spectra = _Spectra(len(run))
        spectra.add(amplitude)
        return spectra, {self._median_bin_index(run): spectra}, curve

    def _median_bin_index(self, block: list[_Turn]) -> int:
        """Return the range of speed of a block; a revolution of it lies there."""
        return self._bin_index(sorted(turn.omega_radps for turn in block)[len(block) // 2])


def _block_spectrum(block: list[_Turn]) -> tuple[FloatArray, FloatArray] | None:
    """Return curve (3, k n) and amplitudes (3, 61 k) of k revolutions; None where the speed changes too much.

    The curve is that at the root mean square speed: a waveform scales with the square of the speed, and without that a
    change of speed would look like noise.
    """
    speeds = np.array([turn.omega_radps for turn in block])
    if speeds.max() > _MAX_SPEED_RATIO * speeds.min():
        return None
    count, mean_square = len(block), float(np.square(speeds).mean())
    curve = np.concatenate([turn.axes_mps2 * (mean_square / turn.omega_radps**2) for turn in block], axis=1)
    amplitude: FloatArray = np.abs(np.fft.rfft(curve, axis=1)[:, : count * ORDER_COUNT]) * (2.0 / curve.shape[1])
    amplitude[:, 0] *= 0.5
    amplitude[:, count * min(turn.order_max for turn in block) + count // 2 + 1 :] = math.nan
    return curve, amplitude
