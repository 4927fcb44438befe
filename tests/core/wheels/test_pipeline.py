"""The whole pipeline: live and batch give equal results, and faults are counted and reported."""

import dataclasses
import random

import numpy as np
import pytest

from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Coupling, Environment, MessageType
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
from gateway.core.estimates.results import WheelState
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.reasons import codes_of
from gateway.core.wheels.reasons import WheelCode
from gateway.core.wheels.tire_estimates import TireEstimates
from gateway.core.wheels.wheels import Pipeline
from gateway.ring.reasons import RingCode
from tests.testkit.agreement import assert_agree, by_wheel, values_of

SETUP = WheelSetup("FL", 0, 0, 0.32, load_n=5000.0, load_std_n=50.0)
SETUPS = tuple(WheelSetup(f"W{i}", 0, i, 0.32, load_n=5000.0) for i in range(4))
UNKNOWN = WheelSetup("", 0, 0, 0.32)


def stream(frames, step_ns=3_750_000, start_ns=10**18):
    """Return the bytes of each frame with its arrival time."""
    return [(encode_frame(frame), start_ns + i * step_ns) for i, frame in enumerate(frames)]


def run_live(packets, setups=(SETUP,), pieces=None, estimators=DEFAULT_ESTIMATORS):
    pipeline, decoder = Pipeline(setups, UNKNOWN, estimators), FrameDecoder()
    results = []
    for data, host_ns in packets:
        for part in pieces(data) if pieces else (data,):
            results += pipeline.frames("link", decoder.feed(part), host_ns)
    results += pipeline.frames("link", decoder.finish(), packets[-1][1])
    return results + pipeline.finish(), pipeline


def arrivals_ns(packets, hold_s):
    """Return the results of a pipeline, and for each the arrival time of the packet that it came with."""
    pipeline, decoder = Pipeline(SETUPS, UNKNOWN, hold_s=hold_s), FrameDecoder()
    results, came_ns = [], []
    for data, host_ns in packets:
        result = pipeline.frames("link", decoder.feed(data), host_ns)
        results += result
        came_ns += [host_ns] * len(result)
    return results, came_ns, pipeline.finish()


def run_batch(packets, setups=(SETUP,), block=50_000, hold_s=0.0):
    pipeline, decoder = Pipeline(setups, UNKNOWN, hold_s=hold_s), BatchDecoder()
    ends = np.cumsum([len(data) for data, _ in packets])
    arrivals = np.array([host_ns for _, host_ns in packets])
    whole = b"".join(data for data, _ in packets)
    results = []

    def take(batch):
        if len(batch.type):
            host = arrivals[np.minimum(np.searchsorted(ends, batch.end_offset), len(arrivals) - 1)]
            results.extend(pipeline.take("link", batch, host))

    for index in range(0, len(whole), block):
        take(decoder.feed(whole[index : index + block]))
    take(decoder.finish())
    return results + pipeline.finish(), pipeline


@pytest.fixture(scope="module")
def four_wheels(roll, to_frames):
    """Return interleaved frames of four wheels at different speeds."""
    wheels = [
        to_frames(roll(lambda t, k=kmh: k + 8 * np.sin(t), 4.5, seed=i).radial_mps2, wheel=i)
        for i, kmh in enumerate((40.0, 65.0, 90.0, 120.0))
    ]
    return [frame for group in zip(*wheels, strict=True) for frame in group]


@pytest.fixture(scope="module")
def at_once(four_wheels):
    """Return the results of four wheels that do not wait."""
    return arrivals_ns(stream(four_wheels, 938_000), 0.0)


def test_batch_equals_live(four_wheels, at_once):
    packets = stream(four_wheels, 938_000)
    live = [*at_once[0], *at_once[2]]
    assert len(live) > 150
    for block in (1_000, 10**7):
        batch, _ = run_batch(packets, SETUPS, block)
        assert_agree(batch, live)


def test_pieces_of_a_file_cut_no_block_of_revolutions(four_wheels, monkeypatch):
    sizes = []
    take_block = TireEstimates.take_block

    def counted(self, arrays, *arguments):
        sizes.append(len(arrays))
        return take_block(self, arrays, *arguments)

    monkeypatch.setattr(TireEstimates, "take_block", counted)
    packets = stream(four_wheels, 900_000)
    whole, _ = run_batch(packets, SETUPS, 10**7, hold_s=7.6)
    sizes_of_whole = sorted(sizes)
    sizes.clear()
    pieces, _ = run_batch(packets, SETUPS, 5_000, hold_s=7.6)
    assert sorted(sizes) == sizes_of_whole
    assert_agree(pieces, whole)


def test_revolutions_of_a_file_wait_for_a_silent_wheel_for_two_holds_at_most(four_wheels):
    stops_us, hold_s = four_wheels[len(four_wheels) // 4].tick_us, 0.5
    frames = [frame for frame in four_wheels if frame.wheel or frame.tick_us < stops_us]
    until = next(index for index, frame in enumerate(frames) if frame.tick_us > stops_us + 2.2e6 * hold_s)
    pipeline, decoder, came = Pipeline(SETUPS, UNKNOWN, ("kinematic",), hold_s), BatchDecoder(), []
    for data, host_ns in stream(frames[:until], 900_000):
        batch = decoder.feed(data)
        came += pipeline.take("link", batch, np.full(len(batch), host_ns)) if len(batch) else []
    of_wheel = [result for result in came if result.position == "W0"]
    assert len(of_wheel) > 3
    # What is left ends with the samples, in a contact that only the end of the file completes.
    last = [result for result in pipeline.finish() if result.position == "W0"]
    assert all(result.revolution.start_s > of_wheel[-1].revolution.start_s for result in last)
    assert len(last) <= 1


def test_batch_equals_live_on_bad_link(four_wheels):
    rng = random.Random(6)
    frames = list(four_wheels)
    for i in rng.sample(range(10, len(frames) - 10), 30):
        frames[i], frames[i + 3] = frames[i + 3], frames[i]  # late
    frames = [frame for frame in frames if rng.random() > 0.01]  # lost
    frames = [again for frame in frames for again in ((frame, frame) if rng.random() < 0.01 else (frame,))]
    packets = []
    for data, host_ns in stream(frames, 900_000):
        damaged = bytearray(data)
        if rng.random() < 0.01:
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        packets.append((bytes(damaged), host_ns))
    live, pipeline = run_live(packets, SETUPS)
    assert len(live) > 100
    assert any(result.revolution.missing_fraction > 0 for result in live)
    assert_agree(run_batch(packets, SETUPS, 33_333)[0], live)
    for wheel in pipeline.wheels():
        assert wheel.counters.samples_lost > 0


def test_batch_equals_live_when_block_size_changes(roll, to_frames):
    signal = roll(65.0, 4.0).radial_mps2
    rng = random.Random(8)
    frames = to_frames(signal)[:2]
    position = 0
    while position + 109 <= len(signal):
        n = rng.choice((1, 20, 36, 109))
        (block,) = to_frames(signal[position : position + n], block=n, first_sample=position)[2:]
        frames.append(block._replace(seq=len(frames), tick_us=round(position / 9600 * 1e6)))
        position += n
    packets = stream(frames)
    live, _ = run_live(packets)
    assert len(live) >= 33
    assert_agree(run_batch(packets)[0], live)


def test_results_do_not_depend_on_chunks(roll, to_frames):
    packets = stream(to_frames(roll(65.0, 3.0).radial_mps2))
    whole, _ = run_live(packets)
    assert len(whole) >= 24
    for size in (1, 19, 240):
        cut, _ = run_live(packets, pieces=lambda d, n=size: [d[i : i + n] for i in range(0, len(d), n)])
        assert values_of(by_wheel(cut)) == values_of(by_wheel(whole))


def test_frames_of_one_chunk_join_without_changing_results(roll, to_frames) -> None:
    # Sample numbers wrap, one block is lost and another one comes late.
    frames = to_frames(roll(60.0, 4.0).radial_mps2, first_sample=2**32 - 20_000)
    frames.insert(310, frames.pop(300))
    del frames[700]

    def results(together: int):
        pipeline, result = Pipeline((SETUP,), UNKNOWN), []
        for index in range(0, len(frames), together):
            result += pipeline.frames("link", frames[index : index + together], 10**18)
        result += pipeline.finish()
        return result, pipeline.wheels()[0].counters

    (single, counted), (joined, counted_together) = results(1), results(40)
    assert len(single) > 25
    assert_agree(joined, single)
    assert counted == counted_together
    assert counted.samples_lost == 36


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("ac", [False, True])
def test_speed_and_contact_at_any_sign_and_coupling(roll, to_frames, sign, ac):
    signal = roll(65.0, 4.0, sign=sign, ac=ac)
    frames = to_frames(signal.radial_mps2, coupling=Coupling.AC if ac else Coupling.DC, highpass_hz=0.05 if ac else 0.0)
    results, pipeline = run_live(stream(frames))
    assert len(results) >= 33
    last = {estimate.name: estimate for estimate in results[-1].estimates}
    assert last["speed_mps"].status is not Status.INVALID
    assert abs(last["speed_mps"].value * 3.6 - 65.0) < 0.05
    # The edges of the exact ring are at +-0.2398 rad.
    assert abs(last["trailing_edge_rad"].value - 0.2398) < 0.012
    assert abs(last["leading_edge_rad"].value + 0.2398) < 0.012
    assert results[-1].revolution.radial_mps2.mean() == pytest.approx(0.32 * (65 / 3.6 / 0.32) ** 2, rel=0.01)
    assert pipeline.wheels()[0].state is WheelState.ROLLING


def test_lost_frame_loses_no_revolution(roll, to_frames):
    frames = to_frames(roll(65.0, 3.0).radial_mps2)
    clean, _ = run_live(stream(frames), estimators=("kinematic",))
    for lost in range(200, 232):
        results, pipeline = run_live(stream(frames[:lost] + frames[lost + 1 :]), estimators=("kinematic",))
        assert len(results) == len(clean)
        assert pipeline.wheels()[0].counters.samples_lost == 36
        hit = [result for result in results if result.revolution.missing_fraction > 0]
        assert 1 <= len(hit) <= 2
        for result in hit:
            # Away from the contacts it says nothing against the revolution.
            codes = {fault.code for fault in result.revolution.faults}
            assert not codes or EstimateCode.SAMPLES_LOST in codes
            edges = result.revolution.leading_edge_rad, result.revolution.trailing_edge_rad
            assert np.abs(np.abs(edges) - 0.2398).max() < 0.012
        speeds = np.array([result.revolution.omega_radps for result in results])
        assert abs(speeds / speeds.mean() - 1).max() < 0.02


def test_times_of_a_dump_advance(roll, to_frames) -> None:
    packets = [(data, 0) for data, _ in stream(to_frames(roll(65.0, 2.0).radial_mps2))]
    for run in (run_live, run_batch):
        results, _ = run(packets)
        assert np.diff([result.host_ns for result in results]).min() > 0


def test_late_frame_is_inserted(roll, to_frames):
    frames = to_frames(roll(65.0, 3.0).radial_mps2)
    clean, _ = run_live(stream(frames))
    swapped = [*frames[:220], frames[221], frames[220], *frames[222:]]
    results, pipeline = run_live(stream(swapped))
    assert pipeline.wheels()[0].counters.samples_lost == 0
    assert [r.revolution.period_s for r in results] == [r.revolution.period_s for r in clean]


def test_counters_and_ticks_may_wrap(roll, to_frames):
    signal = roll(65.0, 4.0).radial_mps2
    base, _ = run_live(stream(to_frames(signal)))
    wrapped, pipeline = run_live(stream(to_frames(signal, first_sample=2**32 - 9000, start_us=2**32 - 1_000_000)))
    assert [r.revolution.period_s for r in wrapped] == pytest.approx([r.revolution.period_s for r in base], rel=1e-6)
    assert pipeline.wheels()[0].counters.samples_lost == 0
    starts = [result.revolution.start_s for result in wrapped]
    assert starts == sorted(starts)


def test_hub_restart_loses_only_unsent_samples(roll, to_frames):
    signal = roll(65.0, 6.0).radial_mps2
    first = to_frames(signal[:28800])
    second = to_frames(signal[28800:], boot_count=2)
    results, pipeline = run_live(stream(first + second))
    clean, _ = run_live(stream(to_frames(signal)))
    assert len(results) >= len(clean) - 3
    assert pipeline.wheels()[0].counters.samples_lost == 0
    assert_agree(run_batch(stream(first + second))[0], results)


@pytest.mark.parametrize(
    ("change", "gain", "zero"),
    [
        ({"scale_mps2": (0.0, 0.0, 0.1), "range_mps2": (0.0, 0.0, 39240.0)}, 2.0, 0.0),
        ({"offset_counts": (0.0, 0.0, 4000.0)}, 1.0, 200.0),
    ],
)
def test_no_revolution_is_of_samples_of_two_ranges(roll, to_frames, change, gain, zero) -> None:
    signal = roll(65.0, 1.4).radial_mps2
    half = len(signal) // 2 // 36 * 36
    second = to_frames((signal[half:] + zero) / gain, first_sample=half, start_us=half * 10**6 // 9600, **change)
    results, pipeline = run_live(stream(to_frames(signal[:half]) + second), estimators=("kinematic",))
    assert len(results) >= 5
    means = np.array([result.revolution.radial_mps2.mean() for result in results])
    assert np.abs(means / means[0] - 1.0).max() < 0.01
    assert pipeline.wheels()[0].counters.samples_lost == 0


def test_a_hello_that_says_the_same_of_the_samples_restarts_nothing(roll, to_frames) -> None:
    frames = to_frames(roll(65.0, 1.0).radial_mps2)
    clean, _ = run_live(stream(frames), estimators=("kinematic",))
    for change in ({}, {"scale_mps2": (0.1, 0.1, 0.05), "firmware": (1, 2, 4)}):
        again = to_frames(np.zeros(0), **change)[0]._replace(tick_us=frames[130].tick_us)
        results, _ = run_live(stream([*frames[:130], again, *frames[130:]]), estimators=("kinematic",))
        assert [r.revolution.period_s for r in results] == [r.revolution.period_s for r in clean]


@pytest.mark.parametrize("boot_count", [1, 2])
def test_another_sensor_begins_a_new_tire_also_where_the_hub_has_restarted(roll, to_frames, boot_count) -> None:
    frames = to_frames(roll(65.0, 1.0).radial_mps2, sensor_id=0xA)
    for sensor_id, is_kept in ((0xA, True), (0xB, False)):
        hello = to_frames(np.zeros(0), sensor_id=sensor_id, boot_count=boot_count)[:1]
        _, pipeline = run_live(stream(frames + hello), estimators=("kinematic",))
        assert (pipeline.average_mps2("FL") is not None) == is_kept


def test_stream_may_end_before_every_wheel_of_a_restarted_hub_has_said_hello(roll, to_frames) -> None:
    first, other = (to_frames(roll(65.0, 1.0).radial_mps2, wheel=wheel) for wheel in (0, 1))
    again = to_frames(np.zeros(0), boot_count=2)
    results, pipeline = run_live(stream([*first, *other, *again]), SETUPS[:2], estimators=("kinematic",))
    assert {result.position for result in results} == {"W0", "W1"}
    assert [wheel.state for wheel in pipeline.wheels()] == [WheelState.NO_DATA] * 2


def test_long_gap_is_not_interpolated(roll, to_frames):
    frames = to_frames(roll(65.0, 8.0).radial_mps2)
    results, pipeline = run_live(stream(frames[:800] + frames[1300:]))
    assert pipeline.wheels()[0].counters.samples_lost == 500 * 36
    periods = np.array([result.revolution.period_s for result in results])
    assert abs(periods / np.median(periods) - 1).max() < 0.01


@pytest.mark.parametrize(("missing", "silent_s"), [(500, 1.875), (200, 0.0)])
def test_samples_that_are_missing_for_a_second_are_silence_and_no_loss(roll, to_frames, missing, silent_s):
    frames = to_frames(roll(65.0, 8.0).radial_mps2)
    _, pipeline = run_live(stream(frames[:800] + frames[800 + missing :]))
    counters = pipeline.wheels()[0].counters
    assert counters.samples_lost == missing * 36
    assert counters.silent_s == pytest.approx(silent_s)
    assert counters.lost_while_heard == (0 if silent_s else missing * 36)


def test_saturated_revolutions_are_not_averaged(roll, to_frames):
    signal = roll(65.0, 3.0).radial_mps2
    results, pipeline = run_live(stream(to_frames(signal, saturation_counts=round(1300 / 0.05))))
    assert results
    assert all(result.revolution.saturated for result in results)
    assert pipeline.wheels()[0].counters.samples_saturated > 50
    assert pipeline.wheels()[0].average_mps2 is None


def test_unknown_load_gives_ratios_only(roll, to_frames):
    setup = dataclasses.replace(SETUP, load_n=None)
    results, _ = run_live(stream(to_frames(roll(65.0, 4.0).radial_mps2)), (setup,))
    estimates = {estimate.name: estimate for estimate in results[-1].estimates}
    for name in ("Bs", "Cw", "Rs", "Ts"):
        assert estimates[name].status is Status.INVALID
        assert RingCode.NEEDS_LOAD in codes_of(estimates[name].reasons)
    assert estimates["Rs/Cw"].value > 0


def test_pressure_applies_from_its_time(roll, to_frames):
    frames = to_frames(roll(65.0, 3.0).radial_mps2)
    position = 400
    later = frames[position]._replace(
        type=int(MessageType.ENVIRONMENT), message=Environment(190e3, 41.0, None), seq=10**6
    )
    results, _ = run_live(stream([*frames[:position], later, *frames[position:]]))
    pressures = [result.conditions.pressure_pa for result in results]
    assert set(pressures) == {210e3, 190e3}
    assert pressures == sorted(pressures, reverse=True)
    assert results[-1].conditions.temperature_degc == pytest.approx(41.0, abs=0.1)


@pytest.mark.parametrize("reading", [Environment(-300e3, 30.0, None), Environment(220e6, 30.0, None)])
def test_a_pressure_that_no_tire_has_is_not_used(roll, to_frames, reading):
    frames = to_frames(roll(65.0, 3.0).radial_mps2)
    false = frames[400]._replace(type=int(MessageType.ENVIRONMENT), message=reading, seq=10**6)
    results, _ = run_live(stream([*frames[:400], false, *frames[400:]]))
    assert {result.conditions.pressure_pa for result in results} == {210e3}
    assert {result.conditions.temperature_degc for result in results} == {35.0}


@pytest.mark.parametrize("pressure_pa", [-1300.0, 0.0])
def test_a_flat_tire_below_the_barometer_has_speed_and_contact(roll, to_frames, pressure_pa):
    results, _ = run_live(stream(to_frames(roll(65.0, 2.0).radial_mps2, pressure_pa=pressure_pa)))
    assert {result.conditions.pressure_pa for result in results} == {pressure_pa}
    statuses = {estimate.name: estimate.status for estimate in results[-1].estimates}
    assert {statuses["speed_mps"], statuses["contact_length_m"], statuses["Rs/Cw"]} == {Status.VALID}
    assert {statuses["Bs"], statuses["Rs"]} == {Status.INVALID}


def test_unconfigured_wheels_are_estimated(roll, to_frames):
    results, pipeline = run_live(stream(to_frames(roll(65.0, 3.0).radial_mps2, wheel=7)), ())
    assert {result.position for result in results} == {"hub0.wheel7"}
    assert [wheel.position for wheel in pipeline.wheels()] == ["hub0.wheel7"]


def test_samples_before_hello_are_dropped(roll, to_frames):
    frames = to_frames(roll(65.0, 3.0).radial_mps2)
    results, _ = run_live(stream([*frames[2:100], frames[0], *frames[100:]]))
    assert len(results) >= 22


def test_jump_of_sample_numbers_loses_no_samples(roll, to_frames):
    rolling = roll(40.0, 3.0)
    frames = to_frames(rolling.radial_mps2)
    half = len(frames) // 2
    jumped = [
        frame._replace(message=frame.message._replace(first_sample=frame.message.first_sample + 2**30))
        if index > half
        else frame
        for index, frame in enumerate(frames)
    ]
    pipeline = Pipeline((), UNKNOWN)
    results = pipeline.frames("x", jumped, 0) + pipeline.finish()
    (wheel,) = pipeline.wheels()
    assert wheel.counters.samples_lost == 0
    assert wheel.counters.samples == 36 * (len(frames) - 2)
    assert len(results) > 8


def test_numbers_that_the_clock_covers_are_lost(roll, to_frames):
    frames = to_frames(roll(40.0, 3.0).radial_mps2)
    pipeline = Pipeline((), UNKNOWN)
    pipeline.frames("x", frames[:200] + frames[400:], 0)
    (wheel,) = pipeline.wheels()
    assert wheel.counters.samples_lost == 200 * 36


def test_radial_axis_of_scale_0_is_not_used(roll, to_frames):
    frames = to_frames(roll(40.0, 1.0).radial_mps2)
    flat = frames[0]._replace(message=frames[0].message._replace(scale_mps2=(0.0, 0.0, 0.0)))
    pipeline = Pipeline((), UNKNOWN)
    assert pipeline.frames("x", [flat, *frames[1:]], 0) + pipeline.finish() == []
    (wheel,) = pipeline.wheels()
    assert wheel.counters.samples == 0


def test_hub_itself_is_no_wheel(roll, to_frames):
    frames = to_frames(roll(40.0, 1.0).radial_mps2, wheel=255)
    pipeline = Pipeline((), UNKNOWN)
    assert pipeline.frames("x", frames, 0) + pipeline.finish() == []
    assert pipeline.wheels() == ()


@pytest.fixture(scope="module")
def held(four_wheels):
    """Return the results of four wheels that wait for 0.2 s."""
    return arrivals_ns(stream(four_wheels, step_ns=938_000), 0.2)


def test_held_revolutions_agree_and_come_in_time(at_once, held):
    at_once, came_ns, rest = at_once
    held, later_ns, held_rest = held
    assert_agree([*held, *held_rest], [*at_once, *rest])
    first_ns = {(r.position, r.revolution.index): position for r, position in zip(at_once, came_ns, strict=True)}
    waits = [position - first_ns[r.position, r.revolution.index] for r, position in zip(held, later_ns, strict=True)]
    assert min(waits) >= 0
    assert max(waits) <= 0.2e9 + 20e6
    assert max(later_ns.count(position) for position in later_ns) > 1


def test_wheels_of_a_hub_come_together(held):
    results, came_ns, _ = held
    assert len({result.position for result in results}) > 1
    apart_ns = np.diff(np.unique(came_ns))
    assert len(apart_ns) > 5
    assert ((apart_ns < 20e6) | (apart_ns > 150e6)).all()


def test_snapshot_counts_samples_that_decide_nothing(roll, to_frames):
    hello, environment, *blocks = to_frames(roll(65.0, 1.0).radial_mps2)
    pipeline = Pipeline((SETUP,), UNKNOWN)
    pipeline.frames("link", [hello, environment], 10**18)
    for begin in range(0, len(blocks), 7):
        for block in blocks[begin : begin + 7]:
            pipeline.frames("link", [block], 10**18)
        came = sum(len(block.message.counts) for block in blocks[: begin + 7])
        assert pipeline.wheels()[0].counters.samples == came


def test_snapshot_is_new_only_after_a_change(roll, to_frames):
    frames = to_frames(roll(65.0, 1.0).radial_mps2)
    _, pipeline = run_live(stream(frames))
    (before,) = pipeline.wheels()
    assert pipeline.wheels()[0] is before
    reading = frames[-1]._replace(type=int(MessageType.ENVIRONMENT), message=Environment(190e3, 41.0, None))
    pipeline.frames("link", [reading], 10**18)
    assert before.pressure_pa != 190e3
    assert pipeline.wheels()[0].pressure_pa == 190e3


def test_revolutions_of_a_silent_wheel_do_not_wait(four_wheels):
    pipeline = Pipeline((SETUP,), UNKNOWN, ("kinematic",), hold_s=0.2)
    stops = len(four_wheels) // 2
    results = []
    for index, frame in enumerate(four_wheels):
        if index < stops or frame.wheel:
            results += pipeline.frames("link", [frame], 10**18 + index * 938_000)
    of_wheel = [result for result in results if result.position == "FL"]
    assert len(of_wheel) > 10
    assert not [result for result in pipeline.complete("link") if result.position == "FL"]


def test_revolutions_do_not_wait_for_a_hub_clock_that_stands_still(four_wheels):
    pipeline = Pipeline((SETUP,), UNKNOWN, ("kinematic",), hold_s=0.2)
    first = four_wheels[0].tick_us
    results = []
    for index, frame in enumerate(four_wheels):
        results += pipeline.frames("link", [frame._replace(tick_us=first)], 10**18 + index * 938_000)
    assert len(results) > 0.85 * len([*results, *pipeline.finish()])


def with_hellos(frames):
    """Return frames of one sensor with its hello every two seconds."""
    first, repeated = frames[0], 0
    for frame in frames:
        if frame.tick_us >= 2_000_000 * (repeated + 1):
            repeated += 1
            yield first._replace(tick_us=frame.tick_us)
        yield frame


@pytest.mark.parametrize("run", [run_live, run_batch])
def test_sensors_that_share_a_wheel_number_leave_nothing_valid(roll, to_frames, run) -> None:
    signal = roll(65.0, 10.0).radial_mps2
    frames, other = (
        list(with_hellos(to_frames(signal, sensor_id=serial, start_us=start_us)))
        for serial, start_us in ((1, 0), (2, 3_000_000))
    )
    shared = sorted(frames + other, key=lambda frame: frame.tick_us)
    exchanged = [frame for frame in frames if frame.tick_us < 3_000_000] + other
    results, _ = run(stream(shared))
    late = [result for result in results if result.revolution.start_s > 7.0]
    assert late
    for estimate in (estimate for result in late for estimate in result.estimates):
        assert estimate.status is not Status.VALID, estimate
    assert any(WheelCode.SENSORS_SHARE_NUMBER in codes_of(e.reasons) for result in late for e in result.estimates)
    results, _ = run(stream(exchanged))
    assert not any(
        WheelCode.SENSORS_SHARE_NUMBER in codes_of(e.reasons) for result in results for e in result.estimates
    )
    assert any(e.status is Status.VALID for e in results[-1].estimates)
