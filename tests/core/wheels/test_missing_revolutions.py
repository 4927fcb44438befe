"""Reasons why revolutions do not come, from signals that are stated, mounted or driven wrongly."""

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_protocol.messages import Coupling, Frame, Hello, MessageType, SampleBlock
from gateway.core.constants import STANDARD_GRAVITY_MPS2 as G
from gateway.core.contacts.missing_revolutions import rotation_period_s
from gateway.core.contacts.reasons import ContactCode
from gateway.core.estimates.results import WheelSnapshot
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.reasons import CoreCode, Reason
from gateway.core.text.wording import text
from gateway.core.trust.reasons import TrustCode
from gateway.core.wheels.reasons import WheelCode
from gateway.core.wheels.wheels import Pipeline
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring
from tests.core.wheels.rolling_signals import PRESSURE_PA, RADIUS_M, SCALE_MPS2, Rolling, hello

RATE_HZ = 9600.0
SETUP = WheelSetup("FL", 0, 0, RADIUS_M)
Signal = NDArray[np.float64]
ToFrames = Callable[..., list[Frame]]
Roll = Callable[..., Rolling]


def noise(count: int, std: float = 3.4) -> Signal:
    return std * np.random.default_rng(5).standard_normal(count)


def on_the_rim(kmh: float, duration_s: float) -> Signal:
    """A sensor on a rim of 200 mm: steady, with gravity once per revolution."""
    omega = kmh / 3.6 / RADIUS_M
    t = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    return 0.2 * omega**2 + G * np.cos(omega * t) + noise(len(t))


@cache
def lightly_loaded(kmh: float = 65.0, duration_s: float = 5.0) -> Signal:
    """The exact ring under 300 N, which bends in the contact without becoming flat."""
    ring = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=RADIUS_M, pressure_pa=PRESSURE_PA)
    omega = kmh / 3.6 / RADIUS_M
    solution = solve_rolling_ring(ring, 300.0, PRESSURE_PA, omega, nodes=1200)
    theta = omega * np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    wrapped = (theta + np.pi) % (2.0 * np.pi) - np.pi
    radial = omega**2 * np.interp(wrapped, solution.theta_rad, solution.sensor.radial_m, period=2.0 * np.pi)
    return radial + noise(len(theta))


def run(frames: Sequence[Frame]) -> tuple[WheelSnapshot, set[str]]:
    """Return the state of the wheel at the end, and the names of all flags that it had every 0.1 s."""
    pipeline = Pipeline((SETUP,), SETUP, ("kinematic",))
    flags: set[str] = set()
    for index in range(0, len(frames), 27):
        pipeline.frames("link", frames[index : index + 27], 10**18)
        flags |= {flag.name for flag in pipeline.wheels()[0].flags}
    pipeline.finish()
    return pipeline.wheels()[0], flags


def main_reason(wheel: WheelSnapshot) -> Reason:
    assert wheel.missing is not None
    assert wheel.missing.code is CoreCode.NO_REVOLUTION
    why = wheel.missing["why"]
    assert isinstance(why, tuple)
    assert isinstance(why[0], Reason)
    return why[0]


@pytest.mark.parametrize("kmh", [30.0, 65.0, 150.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_unit_g_stated_as_mps2(roll: Roll, to_frames: ToFrames, kmh: float, sign: int) -> None:
    wheel, flags = run(to_frames(roll(kmh, 9.0).radial_mps2 / G * sign))
    reason = main_reason(wheel)
    assert reason.code is ContactCode.RADIAL_IS_IN_G
    assert reason["expected_mps2"] == pytest.approx((kmh / 3.6) ** 2 / RADIUS_M, rel=0.03)
    assert reason["ratio"] == pytest.approx(1.0 / G, rel=0.05)
    assert "no revolution" in flags


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_wrong_rate_names_the_fitting_one(roll: Roll, to_frames: ToFrames, factor: float) -> None:
    stated_hz = RATE_HZ * factor
    wheel, _ = run(to_frames(roll(65.0, 5.0).radial_mps2, stated_hz))
    reason = main_reason(wheel)
    assert reason.code is ContactCode.RATE_DOES_NOT_FIT
    assert reason["rate_hz"] == stated_hz
    assert reason["fitting_hz"] == pytest.approx(RATE_HZ, rel=0.03)


def test_scale_beyond_any_wrong_rate_is_named(roll: Roll, to_frames: ToFrames) -> None:
    frames = to_frames(roll(65.0, 5.0).radial_mps2)
    scaled = [
        frame._replace(message=frame.message._replace(scale_mps2=tuple(1e6 * s for s in frame.message.scale_mps2)))
        if isinstance(frame.message, Hello)
        else frame
        for frame in frames
    ]
    wheel, _ = run(scaled)
    assert main_reason(wheel).code is ContactCode.RADIAL_SCALE_DOES_NOT_FIT


@pytest.mark.parametrize("kmh", [30.0, 65.0, 100.0])
def test_rim_sensor_sees_no_contact(to_frames: ToFrames, kmh: float) -> None:
    wheel, flags = run(to_frames(on_the_rim(kmh, 9.0)))
    reason = main_reason(wheel)
    assert reason.code is ContactCode.NO_CONTACT_SEEN
    assert reason["mean_mps2"] == pytest.approx(0.2 * (kmh / 3.6 / RADIUS_M) ** 2, rel=0.01)
    assert reason["lowest_mps2"] > 0.9 * reason["mean_mps2"]  # type: ignore[operator]
    assert "no revolution" in flags


def test_rim_sensor_without_steady_value_sees_no_contact(to_frames: ToFrames) -> None:
    signal = on_the_rim(65.0, 5.0)
    wheel, _ = run(to_frames(signal - signal.mean(), coupling=Coupling.AC))
    assert main_reason(wheel).code is ContactCode.NO_CONTACT_IN_AC_SIGNAL


def test_sensor_that_points_outward_is_named(to_frames: ToFrames) -> None:
    wheel, _ = run(to_frames(-on_the_rim(65.0, 5.0)))
    assert main_reason(wheel).code is ContactCode.NO_CONTACT_SEEN
    assert wheel.missing is not None
    outward = [reason for reason in wheel.missing if reason.code is ContactCode.RADIAL_OUTWARD]
    assert outward[0]["mean_mps2"] == pytest.approx(-0.2 * (65.0 / 3.6 / RADIUS_M) ** 2, rel=0.01)


def test_light_load_gives_no_contact(to_frames: ToFrames) -> None:
    wheel, _ = run(to_frames(lightly_loaded()))
    assert wheel.counters.revolutions == 0
    assert main_reason(wheel).code is ContactCode.NO_CONTACT_SEEN


def test_standing_wheel_is_no_fault(to_frames: ToFrames) -> None:
    wheel, flags = run(to_frames(-G + noise(round(9.0 * RATE_HZ))))
    assert main_reason(wheel).code is ContactCode.WHEEL_STANDS
    assert flags == set()


def test_slow_wheel_is_no_fault(roll: Roll, to_frames: ToFrames) -> None:
    wheel, flags = run(to_frames(roll(4.0, 12.0).radial_mps2))
    reason = main_reason(wheel)
    assert reason.code is ContactCode.WHEEL_TOO_SLOW
    assert reason["speed_mps"] == pytest.approx(4.0 / 3.6, rel=0.35)  # gravity is of the same size
    assert flags == set()


def test_short_recording_is_too_short(roll: Roll, to_frames: ToFrames) -> None:
    signal = roll(65.0, 0.25)
    wheel, _ = run(to_frames(signal.radial_mps2))
    reason = main_reason(wheel)
    assert reason.code is ContactCode.SAMPLES_TOO_SHORT
    assert reason["needed_s"] > 3.0 * 2.0 * math.pi * RADIUS_M / (65.0 / 3.6)  # type: ignore[operator]


def test_stretches_between_gaps_are_too_short(roll: Roll, to_frames: ToFrames) -> None:
    frames = to_frames(roll(30.0, 6.0).radial_mps2)
    # 0.5 s of samples, then 0.5 s without: a revolution takes 0.24 s.
    blocks = round(0.5 * RATE_HZ / 36)
    remaining = [frame for frame in frames if frame.type != MessageType.SAMPLES or frame.seq // blocks % 2 == 0]
    wheel, _ = run(remaining)
    assert main_reason(wheel).code is ContactCode.SAMPLES_INTERRUPTED


def test_loss_within_every_revolution_is_the_reason(roll: Roll, to_frames: ToFrames) -> None:
    frames = to_frames(roll(65.0, 6.0).radial_mps2)
    # A revolution takes 30 blocks; two are received, five lost.
    remaining = [frame for frame in frames if frame.type != MessageType.SAMPLES or frame.seq % 7 < 2]
    wheel, _ = run(remaining)
    assert main_reason(wheel).code is ContactCode.SAMPLES_INTERRUPTED


def test_saturated_axis_is_named(to_frames: ToFrames) -> None:
    wheel, flags = run(to_frames(on_the_rim(150.0, 7.0)))  # beyond the range of int16 at this scale
    reason = main_reason(wheel)
    assert reason.code is ContactCode.RADIAL_AT_RANGE_END
    assert reason["level_mps2"] == pytest.approx(32767 * SCALE_MPS2)
    assert flags == {"stuck"}


def test_random_signal_has_no_alike_contacts(to_frames: ToFrames) -> None:
    wheel, _ = run(to_frames(noise(round(7.0 * RATE_HZ), std=100.0)))
    assert main_reason(wheel).code is ContactCode.CONTACTS_NOT_ALIKE


def test_dead_sensor_is_the_reason(to_frames: ToFrames) -> None:
    wheel, _ = run(to_frames(np.zeros(round(7.0 * RATE_HZ))))
    assert main_reason(wheel).code is TrustCode.SENSOR_DEAD


def of_three_axes(*axes_mps2: Signal) -> list[Frame]:
    """Return the frames of a sensor of three axes."""
    counts = np.rint(np.stack(axes_mps2, axis=1) / SCALE_MPS2).astype(np.int16)
    described = hello(axes=0b111, range_mps2=(1600.0,) * 3, scale_mps2=(SCALE_MPS2,) * 3)
    frames = [Frame(MessageType.HELLO, 0, 0, 0, 0, described)]
    for index in range(0, len(counts) - 36, 36):
        block = SampleBlock(index, 0b111, counts[index : index + 36])
        frames.append(Frame(MessageType.SAMPLES, 0, 0, len(frames), round(index / RATE_HZ * 1e6), block))
    return frames


def test_swapped_axes_are_the_reason(roll: Roll) -> None:
    # Circumferential acceleration on the radial channel, and the other way round.
    signal = roll(65.0, 7.0).radial_mps2
    wheel, flags = run(of_three_axes(signal, noise(len(signal)), 30.0 * np.sin(np.arange(len(signal)))))
    assert main_reason(wheel).code is TrustCode.SENSOR_TILTED
    assert flags == {"mounting"}


def test_unconnected_lateral_axis_hides_no_other_reason(roll: Roll) -> None:
    in_g = roll(65.0, 6.5).radial_mps2 / G
    wheel, flags = run(of_three_axes(noise(len(in_g)), 0.0 * in_g, in_g))
    assert main_reason(wheel).code is ContactCode.RADIAL_IS_IN_G
    assert flags == {"stuck", "no revolution"}
    (stuck,) = [flag.reason for flag in wheel.flags if flag.name == "stuck"]
    assert text(stuck) == "the sensor is stuck: lateral at 0 counts, unchanged for 1 s"
    standing = noise(round(4.5 * RATE_HZ))
    assert main_reason(run(of_three_axes(standing, 0.0 * standing, standing - G))[0]).code is ContactCode.WHEEL_STANDS


def test_stuck_radial_axis_beside_others_is_the_reason() -> None:
    other = noise(round(7.0 * RATE_HZ))
    wheel, flags = run(of_three_axes(other, other, np.full(len(other), 100.0)))
    assert main_reason(wheel).code is TrustCode.SENSOR_STUCK
    assert flags == {"stuck"}


def test_samples_without_hello_are_named(roll: Roll, to_frames: ToFrames) -> None:
    frames = [frame for frame in to_frames(roll(65.0, 1.0).radial_mps2) if frame.type != MessageType.HELLO]
    reason = main_reason(run(frames)[0])
    assert reason.code is CoreCode.SAMPLES_WITHOUT_HELLO
    assert reason["count"] == len(frames) - 1


def test_hello_without_samples_is_named(roll: Roll, to_frames: ToFrames) -> None:
    frames = [frame for frame in to_frames(roll(65.0, 0.1).radial_mps2) if frame.type != MessageType.SAMPLES]
    assert main_reason(run(frames)[0]).code is WheelCode.NO_SAMPLES


@pytest.mark.parametrize("kmh", [10.0, 12.0, 30.0, 100.0, 250.0])
@pytest.mark.parametrize("ac", [False, True])
def test_rolling_wheels_have_no_reason(roll: Roll, to_frames: ToFrames, kmh: float, ac: bool) -> None:
    coupling = Coupling.AC if ac else Coupling.DC
    wheel, flags = run(to_frames(roll(kmh, 7.0, ac=ac).radial_mps2, coupling=coupling))
    assert wheel.counters.revolutions > 5
    assert wheel.missing is None
    assert "no revolution" not in flags


def test_stop_and_go_has_no_reason(roll: Roll, to_frames: ToFrames) -> None:
    def kmh(t: Signal) -> Signal:
        return np.interp(t, [0.0, 8.0, 11.0, 16.0, 24.0, 30.0, 36.0], [0.0, 0.0, 30.0, 30.0, 0.0, 0.0, 40.0])

    wheel, flags = run(to_frames(roll(kmh, 36.0).radial_mps2))
    assert wheel.counters.revolutions > 20
    assert wheel.missing is None
    assert "no revolution" not in flags


def test_chunks_do_not_change_the_reason(to_frames: ToFrames) -> None:
    frames = to_frames(on_the_rim(65.0, 13.0))
    results = []
    for size in (1, 100, len(frames)):
        pipeline = Pipeline((SETUP,), SETUP, ("kinematic",))
        for index in range(0, len(frames), size):
            pipeline.frames("link", frames[index : index + size], 10**18)
        pipeline.finish()
        results.append((pipeline.wheels()[0].missing, pipeline.wheels()[0].flags))
    assert results[0] == results[1] == results[2]


def test_period_is_the_first_of_its_multiples(roll: Roll) -> None:
    signal = roll(65.0, 4.0)
    assert rotation_period_s(signal.radial_mps2, RATE_HZ) == pytest.approx(
        2.0 * math.pi * RADIUS_M / (65.0 / 3.6), rel=0.01
    )
    assert rotation_period_s(noise(20000), RATE_HZ) is None
    assert rotation_period_s(np.zeros(20000), RATE_HZ) is None
