"""Radial signals of rolling wheels by independent formulas, with faults, and a comparison of the contacts found.

No formula is shared with the gateway. The shape is a linear ring's series under a random pressure, edges with
overshoots and wave packets, or the measured inner liner stretched to another contact. Motion, gravity, road, sensor and
link are added to it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, lfilter_zi

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.contacts.segmenter import ContactPair, Segmenter
from gateway.core.types import FloatArray

Speed = Callable[[FloatArray], FloatArray]

BLOCK = 36
GRID = 4096
THETA = -np.pi + 2.0 * np.pi * np.arange(GRID) / GRID
MEASURED = Path(__file__).parents[2] / ".." / "shared" / "measured" / "innerliner_drum_80kmh.csv"


@dataclass
class Case:
    """A wheel, its motion, its sensor and its link."""

    kmh: float | Speed = 65.0
    duration_s: float = 4.0
    rate_hz: float = 9600.0
    radius_m: float = 0.32
    half_rad: float = 0.24
    shape: str = "ring"
    density_mg: float = 5.0
    road_mps2: float = 0.0
    impacts_per_s: float = 0.0
    highpass_hz: float = 0.0
    highpass_order: int = 1
    lowpass_hz: float = 0.0
    offset_g: float = 0.0
    gain: float = 1.0
    sign: int = 1
    range_g: float = 2000.0
    loss: float = 0.0
    burst: float = 0.0
    frozen_s: tuple[float, float] | None = None
    seed: int = 0


@dataclass
class Signal:
    """Samples and truth: sample numbers of the contacts, speed in m/s and material angle at every sample."""

    case: Case
    radial_mps2: FloatArray
    contacts: FloatArray
    speed_mps: FloatArray
    theta_rad: FloatArray
    lost: NDArray[np.bool_]


def ring_shape(rng: np.random.Generator, half: float) -> FloatArray:
    """Linear ring under a pressure between uniform and parabolic, scaled so that the contact's middle is flat."""
    n = np.arange(2, 121)
    bending, tension, radial, tangential = np.exp(rng.uniform(-0.7, 0.7, 4)) * (3.1e-3, 0.195, 3.0, 2.5)
    stiffness = n**2 * (n**2 - 1.0) * (bending * (n**2 - 1.0) + tension) + radial * n**2 + tangential
    x = np.linspace(-half, half, 401)
    share = rng.uniform(0.0, 1.0)
    push = (1.5 * share * (1.0 - (x / half) ** 2) + 1.0 - share) * (1.0 + rng.uniform(-0.3, 0.3) * x / half)
    load = (np.exp(-1j * np.outer(n, x)) * push * np.cos(x)).sum(axis=1)
    bent = -((n**2 - 1.0) * n**2 / stiffness * load) @ np.exp(1j * np.outer(n, THETA))
    depth = -bent.real[np.abs(THETA) < 0.5 * half].mean()
    result: FloatArray = 1.0 + bent.real / depth * rng.uniform(0.95, 1.05)
    return result


def packet_shape(rng: np.random.Generator, half: float) -> FloatArray:
    """Steep edges of different width, overshoots up to twice the baseline, wave packets running out of both."""
    steep = rng.uniform(0.08, 0.35, 2) * half / 2.2
    inside = 1.0 / (1.0 + np.exp(np.clip(-(THETA + half) / steep[0], -60, 60)))
    inside -= 1.0 / (1.0 + np.exp(np.clip(-(THETA - half) / steep[1], -60, 60)))
    shape = 1.0 - inside * (1.0 - rng.uniform(-0.12, 0.12))
    strong = rng.uniform(0.0, 1.0)
    for side in (-1.0, 1.0):
        beyond = side * THETA - half
        ramp = (beyond > -0.5 * half) * np.clip(beyond / (0.15 * half) + 0.3, 0.0, 1.0)
        beyond = np.clip(beyond, 0.0, None)
        over = rng.uniform(0.05, 0.3) + strong * rng.uniform(0.1, 0.6)
        shape += ramp * over * np.exp(-beyond / rng.uniform(0.12, 0.5)) * np.cos(rng.uniform(0.0, 3.0) * beyond)
        packet = strong * rng.uniform(0.0, 0.35)
        phase = rng.uniform(30.0, 95.0) * beyond + rng.uniform(0.0, 2.0 * np.pi)
        shape += ramp * packet * np.exp(-beyond / rng.uniform(0.2, 0.8)) * np.cos(phase)
    # The mean curvature of a closed belt is 1 / R.
    free = 1.0 - inside
    result: FloatArray = shape + (1.0 - shape.mean()) * free / free.mean()
    return result


@cache
def measured_revolutions() -> FloatArray:
    """Revolutions of the measured inner liner, (k, GRID) from contact to contact, baseline 1 and contact 0."""
    z = np.loadtxt(MEASURED, delimiter=",", skiprows=1)[:, 3]
    change = np.flatnonzero(np.diff((z < -76.0).astype(int)))
    rises = [int(i) for i in change if z[i] < -76.0]
    falls = [int(i) for i in change if z[i] >= -76.0]
    contacts = [(i, min(j for j in rises if j > i)) for i in falls if any(j > i for j in rises)]
    middles = [j - 66 for i, j in contacts if j - i > 90]
    share = np.arange(GRID) / GRID
    shape = (z + 152.7) / 152.7
    return np.array([np.interp(a + share * (b - a), np.arange(len(z)), shape) for a, b in pairwise(middles)])


def _measured_at(theta: FloatArray, half: float, rng: np.random.Generator) -> FloatArray:
    """Return the measured tire at every angle, stretched to another contact; each turn is a different revolution."""
    revolutions, own_half = measured_revolutions(), np.radians(20.9 / 2.0)
    turn = np.floor(theta / (2.0 * np.pi)).astype(int)
    angle = theta - turn * 2.0 * np.pi
    angle = np.where(angle > np.pi, angle - 2.0 * np.pi, angle)
    angle = np.sign(angle) * np.interp(np.abs(angle), [0.0, half, np.pi], [0.0, own_half, np.pi])
    position = np.where(angle < 0.0, angle + 2.0 * np.pi, angle) / (2.0 * np.pi) * GRID
    low = np.clip(position.astype(int), 0, GRID - 2)
    which = rng.integers(0, len(revolutions), int(turn.max() - turn.min()) + 1)[turn - turn.min()]
    share = np.clip(position - low, 0.0, 1.0)
    result: FloatArray = revolutions[which, low] * (1.0 - share) + revolutions[which, low + 1] * share
    return result


def make_signal(case: Case) -> Signal:
    """Roll the wheel."""
    rng = np.random.default_rng(case.seed)
    n = round(case.duration_s * case.rate_hz)
    t = np.arange(n) / case.rate_hz
    speed = (case.kmh(t) if callable(case.kmh) else np.full(n, case.kmh)) / 3.6
    omega = speed / case.radius_m
    theta = rng.uniform(0.0, 2.0 * np.pi) + np.concatenate(([0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]))))
    theta = theta[0] + (theta - theta[0]) / case.rate_hz
    wrapped = (theta + np.pi) % (2.0 * np.pi) - np.pi
    if case.shape == "measured":
        shape = _measured_at(theta, case.half_rad, rng)
    else:
        make = ring_shape if case.shape == "ring" else packet_shape
        shape = np.interp(wrapped, THETA, make(rng, case.half_rad), period=2.0 * np.pi)
    radial = omega**2 * case.radius_m * shape
    radial += STANDARD_GRAVITY_MPS2 * np.where(np.abs(wrapped) < case.half_rad, 1.0, np.cos(wrapped))
    radial = _sensed(radial + _road(case, t, speed, rng), case, rng)
    lost = _lost(case, n, rng)
    if lost.any():
        radial[lost] = np.interp(np.flatnonzero(lost), np.flatnonzero(~lost), radial[~lost])
    turns = np.floor(theta / (2.0 * np.pi))
    crossings = np.flatnonzero(np.diff(turns))
    target = 2.0 * np.pi * np.maximum(turns[crossings], turns[crossings + 1])
    contacts = crossings + (target - theta[crossings]) / (theta[crossings + 1] - theta[crossings])
    return Signal(case, radial, contacts, speed, theta, lost)


def _road(case: Case, t: FloatArray, speed: FloatArray, rng: np.random.Generator) -> FloatArray:
    road = np.zeros(len(t))
    if case.road_mps2:
        spectrum = np.fft.rfft(rng.standard_normal(len(t)))
        spectrum[np.fft.rfftfreq(len(t), 1.0 / case.rate_hz) > 500.0] = 0.0
        rough = np.fft.irfft(spectrum, len(t))
        road += rough * case.road_mps2 / rough.std() * np.minimum(1.0, np.abs(speed) / 2.0)
    for _ in range(round(case.impacts_per_s * case.duration_s)):
        height = rng.uniform(500.0, 3000.0) * rng.choice((-1.0, 1.0))
        length, start = rng.uniform(0.001, 0.01), rng.uniform(0.0, case.duration_s)
        hit = (t >= start) & (t < start + length)
        if hit.any() and abs(speed[hit][0]) > 2.0:
            road[hit] += height * np.sin(np.pi * (t[hit] - start) / length)
    return road


def _sensed(radial: FloatArray, case: Case, rng: np.random.Generator) -> FloatArray:
    radial = radial * case.gain + case.offset_g * STANDARD_GRAVITY_MPS2
    if case.lowpass_hz:
        radial = lfilter(*butter(1, min(case.lowpass_hz, 0.45 * case.rate_hz), fs=case.rate_hz), radial)
    noise = case.density_mg * 1e-3 * STANDARD_GRAVITY_MPS2 * np.sqrt(0.5 * case.rate_hz)
    radial = radial + noise * rng.standard_normal(len(radial))
    if case.highpass_hz:
        b, a = butter(case.highpass_order, case.highpass_hz, "high", fs=case.rate_hz)
        radial, _ = lfilter(b, a, radial, zi=lfilter_zi(b, a) * radial[0] * rng.uniform(0.0, 1.0))
    limit = case.range_g * STANDARD_GRAVITY_MPS2
    step = limit / 2**15
    radial = np.clip(np.round(radial / step) * step, -limit, limit - step) * case.sign
    if case.frozen_s is not None:
        first, end = (round(edge * case.rate_hz) for edge in case.frozen_s)
        radial[first:end] = radial[first]
    return radial


def _lost(case: Case, n: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    lost = np.zeros(n, bool)
    for block in range(1, n // BLOCK - 1):
        if rng.random() < case.loss:
            lost[block * BLOCK : (block + 1) * BLOCK] = True
        if rng.random() < case.burst:
            lost[block * BLOCK : min(block + int(rng.integers(2, 13)), n // BLOCK - 1) * BLOCK] = True
    return lost


def segment(signal: Signal, chunk: int | None = None) -> tuple[list[ContactPair], Segmenter]:
    """Run the segmenter over a signal, all at once or in chunks."""
    radial = signal.radial_mps2
    lost = np.concatenate(([0], np.cumsum(signal.lost)))
    segmenter = Segmenter(signal.case.rate_hz, 0)
    pairs: list[ContactPair] = []
    head = 0

    def read(first: int, end: int) -> FloatArray:
        assert 0 <= first <= end <= head, "the segmenter read samples that have not arrived"
        return radial[first:end]

    def missing(first: int, end: int) -> int:
        return int(lost[min(max(end, 0), len(radial))] - lost[min(max(first, 0), len(radial))])

    step = chunk or len(radial)
    for head in (*range(step, len(radial), step), len(radial)):
        pairs += segmenter.advance(read, missing, head)
    pairs += segmenter.finish(read, missing, len(radial))
    return pairs, segmenter


@dataclass
class Verdict:
    """Numbers of revolutions due (10 km/h and more, whole contacts in view), missed and false, and errors of the rest.

    Errors are in % of the period: `centre` of the contacts about their median, `bias` of the mean period. `z` are
    errors of the period over their stated standard errors.
    """

    due: int = 0
    missed: int = 0
    false: int = 0
    predicted: int = 0
    found: int = 0
    centre_percent: list[float] = field(default_factory=list)
    bias_percent: float = 0.0
    z: list[float] = field(default_factory=list)


def judge(signal: Signal, pairs: list[ContactPair]) -> Verdict:
    """Compare the revolutions found with the true ones."""
    n, theta = len(signal.radial_mps2), signal.theta_rad
    true: list[tuple[float, float, bool]] = []
    for a, b in pairwise(signal.contacts):
        if abs(abs(theta[min(round(b), n - 1)] - theta[round(a)]) - 2.0 * np.pi) < 0.3:
            margin = 0.35 * (b - a)
            slowest = np.abs(signal.speed_mps[int(a) : int(b) + 1]).min()
            true.append((a, b, bool(slowest >= 0.999 * 10.0 / 3.6 and a > margin and b + margin < n)))
    verdict = Verdict(due=sum(due for _, _, due in true), found=len(pairs))
    bounds = np.array([(a, b) for a, b, _ in true]).reshape(-1, 2)
    seen: set[int] = set()
    errors: list[float] = []
    periods: list[float] = []
    for pair in pairs:
        position = -1
        if len(bounds):
            off = np.abs(bounds - (pair.start.centre, pair.end.centre))
            position = int(off.sum(axis=1).argmin())
            if off[position].max() > 0.04 * (bounds[position, 1] - bounds[position, 0]):
                position = -1
        if position < 0:
            verdict.false += 1
            continue
        seen.add(position)
        period = bounds[position, 1] - bounds[position, 0]
        if pair.start.predicted or pair.end.predicted:
            verdict.predicted += 1
            continue
        errors.append(float(100.0 * (pair.end.centre - bounds[position, 1]) / period))
        periods.append(float(100.0 * ((pair.end.centre - pair.start.centre) / period - 1.0)))
        verdict.z.append(periods[-1] / 100.0 * period / max(pair.period_std, 1e-9))
    verdict.missed = sum(due and index not in seen for index, (_, _, due) in enumerate(true))
    verdict.centre_percent = (np.array(errors) - np.median(errors)).tolist() if errors else []
    verdict.bias_percent = float(np.mean(periods)) if periods else 0.0
    return verdict
