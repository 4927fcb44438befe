"""Detection limit of an effect in its campaign, from its contribution without noise.

An effect's *strength* is the square root of its chi-square over 25: 1 at the detection limit. For an effect in
proportion to its parameter, the strength is the ratio of its size to the limit.

- Locked to the wheel: the change of the order coefficients of every run's mean revolution, over their noise, after the
  tire's own parameters have taken what they can of it: four numbers and the tread in each state of load and pressure,
  the contact centre in each run.
- Random: twice the expected log likelihood ratio of its spectrum beside that of the noise (Whittle), or, for edges that
  move, of their displacement in each revolution.
- Outside the catalogue: the change of every sample over its noise.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.signal import welch

from closure_rig.bench import Bench, Run
from closure_rig.causes import Locked, cause
from closure_rig.draw import Case, Kind
from closure_rig.exact_sensor import ExactChain
from closure_rig.outside import stranger
from closure_rig.record import SECONDS, fit_case, scenario_of, settling_s
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.simulator.simulated_wheel import WheelSimulator
from gateway.simulator.wheel_plan import wheel_plans

DETECTION_CHI2: Final = 25.0
"""Five standard errors."""

# Only differences of waveforms are used, so a coarser ring than that of the recordings is enough.
_NODES: Final = 1440
# Steps of the tire's numbers and of its tread, relative.
_STEPS: Final = (0.01, 0.01, 0.01, 0.01, 0.05)
# Revolutions at the end that are averaged; filters have settled before.
_TURNS: Final = 4
_SETTLING_TURNS: Final = 4
# Fine enough for a cavity's peak of 4 Hz.
_SEGMENT: Final = 4800
_SEED: Final = 1
# What the detection limits of the tables span, in steps from small to middle, and from middle to large.
_BELOW, _ABOVE = -5.0, 2.5
_CLOSE: Final = 0.03
_MOST_PASSES: Final = 12


def noise_density(bench: Bench) -> FloatArray:
    """Return the sensor's noise on each axis, m/s^2 per sqrt(Hz), (3,)."""
    return np.array(bench.noise_mg_rthz) * 1e-3 * STANDARD_GRAVITY_MPS2


@dataclass(frozen=True, slots=True)
class _Orders:
    """Orders of a run's mean revolution over R omega^2 as measured, and their noise.

    Attributes:
        values: (3, ORDERS).
        std: (3, ORDERS) of one real coefficient.
    """

    values: ComplexArray
    std: FloatArray


class Strength:
    """Strength of what a case contains beyond its bench."""

    def __init__(self, bench: Bench, plain: Case) -> None:
        """Solve the tire without anything undeclared, and with each of its numbers changed.

        Args:
            bench: tire, sensor and runs.
            plain: a case of this bench without anything undeclared.
        """
        self._bench = bench
        self._plain = [_orders(plain, run) for run in bench.runs]
        self._space = self._own_space(plain)

    def _own_space(self, plain: Case) -> FloatArray:
        """Return an orthonormal basis of what the tire's own parameters can take, (coefficients, parameters)."""
        columns = []
        states = list(dict.fromkeys((run.load_n, run.pressure_kpa) for run in self._bench.runs))
        for state in states:
            for position in range(len(_STEPS)):
                case = replace(plain, bench=_stepped(self._bench, position))
                parts = [
                    _orders(case, run) if (run.load_n, run.pressure_kpa) == state else base
                    for run, base in zip(self._bench.runs, self._plain, strict=True)
                ]
                columns.append(self._difference(parts))
        for index, base in enumerate(self._plain):
            turned = replace_at(self._plain, index, _Orders(base.values * (1.0 + 1e-3j * _ORDER), base.std))
            columns.append(self._difference(turned))
        stacked = np.stack(columns, axis=1)
        basis: FloatArray = np.linalg.qr(stacked / np.linalg.norm(stacked, axis=0))[0]
        return basis

    def _difference(self, parts: list[_Orders]) -> FloatArray:
        """Return the whitened change from the plain campaign, (coefficients,)."""
        return np.concatenate(
            [_real((part.values - base.values) / base.std) for part, base in zip(parts, self._plain, strict=True)]
        )

    def contribution(self, case: Case) -> FloatArray:
        """Return what the tire's own parameters leave of a case's locked contribution, whitened, (coefficients,)."""
        change = self._difference([_orders(case, run) for run in case.bench.runs])
        remainder: FloatArray = change - self._space @ (self._space.T @ change)
        return remainder

    def __call__(self, case: Case) -> float:
        """Return the strength of a case with one effect."""
        (name,) = case.order.names
        if case.order.kind is Kind.OUTSIDE:
            chi2 = sum(_samples_chi2(case, run) for run in case.bench.runs)
        elif cause(name).locked is Locked.SPECTRUM:
            chi2 = sum(_spectrum_chi2(case, run) for run in case.bench.runs)
        elif cause(name).locked is Locked.EDGES:
            chi2 = sum(_edges_chi2(case, run) for run in case.bench.runs)
        else:
            remainder = self.contribution(case)
            chi2 = float(remainder @ remainder)
        return math.sqrt(chi2 / DETECTION_CHI2)


def replace_at(parts: list[_Orders], index: int, part: _Orders) -> list[_Orders]:
    """Return a copy of a list with one entry replaced."""
    return [part if position == index else other for position, other in enumerate(parts)]


def size_of(name: str, *, outside: bool, wanted: float, strength: Callable[[float], float]) -> tuple[float, float]:
    """Return the size of an effect that has the wanted strength, and the strength that it has.

    The two differ where no plausible size has that strength; then it is the nearest plausible one.

    Args:
        name: of the effect.
        outside: whether it is outside the catalogue.
        wanted: strength.
        strength: of a size.
    """
    entry = stranger(name) if outside else cause(name)
    sizes, lowest, highest = entry.sizes, entry.lowest, None if outside else cause(name).highest

    def size_at(step: float) -> float:
        small, middle, large = sizes
        if step <= 1.0:
            return small * (middle / small) ** step
        return middle * (large / middle) ** (step - 1.0)

    # Strengths grow with the step. They are almost straight on logarithms, so a secant is close at once; the bracket
    # keeps it safe.
    bottom = _BELOW if lowest is None else math.log(lowest / sizes[0]) / math.log(sizes[1] / sizes[0])
    top = _ABOVE if highest is None else 1.0 + math.log(highest / sizes[1]) / math.log(sizes[2] / sizes[1])
    low, high = bottom, top
    position, best = 0.0, (math.inf, 0.0, 0.0)
    tried: list[tuple[float, float]] = []
    for _ in range(_MOST_PASSES):
        size = size_at(position)
        result = strength(size)
        error = math.log(max(result, 1e-12) / wanted)
        if abs(error) < best[0]:
            best = (abs(error), size, result)
        if (
            abs(error) < _CLOSE
            or high - low < 1e-3
            or (error > 0.0 and position == bottom)
            or (error < 0.0 and position == top)
        ):
            break
        low, high = (low, position) if error > 0.0 else (position, high)
        tried = [*tried, (position, error)][-2:]
        guess = 0.5 * (low + high)
        if len(tried) == 2 and tried[0][1] != tried[1][1]:
            (first, before), (second, after) = tried
            guess = second - after * (second - first) / (after - before)
        elif len(tried) == 1:
            # In proportion to the size, or to its inverse.
            guess = position - error / abs(math.log(sizes[1] / sizes[0]))
        # Never at a point that is known, but at the very ends if it must.
        position = min(max(guess, low + 0.02 * (high - low)), high - 0.02 * (high - low))
        if guess <= bottom and low == bottom:
            position = bottom
        if guess >= top and high == top:
            position = top
    return best[1], best[2]


_ORDER: Final = np.arange(ORDERS)


def _real(values: ComplexArray) -> FloatArray:
    """Return complex coefficients (3, ORDERS) as real ones; order 0 has one each."""
    return np.concatenate([values.real.reshape(-1), values.imag[:, 1:].reshape(-1)])


def _stepped(bench: Bench, stepped: int) -> Bench:
    factor = 1.0 + _STEPS[stepped]
    if stepped == len(bench.numbers):
        return replace(bench, tread_mpa=bench.tread_mpa * factor)
    first, second, third, fourth = (
        number * factor if index == stepped else number for index, number in enumerate(bench.numbers)
    )
    return replace(bench, numbers=(first, second, third, fourth))


def _orders(case: Case, run: Run) -> _Orders:
    """Return the mean revolution of a run without noise, as a user's configuration scales it."""
    bench = case.bench
    radius_m = bench.radius_mm * 1e-3
    # A whole number of samples a turn; the change of speed is below 0.1 %.
    number = round(2.0 * math.pi * radius_m / (run.speed_kmh / 3.6) * bench.rate_hz)
    speed_mps = 2.0 * math.pi * radius_m * bench.rate_hz / number
    # Its clock moves no sample here; it scales the speed as measured.
    clock = float(case.tables.get("hub", {}).get("clock_ppm", 0.0)) * 1e-6
    tables = {name: dict(values) for name, values in case.tables.items() if name != "hub"}
    wheel = _wheel(replace(case, tables=tables), replace(run, speed_kmh=3.6 * speed_mps), 0.0)
    settling = math.ceil(settling_s(case) * bench.rate_hz / number) + _SETTLING_TURNS
    samples = wheel.advance((settling + _TURNS + 0.5) * number / bench.rate_hz).counts
    signal = samples[settling * number : (settling + _TURNS) * number] * np.array(wheel.chain.scale_mps2)
    if run.reverse:
        signal = signal * np.array([-1.0, 1.0, 1.0])
    mean = signal.reshape(_TURNS, number, 3).mean(axis=0)
    spectrum = np.fft.rfft(mean, axis=0)[:ORDERS].T / number
    spectrum[:, 1:] *= 2.0
    spectrum = np.pad(spectrum, ((0, 0), (0, ORDERS - spectrum.shape[1])))
    stated_m = 1e-3 * float(case.tables.get("stated", {}).get("radius_mm", bench.radius_mm))
    level = stated_m * (speed_mps / radius_m / (1.0 + clock)) ** 2
    std = np.tile(noise_density(bench)[:, None] / math.sqrt(SECONDS), (1, ORDERS))
    std[:, 0] *= math.sqrt(0.5)
    return _Orders(spectrum * np.exp(1j * math.pi * _ORDER) / level, std / level)


def _wheel(case: Case, run: Run, drift: float) -> WheelSimulator:
    """Return the wheel of a run with a sensor that neither rounds nor makes noise."""
    scenario = scenario_of(case, run, _SEED, SECONDS, drift=drift, nodes=_NODES)
    (plan,) = wheel_plans(scenario)
    wheel = WheelSimulator(replace(plan, phase_rad=-math.pi), np.random.default_rng(_SEED))
    wheel.chain = ExactChain(plan.sensor, np.random.default_rng(_SEED), plan.defect)
    fit_case(wheel, case, run)
    return wheel


def without(case: Case) -> Case:
    """Return a case with nothing undeclared."""
    return replace(case, tables={}, mirrored=(), per_load=(), disturbance=None, bend=None, fault=None)


def _change(case: Case, run: Run) -> FloatArray:
    """Return the change of every sample of a run, m/s^2, (n, 3)."""
    parts = []
    for each in (case, without(case)):
        wheel = _wheel(each, run, 0.0)
        parts.append(wheel.advance(SECONDS).counts * np.array(wheel.chain.scale_mps2))
    change: FloatArray = parts[0] - parts[1]
    return change


def _samples_chi2(case: Case, run: Run) -> float:
    variance = np.square(noise_density(case.bench)) * (0.5 * case.bench.rate_hz)
    return float(np.sum(np.square(_change(case, run)) / variance))


def _spectrum_chi2(case: Case, run: Run) -> float:
    hz, density = welch(_change(case, run), case.bench.rate_hz, nperseg=_SEGMENT, axis=0)
    ratio = density / np.square(noise_density(case.bench))
    independent = SECONDS * (hz[1] - hz[0])
    return float(2.0 * independent * np.sum(ratio - np.log1p(ratio)))


def _edges_chi2(case: Case, run: Run) -> float:
    variance = np.square(noise_density(case.bench)) * (0.5 * case.bench.rate_hz)
    turns = SECONDS * run.speed_kmh / 3.6 / (2e-3 * math.pi * case.bench.radius_mm)
    power = float(np.sum(np.square(_change(case, run)) / variance)) / turns
    leading, trailing = (float(case.tables["road"][f"{side}_jitter_mm"]) ** 2 for side in ("leading", "trailing"))
    total = leading + trailing
    return turns * sum(x - math.log1p(x) for x in (power * leading / total, power * trailing / total))
