"""Loss on the link: revolutions kept out of averages, and angles without a sample filled by the shape before."""

import math
from dataclasses import replace

import numpy as np
import pytest

import treadlink
from firmware_protocol.messages import Axis
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.contacts.contact_timing import MOST_UNSEEN
from gateway.core.estimates.estimator import Estimate, Revolution, Status, not_used
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import RevolutionArrays
from gateway.core.estimates.wheel_setup import SensorClaims, WheelSetup
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.angle_resampling import angle_grid, elapsed_angles, fit_phase
from gateway.core.trust.lost_revolutions import LossStreak, SteadyStatus
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.sensor_health import SensorHealth
from gateway.core.wheels.gap_filling import GapFilling, angles_in_gaps
from gateway.core.wheels.reasons import WheelCode
from gateway.core.wheels.tire_estimates import TireEstimates
from tests.testkit.exact_ring import solution
from tests.testkit.revolution_data import exact_wave, make_revolution
from tests.testkit.simulated_wheel import last, restated

STEADY = "[sensor]\nrange_g = 1000\n[motion]\nspeed_kmh = 90"
SETUP = WheelSetup("FL", 0, 0, 0.32, radius_std_m=0.0032, load_n=5000.0, pressure_pa=210e3)
CLEAN = make_revolution(exact_wave(solution()))
LOST = (Reason(EstimateCode.SAMPLES_LOST),)


def revolution(*faults: Reason) -> Revolution:
    return replace(CLEAN, faults=faults)


class Losses:
    """One estimator behind one link."""

    def __init__(self, estimator: str) -> None:
        self._link, self._status = LossStreak(), SteadyStatus(estimator)

    def steadied(self, estimates: tuple[Estimate, ...], taken: Revolution) -> tuple[Estimate, ...]:
        return self._status.steadied(estimates, self._link.take(taken))


def number(status: Status, *reasons: Reason, std: float = 0.01) -> tuple[Estimate, ...]:
    return (Estimate("Bs", 1.0, std, status, reasons),)


def test_average_stays_valid_through_loss_as_long_as_its_memory() -> None:
    losses = Losses("weak-form")
    losses.steadied(number(Status.VALID, std=0.02), revolution())
    statuses = []
    for _ in range(quantity_of("Bs").memory_revolutions + 1):
        (estimate,) = losses.steadied(number(Status.PROVISIONAL, not_used(LOST)), revolution(*LOST))
        statuses.append(estimate.status)
        assert estimate.reasons == (not_used(LOST),)
    assert estimate.status is Status.PROVISIONAL
    assert set(statuses[:-1]) == {Status.VALID}


def test_load_of_a_drive_is_held_no_longer_than_edges_of_a_contact() -> None:
    losses = Losses("load")
    valid = (Estimate("load_by_width_n", 4000.0, 80.0, Status.VALID),)
    assert losses.steadied(valid, CLEAN) == valid
    held = (valid[0]._replace(status=Status.PROVISIONAL, reasons=(not_used(LOST),)),)
    statuses = [losses.steadied(held, revolution(*LOST))[0].status for _ in range(MOST_UNSEEN + 1)]
    assert statuses == [Status.VALID] * MOST_UNSEEN + [Status.PROVISIONAL]


def test_held_average_has_at_least_the_error_that_it_had() -> None:
    losses = Losses("weak-form")
    losses.steadied(number(Status.VALID, std=0.02), revolution())
    (estimate,) = losses.steadied(number(Status.PROVISIONAL, not_used(LOST)), revolution(*LOST))
    assert estimate.std == 0.02


@pytest.mark.parametrize(
    ("faults", "reasons"),
    [
        ((Reason(EstimateCode.RADIAL_SATURATED),), (not_used((Reason(EstimateCode.RADIAL_SATURATED),)),)),
        ((*LOST, Reason(WheelCode.SEVERAL_TURNS, turns=2.0)), (not_used(LOST),)),
        (LOST, (not_used(LOST), Reason(WheelCode.RADIAL_CLIPPED))),
    ],
)
def test_anything_but_loss_lowers_the_status_at_once(faults: tuple[Reason, ...], reasons: tuple[Reason, ...]) -> None:
    losses = Losses("weak-form")
    losses.steadied(number(Status.VALID), revolution())
    (estimate,) = losses.steadied(number(Status.PROVISIONAL, *reasons), revolution(*faults))
    assert estimate.status is Status.PROVISIONAL
    # What was in doubt is not taken up again by the next loss.
    (estimate,) = losses.steadied(number(Status.PROVISIONAL, not_used(LOST)), revolution(*LOST))
    assert estimate.status is Status.PROVISIONAL


@pytest.fixture(scope="module")
def tenth_lost() -> tuple[treadlink.Recording, treadlink.Estimates]:
    """Four wheels in steady driving of which a tenth of the frames was lost."""
    recording = treadlink.simulate("demo", duration_s=20, faults=["drop:rate=0.1"])
    return recording, recording.estimates()


def changed_revolutions(estimates: treadlink.Estimates, wheel: str, first: int) -> tuple[set[int], int]:
    """Return revolutions of a wheel in which the status of any estimate changes, and how many there are."""
    of_wheel = (estimates.wheel == wheel) & (estimates.revolution >= first)
    changed: set[int] = set()
    # The drift of wear becomes valid once, with its fourth value.
    for name in set(estimates.name) - {"wear_drift_mm"}:
        rows = of_wheel & (estimates.name == name)
        status = estimates.status[rows]
        changed |= set(estimates.revolution[rows][1:][status[1:] != status[:-1]].tolist())
    return changed, len(set(estimates.revolution[of_wheel].tolist()))


def test_status_does_not_flicker_at_ten_percent_loss(
    tenth_lost: tuple[treadlink.Recording, treadlink.Estimates],
) -> None:
    recording, estimates = tenth_lost
    changed, counts = zip(*(changed_revolutions(estimates, wheel, 60) for wheel in recording.truth), strict=True)
    assert sum(map(len, changed)) < 0.01 * sum(counts)


def bursts(share: float, blocks: float, end: int, seed: int) -> frozenset[int]:
    """Return the indices of blocks, up to `end`, that are lost in bursts of a mean length, a share of all."""
    rng, index = np.random.default_rng(seed), 40
    lost: set[int] = set()
    while index < end:
        length = rng.geometric(1.0 / blocks)
        lost |= set(range(index, index + length))
        index += length + rng.geometric(share / (blocks * (1.0 - share)))
    return frozenset(lost)


@pytest.mark.parametrize(("share", "blocks", "seed"), [(0.3, 8.0, 2), (0.5, 8.0, 5), (0.5, 16.0, 3), (0.5, 16.0, 5)])
def test_speed_is_right_once_bursts_that_hid_contacts_have_ended(share: float, blocks: float, seed: int) -> None:
    """Contacts that bursts of half a revolution leave may be two turns apart, or be overshoots of an edge."""
    results, _ = restated(STEADY, 10.0, SETUP, ("kinematic",), dropped=bursts(share, blocks, 1600, seed))
    speeds = [result.estimates[0] for result in results]
    during, after = speeds[:-40], speeds[-40:]
    assert [speed for speed in during if speed.status is Status.VALID and abs(speed.value - 25.0) > 0.3 * 25.0] == []
    assert all(speed.status is Status.VALID and abs(speed.value - 25.0) < 3.0 * speed.std for speed in after)


def test_streak_is_as_long_as_what_the_average_lacks() -> None:
    """Where one revolution in four is averaged, an average over sixteen spans sixty-four."""
    streak = LossStreak()
    for _ in range(200):
        lengths = [streak.take(revolution(*LOST)) for _ in range(3)]
        assert streak.take(CLEAN) == 0.0
    assert lengths == pytest.approx([0.25, 0.5, 0.75], rel=0.02)
    assert streak.take(revolution(Reason(EstimateCode.RADIAL_SATURATED))) == 0.0


@pytest.mark.parametrize(("errors", "status"), [(2.9, Status.VALID), (2.6, Status.VALID), (2.4, Status.PROVISIONAL)])
def test_value_is_determined_until_it_is_beyond_the_limit_by_more_than_chance(errors: float, status: Status) -> None:
    why = (
        Reason(CoreCode.NOT_DETERMINED, relative_error=1.0 / errors),
        Reason(CoreCode.MODEL_ERROR_SHARE, share=0.5),
    )
    losses = Losses("weak-form")
    (before,) = losses.steadied(number(Status.PROVISIONAL, *why), CLEAN)
    assert before.status is Status.PROVISIONAL  # it was not determined before
    losses.steadied(number(Status.VALID), CLEAN)
    for _ in range(3):
        (estimate,) = losses.steadied(number(Status.PROVISIONAL, *why), CLEAN)
        assert (estimate.status, estimate.reasons) == (status, () if status is Status.VALID else why)


def test_note_on_an_error_does_not_end_what_is_held() -> None:
    losses = Losses("weak-form")
    losses.steadied(number(Status.VALID), CLEAN)
    note = Reason(EstimateCode.SCALE_BY_WIDTH, ratio=1.0, std=0.02, error=0.03)
    (estimate,) = losses.steadied(number(Status.PROVISIONAL, not_used(LOST), note), revolution(*LOST))
    assert (estimate.status, estimate.reasons) == (Status.VALID, (not_used(LOST), note))


@pytest.mark.parametrize("reasons", [(), (Reason(TrustCode.OTHER_OFFSET_STATED, stated_m=0.003),)])
def test_status_that_an_estimator_lowers_by_the_same_reasons_is_lowered_at_once(reasons: tuple[Reason, ...]) -> None:
    losses = Losses("weak-form")
    losses.steadied(number(Status.VALID, *reasons), CLEAN)
    lowered = number(Status.PROVISIONAL, *reasons)
    assert losses.steadied(lowered, CLEAN) == lowered


def test_speed_is_valid_and_right_at_ten_percent_loss(
    tenth_lost: tuple[treadlink.Recording, treadlink.Estimates],
) -> None:
    recording, estimates = tenth_lost
    valid, pulls = [], []
    for wheel, truth in recording.truth.items():
        bottoms_s = truth.bottom_times_s(0.0, 20.0)
        rows = (estimates.wheel == wheel) & (estimates.name == "angular_speed_radps")
        is_valid = estimates.status[rows] == "valid"
        valid += is_valid.tolist()
        for start_s, end_s, value, std in zip(
            *(column[rows][is_valid] for column in (estimates.device_start_s, estimates.device_end_s)),
            estimates.value[rows][is_valid],
            estimates.std[rows][is_valid],
            strict=True,
        ):
            first, last = (int(np.argmin(np.abs(bottoms_s - time_s))) for time_s in (start_s, end_s))
            if last > first:
                true = 2.0 * math.pi * (last - first) / (bottoms_s[last] - bottoms_s[first])
                pulls.append((value - true) / std)
    assert np.mean(valid) > 0.9
    assert np.max(np.abs(pulls)) < 3.5


@pytest.mark.parametrize("faults", [["drop:rate=0.01"], ["drop:rate=0.1"]])
def test_status_is_steady_and_numbers_are_right_through_loss(faults: list[str]) -> None:
    recording = treadlink.simulate("lab", duration_s=20, faults=faults)
    estimates, clean = recording.estimates(), treadlink.simulate("lab", duration_s=20).estimates()
    late = estimates.revolution >= 60
    for name in sorted(set(estimates.name) - {"wear_drift_mm"}):
        rows = late & (estimates.name == name)
        status = estimates.status[rows]
        same = clean.name == name
        if (clean.status[same][-1]) == "valid":
            assert np.mean(status == "valid") > 0.99, name
            pulls = (estimates.value[rows] - clean.value[same][-1]) / estimates.std[rows]
            assert np.abs(pulls).max() < 3.5 or name == "distance_m", name
    (wheel,) = set(estimates.wheel)
    changed, count = changed_revolutions(estimates, wheel, 60)
    assert len(changed) <= 0.01 * count


N = 256
SHAPE = np.stack([np.sin(angle_grid(N)), np.cos(3.0 * angle_grid(N)), 1.0 - np.exp(-((angle_grid(N) / 0.3) ** 2))])


def axes(omega_radps: float, constant: float = 0.0, ramp: float = 0.0) -> np.ndarray:
    turned = elapsed_angles(N)
    row = SHAPE * omega_radps**2 + constant + ramp * turned
    row[Axis.RADIAL] += STANDARD_GRAVITY_MPS2 * np.cos(angle_grid(N))
    return row


def gap(first: int, end: int) -> np.ndarray:
    inside = np.zeros(N, np.bool_)
    inside[first:end] = True
    return inside


def test_gap_is_filled_at_its_speed_with_the_constant_and_ramp_of_its_revolution() -> None:
    filling = GapFilling()
    for omega in (50.0, 51.0, 52.0, 53.0):
        assert filling.take(axes(omega), omega, None, "state", 0.0)
    true = axes(60.0, constant=3.0, ramp=0.5)
    damaged = true.copy()
    damaged[:, 20:60] = 999.0
    assert filling.take(damaged, 60.0, gap(20, 60), "state", 0.0)
    np.testing.assert_allclose(damaged, true, atol=1e-6)


def test_gravity_in_a_gap_is_that_of_any_speed() -> None:
    """A wheel that sets off turns several times as fast as some revolutions ago."""
    filling = GapFilling()
    for omega in (10.0, 12.0, 14.0, 16.0):
        filling.take(axes(omega), omega, None, "state", 0.0)
    damaged = axes(30.0)
    damaged[:, 20:60] = 999.0
    assert filling.take(damaged, 30.0, gap(20, 60), "state", 0.0)
    np.testing.assert_allclose(damaged, axes(30.0), atol=1e-6)


def test_absent_axis_stays_absent_and_alone() -> None:
    filling = GapFilling()
    for _ in range(4):
        row = axes(50.0)
        row[1] = math.nan
        filling.take(row, 50.0, None, "state", 0.0)
    damaged = axes(50.0)
    damaged[1] = math.nan
    damaged[[0, 2], 20:60] = 999.0
    assert filling.take(damaged, 50.0, gap(20, 60), "state", 0.0)
    np.testing.assert_allclose(damaged[[0, 2]], axes(50.0)[[0, 2]], atol=1e-6)
    assert np.isnan(damaged[1]).all()


def test_shape_may_come_from_revolutions_with_other_gaps() -> None:
    filling = GapFilling()
    for begin in (0, 40, 80, 120, 160, 200):
        row = axes(50.0)
        row[:, begin : begin + 30] = 999.0
        is_whole = filling.take(row, 50.0, gap(begin, begin + 30), "state", 0.0)
    # Four revolutions before have samples there.
    assert is_whole
    np.testing.assert_allclose(row, axes(50.0), atol=1e-6)


@pytest.mark.parametrize("why", ["too few before", "more filled than measured", "another state", "after a pause"])
def test_gap_without_a_shape_for_it_is_left(why: str) -> None:
    filling = GapFilling()
    for _ in range(3 if why == "too few before" else 4):
        filling.take(axes(50.0), 50.0, None, "state", 0.0)
    inside = gap(0, 150 if why == "more filled than measured" else 40)
    damaged = axes(50.0)
    damaged[:, inside] = 999.0
    assert not filling.take(
        damaged, 50.0, inside, "other" if why == "another state" else "state", 11.0 if why == "after a pause" else 0.0
    )
    assert (damaged[:, inside] == 999.0).all()


def test_gap_between_two_angles_of_the_grid_leaves_the_revolution_whole() -> None:
    # 40 samples lie between two angles of the grid.
    inside = angles_in_gaps([(12, 28)], fit_phase(0.0, 40.0 * N), N)
    assert not inside.any()
    filling = GapFilling()
    for _ in range(2):
        row = axes(50.0)
        assert filling.take(row, 50.0, inside, "state", 0.0)
        np.testing.assert_array_equal(row, axes(50.0))


def test_angles_in_gaps_are_those_between_the_samples_beside_them() -> None:
    phase = fit_phase(100.0, 356.0)
    inside = angles_in_gaps([(150, 160)], phase, N)
    turned = elapsed_angles(N)[inside] / (2.0 * math.pi) * 256.0 + 100.0
    assert 145.0 < turned.min() <= 149.0
    assert 160.0 <= turned.max() < 164.0


def scattered(longest: int, gaps: int, end: int, seed: int) -> tuple[tuple[int, int], ...]:
    """Return gaps of up to so many samples at random places up to `end`, in order and apart."""
    rng = np.random.default_rng(seed)
    places = np.unique(rng.integers(1000, end, gaps))
    places = places[np.diff(places, append=end + 1000) > longest + 1]
    return tuple((first, first + int(rng.integers(1, longest + 1))) for first in places.tolist())


@pytest.mark.parametrize(("longest", "gaps"), [(1, 240), (5, 120), (1, 700)])
def test_gaps_of_a_few_samples_are_bridged_with_their_error(longest: int, gaps: int) -> None:
    """72,000 samples, 900 in a revolution; the truth is the ring's."""
    estimators = ("kinematic", "weak-form", "ply-steer")
    clean, _ = restated(STEADY, 7.5, SETUP, estimators)
    results, snapshot = restated(STEADY, 7.5, SETUP, estimators, gaps=scattered(longest, gaps, 71_000, 3))
    assert 0.9 * gaps < snapshot.counters.samples_lost < 4.0 * gaps
    assert len(results) == len(clean)
    usable = [not result.revolution.faults for result in results]
    # Only the first ones, before which no revolution shows what stands in their gaps.
    assert all(usable[10:])
    expected = last(clean)
    for name, estimate in last(results).items():
        assert estimate.status is expected[name].status, name
        if estimate.status is Status.VALID:
            assert abs(estimate.value - expected[name].value) < 1.5 * estimate.std, name
    for result in results[10:]:
        speed = result.estimates[0]
        assert speed.name == "speed_mps"
        assert abs(speed.value - 25.0) < 3.0 * speed.std
        # The error of the contact's place is that of its samples, not that of a place between two others.
        assert result.revolution.period_std_s < 1.5 * clean[-1].revolution.period_std_s


def test_gaps_in_every_contact_from_the_first_on_leave_an_average() -> None:
    """What fits into a step of the contact's edge at a level crossing does not hide the contact."""
    results, _ = restated(STEADY, 7.5, SETUP, ("kinematic",), gaps=tuple((i, i + 1) for i in range(100, 71_000, 50)))
    faults = [fault.code for result in results[12:] for fault in result.revolution.faults]
    assert faults == []


def witnesses_after(revolutions: list[Revolution]) -> tuple[dict[str, object], SensorHealth]:
    """Return what the watchers of a wheel hold against what is stated, after revolutions of it."""
    tire = TireEstimates(replace(SETUP, sensor=SensorClaims(offset_m=0.0, offset_std_m=1e-4)), ("kinematic",))
    tire.take_block(RevolutionArrays(revolutions), [r.start_s for r in revolutions], [0] * len(revolutions), [()] * 96)
    health = SensorHealth((0, 1, 2), np.ones(3), np.zeros(3), 9600.0, is_dc=True)
    health.revolutions(revolutions)
    return {flag.name: flag.reason for flag in tire.flags()}, health


def distorted(kind: str, missing: float) -> list[Revolution]:
    """Return sound revolutions, then some of which a part was lost, with what stands there wrong in one way."""
    sound = exact_wave(solution())
    n = len(sound)
    revolutions = []
    for index in range(96):
        wave = sound.copy()
        is_lossy = index >= 16
        if is_lossy and kind == "gravity":
            wave += 8.0 * np.cos(angle_grid(n))
        elif is_lossy and kind == "steady value":
            wave *= 0.85
        elif is_lossy and kind == "coupling":
            wave -= 0.9 * wave.mean()
        elif is_lossy and kind == "loose":
            behind = np.clip(angle_grid(n) - 0.3, 0.0, None)
            wave += 0.2 * sound.mean() * np.sin(60.0 * behind) * np.exp(-behind / 0.4) * (behind > 0.0)
        made = make_revolution(wave, missing_fraction=missing if is_lossy else 0.0)
        axes_mps2 = np.stack([np.full(n, math.nan), np.full(n, math.nan), wave])
        omega_dot = 0.01 * (1 + index % 2)
        revolutions.append(replace(made, index=index, axes_mps2=axes_mps2, omega_dot_radps2=omega_dot, rate_hz=9600.0))
    return revolutions


@pytest.mark.parametrize("kind", ["gravity", "steady value", "coupling", "loose"])
def test_revolutions_with_gaps_are_no_evidence(kind: str) -> None:
    for missing in (0.0, 0.003, 0.05, 0.4):
        flags, health = witnesses_after(distorted(kind, missing))
        is_raised = bool(health.doubt()) if kind == "loose" else kind in flags
        # Single samples leave a revolution to speak for itself.
        assert is_raised is (missing < 0.01), (missing, flags)
