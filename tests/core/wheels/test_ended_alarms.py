"""Alarms of what a signal says against a statement end when later revolutions do not bear them out, and only then."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.core.estimates.sensor_claims import SensorClaims
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.wheels.timebase import HostClock
from gateway.core.wheels.wheel_pipeline import WheelPipeline
from tests.core.wheels.belt_signals import DEPTH_M, RADIUS_M, rolled
from tests.core.wheels.rolling_signals import hello

RATE_HZ, SCALE_MPS2, BLOCK = 2400.0, 0.2, 32
FIRST_S, SPOILT_S, SOUND_S = 15.0, 32.0, 70.0
TIME_S = np.arange(round((FIRST_S + SPOILT_S + SOUND_S) * RATE_HZ)) / RATE_HZ
SETUP = WheelSetup("FL", 0, 0, RADIUS_M, radius_std_m=0.003, sensor=SensorClaims(offset_m=DEPTH_M, offset_std_m=0.0003))
Samples = NDArray[np.float64]
Speed = Callable[[Samples], Samples]


def late(samples: Samples) -> Samples:
    return np.stack([np.roll(samples[:, 0], 5), *samples[:, 1:].T], axis=1)


# What is done to samples, and the alarm.
SPOILT: dict[str, tuple[Callable[[Samples], Samples], str]] = {
    "radial gain": (lambda samples: samples * [1.0, 1.0, 1.4], "steady value"),
    "all gains": (lambda samples: samples * 0.5, "steady value"),
    "zero-g offset": (lambda samples: np.add(samples, [0.0, 0.0, 30.0]), "zero-g offset"),
    "axis lag": (late, "timing of the axes"),
    "swapped axes": (lambda samples: samples[:, [1, 0, 2]], "axes"),
    "no gravity": (lambda samples: samples * [0.02, 1.0, 1.0], "axes"),
}


def city(time_s: Samples) -> Samples:
    return 17.0 + 6.0 * np.sin(time_s / 3.7)


def slower_later(time_s: Samples) -> Samples:
    """Return a speed that falls behind the spoilt stretch: its revolutions weigh a hundred times as much."""
    return (
        11.5 + 2.0 * np.sin(time_s / 5.0) + 20.0 / (1.0 + np.exp(np.clip(time_s - FIRST_S - SPOILT_S - 5.0, -50, 50)))
    )


def steady_later(time_s: Samples) -> Samples:
    """Return a speed that is constant behind the spoilt stretch: an offset is no longer separated from a gain."""
    return np.where(time_s < FIRST_S + SPOILT_S, city(time_s), city(np.array(FIRST_S + SPOILT_S)))


def fastest_later(time_s: Samples) -> Samples:
    """Return a speed that is constant behind the spoilt stretch, and is the fastest."""
    rise = 1.0 / (1.0 + np.exp(np.clip((FIRST_S + SPOILT_S + 4.0 - time_s) / 0.7, -40.0, 40.0)))
    return np.asarray(steady_later(time_s) + 8.0 * rise)


@cache
def sound(speed: Speed) -> Samples:
    return rolled(speed(TIME_S), RATE_HZ)


def spoilt(speed: Speed, spoil: Callable[[Samples], Samples], spoilt_s: float) -> Samples:
    """Return samples that are spoilt from FIRST_S on, for a time."""
    samples = sound(speed).copy()
    part = slice(round(FIRST_S * RATE_HZ), round((FIRST_S + spoilt_s) * RATE_HZ))
    samples[part] = spoil(samples[part])
    return samples


def flags(samples: Samples, lost: Callable[[int], bool] = lambda block: False) -> list[set[str]]:
    """Return the alarms of a wheel after each second, without the blocks of samples that are lost."""
    counts = np.round(samples / SCALE_MPS2).astype(np.int16)
    wheel, host = WheelPipeline(SETUP, ("kinematic",)), HostClock()
    wheel.hello(hello(RATE_HZ, axes=0b111, range_mps2=(6000.0,) * 3, scale_mps2=(SCALE_MPS2,) * 3))
    seen = []
    second = round(RATE_HZ) // BLOCK
    for first in range(0, len(counts) // BLOCK - second + 1, second):
        for block in range(first, first + second):
            if not lost(block):
                tick_us = round(block * BLOCK * 1e6 / RATE_HZ)
                wheel.add(block * BLOCK, [tick_us], 0b111, counts[block * BLOCK : (block + 1) * BLOCK], host)
        wheel.complete()
        seen.append({flag.name for flag in wheel.snapshot().flags})
    return seen


@pytest.mark.parametrize(
    ("name", "speed"),
    [
        ("zero-g offset", steady_later),
        ("zero-g offset", fastest_later),
        *((name, city) for name in SPOILT),
        *((name, slower_later) for name in ("all gains", "axis lag", "swapped axes")),
    ],
)
def test_alarm_that_was_wrong_ends_and_stays_over(name: str, speed: Speed) -> None:
    spoil, alarm = SPOILT[name]
    seen = flags(spoilt(speed, spoil, SPOILT_S))
    begin, end = round(FIRST_S), round(FIRST_S + SPOILT_S)
    assert not any(seen[:begin])
    assert any(alarm in names for names in seen[begin : end + 10])
    # Some 25 s are 200 to 400 revolutions.
    assert not any(seen[end + 50 :]), seen[end:]


@pytest.mark.parametrize("speed", [city, steady_later, fastest_later])
@pytest.mark.parametrize("name", SPOILT)
def test_alarm_that_is_right_stands(name: str, speed: Speed) -> None:
    spoil, alarm = SPOILT[name]
    seen = flags(spoilt(speed, spoil, SPOILT_S + SOUND_S))
    assert all(alarm in names for names in seen[round(FIRST_S + SPOILT_S) :]), seen


def test_depth_that_was_wrong_at_first_is_no_alarm_for_long() -> None:
    samples, until = sound(city).copy(), round(SPOILT_S * RATE_HZ)
    samples[:until] = rolled(city(TIME_S[:until]), RATE_HZ, depth_m=0.009)
    seen = flags(samples)
    assert any("sensor offset" in names for names in seen[: round(SPOILT_S)])
    assert not any(seen[round(SPOILT_S) + 50 :])


def test_depth_that_only_revolutions_with_gaps_show_is_no_alarm() -> None:
    """A block of seven is lost: one in each revolution."""
    begin, end = round(2.0 * RATE_HZ), round(SPOILT_S * RATE_HZ)
    samples = rolled(city(TIME_S[:end]), RATE_HZ)
    samples[begin:] = rolled(city(TIME_S[begin:end]), RATE_HZ, depth_m=0.009)
    assert any("sensor offset" in names for names in flags(samples))
    assert not any(flags(samples, lambda block: block * BLOCK > 0.5 * begin and block % 7 == 0))


def test_nothing_is_said_of_a_sound_sensor() -> None:
    assert not any(flags(sound(city)))
