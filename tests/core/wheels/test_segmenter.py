"""Contacts of the exact ring over the specified range of speeds and noise."""

from collections.abc import Callable

import numpy as np
import pytest

from gateway.core.contacts.segmenter import ContactPair, Segmenter
from gateway.core.estimates.results import WheelState


def segment(signal, chunk=360, missing=lambda first, end: 0) -> tuple[list[ContactPair], Segmenter]:
    radial = signal.radial_mps2
    segmenter = Segmenter(signal.rate_hz, 0)
    pairs: list[ContactPair] = []

    def read(first: int, end: int):
        assert 0 <= first <= end <= head, "the segmenter looked at samples that are not there yet"
        return radial[first:end]

    for head in (*range(chunk, len(radial), chunk), len(radial)):
        pairs += segmenter.advance(read, missing, head)
    pairs += segmenter.finish(read, missing, len(radial))
    return pairs, segmenter


def ends(pairs) -> np.ndarray:
    return np.array([pair.end.centre for pair in pairs])


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("ac", [False, True])
@pytest.mark.parametrize(
    ("kmh", "duration_s", "rate_hz"),
    [(10.0, 8.0, 9600.0), (65.0, 3.0, 9600.0), (120.0, 2.0, 2000.0), (250.0, 1.5, 2000.0), (250.0, 1.0, 25600.0)],
)
def test_constant_speed_loses_no_revolution(roll: Callable, kmh, duration_s, rate_hz, ac, sign):
    signal = roll(kmh, duration_s, rate_hz, ac=ac, sign=sign)
    pairs, segmenter = segment(signal)
    period = rate_hz * 2 * np.pi * 0.32 / (kmh / 3.6)
    # Contacts that are cut by the first or last sample need not be found.
    whole = signal.contacts[
        (signal.contacts > 0.12 * period) & (signal.contacts < len(signal.radial_mps2) - 0.2 * period)
    ]
    assert len(pairs) >= len(whole) - 1
    assert segmenter.sign == sign
    assert segmenter.state is WheelState.ROLLING
    centre_error = signal.errors(ends(pairs)) / period
    assert centre_error.max() < 0.002
    assert [pair.start.centre for pair in pairs[1:]] == [pair.end.centre for pair in pairs[:-1]]


@pytest.mark.parametrize("rate_hz", [2000.0, 9600.0])
@pytest.mark.parametrize("from_kmh", [0.0, 10.0])
def test_acceleration_loses_no_revolution(roll: Callable, from_kmh, rate_hz):
    signal = roll(lambda t: from_kmh + 3.0 * 3.6 * t, 10.0, rate_hz)
    pairs, _ = segment(signal)
    first_kmh = signal.speed_mps[int(pairs[0].start.centre)] * 3.6
    assert first_kmh < 20.0
    assert signal.errors(ends(pairs)).max() < 0.004 * rate_hz * 0.2
    found_from = pairs[0].start.centre - 1
    assert len(pairs) >= np.sum(signal.contacts > found_from) - 2
    assert all(a.end.centre == b.start.centre for a, b in zip(pairs, pairs[1:], strict=False))


def test_standstill_and_restart(roll: Callable):
    def profile(t):
        return np.interp(t, [0.0, 4.0, 7.0, 13.0, 15.0, 19.0], [50.0, 50.0, 0.0, 0.0, 20.0, 60.0])

    signal = roll(profile, 19.0)
    radial = signal.radial_mps2
    segmenter = Segmenter(signal.rate_hz, 0)
    states, pairs = {}, []
    for head in range(0, len(radial), 96):
        pairs += segmenter.advance(lambda a, b: radial[a:b], lambda a, b: 0, head)
        states[head / signal.rate_hz] = segmenter.state
    assert states[3.0] is WheelState.ROLLING
    assert states[12.5] is WheelState.STANDSTILL
    assert states[18.0] is WheelState.ROLLING
    starts_s = np.array([pair.start.centre for pair in pairs]) / signal.rate_hz
    assert not np.any((starts_s > 7.0) & (starts_s < 13.0))
    assert np.sum(starts_s > 14.0) >= 20
    assert (signal.errors(ends(pairs)) < 0.01 * signal.rate_hz).all()


def test_contacts_do_not_depend_on_chunks(roll: Callable):
    signal = roll(lambda t: 40 + 10 * np.sin(t), 4.0)
    whole, _ = segment(signal, chunk=10**6)
    for chunk in (1, 37, 1000, 9999):
        assert segment(signal, chunk)[0] == whole


def test_lost_contact_is_marked_predicted(roll: Callable):
    signal = roll(65.0, 3.0)
    lost = int(signal.contacts[12])
    gap = (lost - 60, lost + 60)
    signal.radial_mps2[gap[0] : gap[1]] = np.linspace(*signal.radial_mps2[[gap[0], gap[1]]], gap[1] - gap[0])
    pairs, _ = segment(signal, missing=lambda a, b: max(0, min(b, gap[1]) - max(a, gap[0])))
    predicted = [pair.end for pair in pairs if pair.end.predicted]
    assert len(predicted) == 1
    assert abs(predicted[0].centre - lost) < 20
    assert len(pairs) >= len(signal.contacts) - 2


def test_hidden_contacts_do_not_leave_the_track_at_half_the_speed(roll: Callable):
    """As long as every second contact is lost, those seen are two turns apart; then all are seen again."""
    signal = roll(65.0, 6.0)
    gaps = [(int(contact) - 150, int(contact) + 150) for contact in signal.contacts[1:16:2]]
    for lo, hi in gaps:
        signal.radial_mps2[lo:hi] = np.linspace(*signal.radial_mps2[[lo, hi]], hi - lo)
    pairs, _ = segment(signal, missing=lambda a, b: sum(max(0, min(b, hi) - max(a, lo)) for lo, hi in gaps))
    after = [pair for pair in pairs if pair.start.centre > signal.contacts[20]]
    assert len(after) >= len(signal.contacts) - 24
    assert np.ptp([pair.end.centre - pair.start.centre for pair in after]) < 0.01 * np.diff(signal.contacts).mean()
    assert signal.errors(ends(after)).max() < 0.002 * 9600 * 0.11


def test_noise_and_standstill_give_no_revolution(roll: Callable):
    for noise in (0.1, 3.4, 40.0):
        pairs, segmenter = segment(roll(0.0, 12.0, noise_mps2=noise))
        assert pairs == []
        assert segmenter.state in (WheelState.STANDSTILL, WheelState.SEARCHING)


def test_noisy_sensor_at_town_speed(roll: Callable):
    # 70 mg/sqrt(Hz) over the whole band: 48 m/s^2 rms against R Omega^2 = 217 m/s^2
    signal = roll(30.0, 4.0, noise_mps2=48.0)
    pairs, _ = segment(signal)
    assert len(pairs) >= len(signal.contacts) - 3
    assert signal.errors(ends(pairs)).max() < 0.01 * 2317


def test_stated_period_error_covers_true_error(roll: Callable):
    signal = roll(65.0, 20.0, noise_mps2=10.0, seed=3)
    pairs, _ = segment(signal)
    period = 9600 * 2 * np.pi * 0.32 / (65 / 3.6)
    z = np.array([(pair.end.centre - pair.start.centre - period) / pair.period_std for pair in pairs])
    assert 0.4 < z.std() < 1.6
    assert abs(z.mean()) < 0.5
