"""Contact template against the exact ring: shifts, stretch, gain, offset and stated errors."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.contacts.contact_template import ContactSamples, contact_template
from gateway.core.revolutions.angle_resampling import Phase
from tests.testkit.exact_ring import omega_at, on_grid, solution

OMEGA = omega_at(65.0)
N = 1024
WAVE = OMEGA**2 * on_grid(solution().sensor.radial_m)
WHITE = np.full(61, 0.147**2)
RATE_HZ = 9600.0
STEP = OMEGA / RATE_HZ


def samples_around(
    *,
    shifts=(0.0, 0.0),
    gain=1.0,
    offset=0.0,
    ramp=0.0,
    gravity=STANDARD_GRAVITY_MPS2,
    noise=0.0,
    step=STEP,
    seed=0,
    span=1.6,
):
    """Return one contact in time, its centre 0.31 samples from the middle, its halves shifted by angles."""
    ring = solution()
    theta = np.append(ring.theta_rad, math.pi)
    shape, weight = (
        CubicSpline(theta, np.append(v, v[0]), bc_type="periodic")
        for v in (ring.sensor.radial_m, ring.sensor.gravity_radial)
    )
    half = math.ceil(span / step)
    angle = (np.arange(2 * half + 1) - half - 0.31) * step
    # The shift changes from one to the other in the flat middle of the contact.
    share = 0.5 + 0.5 * np.tanh(angle / 0.03)
    moved = angle - shifts[0] * (1.0 - share) - shifts[1] * share
    signal = gain * OMEGA**2 * shape(moved) + gravity * weight(angle) + offset + ramp * angle
    signal += np.random.default_rng(seed).normal(0.0, 1.0, len(angle)) * noise
    return signal, Phase(float(half), half + 2.0 * math.pi / step, step, 0.0)


def match(template, signal, passage, rate_hz=RATE_HZ, gaps=()):
    """Return positions of leading and trailing edge and the sum of their covariances in samples; None without match.

    As in the pipeline, a second match starts from the place of the first.
    """
    around = ContactSamples(template, [signal], [passage], [gaps])
    first = around.match([passage], [rate_hz])
    if not first.fits[0]:
        return None
    start = passage.start + 0.5 * first.shift_rad[0].sum() / passage.rate
    nearer = passage._replace(start=start, end=start + passage.samples)
    result = around.match([nearer], [rate_hz])
    if not result.fits[0] or np.abs(start + result.shift_rad[0] / passage.rate - passage.start).max() > (
        around.largest_shift_rad / passage.rate
    ):
        return None
    return start + result.shift_rad[0] / passage.rate, result.covariances_rad2[0].sum(axis=0) / passage.rate**2


def test_match_recovers_shifts() -> None:
    template = contact_template(WAVE, OMEGA, 1069.0, WHITE)
    assert template is not None
    assert abs(template.middle_rad) < 1e-5
    signal, passage = samples_around()
    assert match(template, signal, passage)[0] - passage.start == pytest.approx(0.31, abs=2e-3)


@pytest.mark.parametrize(
    "what", [{"gain": 1.05}, {"offset": -900.0}, {"ramp": 40.0}, {"gravity": 0.0}, {"gain": 0.93, "offset": 30.0}]
)
def test_match_ignores_gain_offset_and_ramp(what: dict[str, float]) -> None:
    template = contact_template(WAVE, OMEGA, 1069.0, WHITE)
    signal, passage = samples_around(**what)
    assert match(template, signal, passage)[0] - passage.start == pytest.approx(0.31, abs=0.02)


def test_match_separates_the_edges() -> None:
    template = contact_template(WAVE, OMEGA, 1069.0, WHITE)
    signal, passage = samples_around(shifts=(0.006, -0.003))
    leading, trailing = match(template, signal, passage)[0]
    assert (leading - passage.start - 0.31) * STEP == pytest.approx(0.006, rel=0.03)
    assert (trailing - passage.start - 0.31) * STEP == pytest.approx(-0.003, rel=0.06)


@pytest.mark.parametrize("rate_hz", [2000.0, 9600.0])
def test_stated_error_matches_scatter(rate_hz: float) -> None:
    density = 5e-3 * STANDARD_GRAVITY_MPS2  # m/s^2 per root Hz
    noise = density * math.sqrt(0.5 * rate_hz)
    step = OMEGA / rate_hz
    variance = np.full(61, density**2 / (2.0 * math.pi / OMEGA))
    template = contact_template(WAVE, OMEGA, 2.0 * math.pi / step, variance)
    result, stated = [], []
    for seed in range(150):
        signal, passage = samples_around(noise=noise, step=step, seed=seed)
        places, covariance = match(template, signal, passage, rate_hz)
        result.append(places)
        stated.append(covariance)
    scatter, expected = np.cov(np.array(result).T), np.mean(stated, axis=0)
    assert np.diag(scatter) == pytest.approx(np.diag(expected), rel=0.35)
    middle = np.array([0.5, 0.5])
    assert middle @ scatter @ middle == pytest.approx(middle @ expected @ middle, rel=0.35)
    # The Cramer-Rao bound of the centre at this noise is 1.0 us.
    assert 1.0e-6 < math.sqrt(middle @ scatter @ middle) / rate_hz < 1.6e-6


def bridged(signal, gaps):
    """Return samples of which some were lost and bridged by a line, as `SampleBuffer` does."""
    signal = signal.copy()
    for first, end in gaps:
        steps = np.arange(1, end - first + 1) / (end - first + 1)
        signal[first:end] = signal[first - 1] + steps * (signal[end] - signal[first - 1])
    return signal


EDGE = round(0.24 / STEP)


@pytest.mark.parametrize("length", [1, 5, 36])
@pytest.mark.parametrize("place", [-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5])
def test_match_around_a_gap_is_right_within_its_error_or_none(length: int, place: float) -> None:
    """Places are in half angles of the contact."""
    density = 5e-3 * STANDARD_GRAVITY_MPS2
    template = contact_template(WAVE, OMEGA, 1069.0, np.full(61, density**2 * OMEGA / (2.0 * math.pi)))
    pulls, larger = [], []
    for seed in range(40):
        signal, passage = samples_around(noise=density * math.sqrt(0.5 * RATE_HZ), seed=seed)
        first = round(passage.start + place * EDGE) - length // 2
        gaps = [(first, first + length)]
        around = match(template, bridged(signal, gaps), passage, gaps=gaps)
        if around is None:
            continue
        places, covariance = around
        pulls += ((places - passage.start - 0.31) / np.sqrt(np.diag(covariance))).tolist()
        larger.append(np.sqrt(np.diag(covariance) / np.diag(match(template, signal, passage)[1])))
    if pulls:
        assert 0.6 < np.std(pulls) < 1.4
        assert np.min(larger) > 0.99
        assert np.max(larger) < 3.0
    # A gap as wide as half of the edge's slope leaves nothing of it.
    assert bool(pulls) is not (length == 36 and abs(place) == 1.0)


def test_lost_edge_is_not_matched_by_the_shape_beside_it() -> None:
    template = contact_template(WAVE, OMEGA, 1069.0, WHITE)
    signal, passage = samples_around()
    gaps = [(round(passage.start) + EDGE - 30, round(passage.start) + EDGE + 31)]
    assert match(template, bridged(signal, gaps), passage, gaps=gaps) is None


def test_match_rejects_other_signals() -> None:
    template = contact_template(WAVE, OMEGA, 1069.0, WHITE)
    signal, passage = samples_around()
    assert match(template, -signal, passage) is None
    assert match(template, signal * 2.0, passage) is None
    other = passage.start - 150.0
    assert match(template, signal, Phase(other, passage.end, STEP, 0.0)) is None
    part = round(passage.start) + 20
    assert match(template, signal[:part], passage) is None
    shaken = signal + np.random.default_rng(3).normal(0.0, 500.0, len(signal))
    assert match(template, shaken, passage) is None


def test_waveform_without_contact_has_no_template() -> None:
    assert contact_template(np.full(N, 1000.0), OMEGA, 1069.0, WHITE) is None
    assert contact_template(WAVE - WAVE.mean() - 5.0, OMEGA, 1069.0, WHITE) is None
    assert contact_template(np.full(N, math.nan), OMEGA, 1069.0, WHITE) is None


@pytest.mark.parametrize("mean_mps2", [1e-6, 0.01, 1.0])
def test_signal_without_its_steady_value_turns_evenly(mean_mps2) -> None:
    """The mean of an AC-coupled signal is what its high-pass left, of which no curvature can be a multiple."""
    template = contact_template(WAVE - WAVE.mean() + mean_mps2, OMEGA, 2.0 * math.pi / STEP, WHITE)
    assert template is not None
    even = STANDARD_GRAVITY_MPS2 * np.cos(template.whole.angles_rad)
    np.testing.assert_allclose(template.whole.gravity_mps2, even, atol=0.05)
