"""Pace of renewals: its bound, its independence of blocks, and what applies in spite of it."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.estimates.estimator import Estimate, Revolution, Status
from gateway.core.estimates.pace import LONGEST, differ, is_due
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.revolution_block import RevolutionArrays
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.quantity import Basis
from gateway.core.reasons import Reason, codes_of
from gateway.core.trust import self_calibration
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.sensor_limits import Doubt
from gateway.core.trust.signal_evidence import Contradiction, Evidence, Subject
from gateway.core.wheels import tire_estimates
from gateway.core.wheels.reasons import WheelCode
from gateway.core.wheels.tire_estimates import TireEstimates
from gateway.forces import ply_steer
from gateway.ring import weak_form
from tests.testkit.simulated_wheel import simulated

SETUP = WheelSetup("FL", 0, 0, 0.32, load_n=4200.0, pressure_pa=210e3)
ESTIMATORS = ("kinematic", "self-calibration", "weak-form", "wear", "load", "ply-steer", "slip-angle", "asynchronous")
SCENARIO = "[sensor]\nrange_g = 1000\noffset_mm = 4\n[motion]\nspeed_kmh = [[0, 50], [6, 65], [16, 60], [20, 90]]"


@pytest.fixture(scope="module")
def revolutions() -> list[Revolution]:
    return [result.revolution for result in simulated(SCENARIO, 20.0, SETUP, ("kinematic",))[0]]


def estimated(
    revolutions: Sequence[Revolution],
    sizes: int | Sequence[int] = 16,
    names: Sequence[str] = ESTIMATORS,
    doubts: Sequence[tuple[Doubt, ...]] | None = None,
) -> list[RevolutionResult]:
    tire = TireEstimates(SETUP, names)
    doubts = [()] * len(revolutions) if doubts is None else doubts
    results: list[RevolutionResult] = []
    steps = [sizes] if isinstance(sizes, int) else sizes
    while len(results) < len(revolutions):
        first = len(results)
        rows = slice(first, first + steps[first % len(steps)])
        ends = [1e6 * (revolution.start_s + revolution.period_s) for revolution in revolutions[rows]]
        results += tire.take_block(
            RevolutionArrays(revolutions[rows]), ends, [round(1e3 * end) for end in ends], doubts[rows]
        )
    return results


def difference(first: Estimate, other: Estimate) -> float:
    """Return the difference in standard errors; relative where there is none."""
    assert (first.name, first.status) == (other.name, other.status)
    if first.status is Status.INVALID or first.value == other.value:
        return 0.0
    return abs(first.value - other.value) / (first.std if first.std > 0.0 else abs(first.value))


def test_renewals_are_sparse_and_never_stop() -> None:
    due = [count for count in range(1, 400) if is_due(count)]
    assert due[:8] == [1, 2, 4, 8, 16, 32, 64, 128]
    assert set(np.diff(due[7:]).tolist()) == {LONGEST}


def test_unknown_condition_differs_from_known_only() -> None:
    renewed, allowed = np.array([math.nan, 2.0]), np.array([10.0, 1.0])
    now = np.array([[math.nan, 1.0], [1.0, 2.0], [math.nan, 3.5], [math.nan, math.nan]])
    assert differ(now, renewed, allowed).tolist() == [False, True, True, True]


@pytest.mark.parametrize("sizes", [16, (3, 64, 1, 7)])
def test_block_sizes_do_not_change_estimates(revolutions: list[Revolution], sizes: int | tuple[int, ...]) -> None:
    faulty = [
        replace(revolution, faults=(Reason(EstimateCode.SAMPLES_LOST),)) if index % 41 in (0, 5) else revolution
        for index, revolution in enumerate(revolutions)
    ]
    single, block = estimated(faulty, 1), estimated(faulty, sizes)
    for first, other in zip(single, block, strict=True):
        assert len(first.estimates) == len(other.estimates)
        assert max(difference(a, b) for a, b in zip(first.estimates, other.estimates, strict=True)) < 1e-9
        stds = [(a.std, b.std) for a, b in zip(first.estimates, other.estimates, strict=True) if a.std > 0.0]
        assert max(abs(b / a - 1.0) for a, b in stds) < 1e-9
        assert [codes_of(e.reasons) for e in first.estimates] == [codes_of(e.reasons) for e in other.estimates]


def test_lag_of_the_pace_is_far_below_the_error(revolutions: list[Revolution], monkeypatch: pytest.MonkeyPatch) -> None:
    """The bound that docs/explanation/estimators.md states."""
    names = ("weak-form", "ply-steer", "self-calibration")
    paced = estimated(revolutions, 16, names)
    for module in (weak_form, ply_steer, self_calibration):
        monkeypatch.setattr(module, "is_due", lambda _: True)
    fresh = estimated(revolutions, 16, names)
    apart: dict[str, list[float]] = {}
    stds: dict[str, list[float]] = {}
    for first, other in zip(fresh[8:], paced[8:], strict=True):
        for a, b in zip(first.estimates, other.estimates, strict=True):
            if Status.INVALID not in (a.status, b.status):
                apart.setdefault(a.name, []).append(abs(a.value - b.value) / a.std)
                stds.setdefault(a.name, []).append(b.std / a.std)
    assert {"Bs", "Cw", "Rs", "Ts", "ply_steer_first_half_rad", "sensor_offset_m"} <= apart.keys()
    for name, errors in apart.items():
        assert np.sqrt(np.mean(np.square(errors))) < 0.1, name
        assert max(errors) < 0.5, name
        assert 0.8 < np.median(stds[name]) < 1.25, name
        # The gain by gravity, which the error of the depth contains, moves from renewal to renewal.
        assert min(stds[name]) > (0.6 if name == "sensor_offset_m" else 0.7), name
        assert max(stds[name]) < 1.5, name


def test_fault_applies_in_its_own_revolution(revolutions: list[Revolution]) -> None:
    position = 110
    assert not is_due(position)
    faulty = list(revolutions)
    faulty[position] = replace(revolutions[position], faults=(Reason(WheelCode.RADIAL_CLIPPED),))
    results = estimated(faulty, 16, ("weak-form", "ply-steer"))
    for estimate in results[position].estimates:
        assert estimate.status is not Status.VALID or estimate.name == "sensor_roll_rad"
    for before, after in zip(results[position - 1].estimates, results[position + 1].estimates, strict=True):
        assert before.status is after.status


def test_doubt_applies_in_its_own_revolution(revolutions: list[Revolution]) -> None:
    position = 110
    doubt = Reason(TrustCode.AXIS_READS)
    doubts = [(Doubt(Basis.SAMPLES, doubt),) if index == position else () for index in range(len(revolutions))]
    results = estimated(revolutions, 16, ("kinematic", "weak-form"), doubts)
    assert [e.name for e in results[position].estimates if doubt not in e.reasons] == [
        "speed_mps",
        "angular_speed_radps",
        "rotation_rpm",
    ]
    assert not any(doubt in e.reasons for e in results[position + 1].estimates)


def test_contradiction_applies_in_its_own_revolution(
    revolutions: list[Revolution], monkeypatch: pytest.MonkeyPatch
) -> None:
    position, seen = 110, iter(range(len(revolutions)))
    assess = tire_estimates.assess
    against = Contradiction(Subject.STEADY, Reason(TrustCode.NO_SINGLE_CAUSE), {Basis.RADIUS: 1.3})

    def contradicted(*args: object, **options: object) -> Evidence:
        evidence = assess(*args, **options)  # type: ignore[arg-type]
        return evidence._replace(contradictions=(against,)) if next(seen) >= position else evidence

    monkeypatch.setattr(tire_estimates, "assess", contradicted)
    results = estimated(revolutions, 16, ("kinematic", "weak-form"))
    before, after = ({e.name: e for e in results[index].estimates} for index in (position - 1, position))
    assert before["Bs"].status is Status.VALID
    assert after["Bs"].status is Status.INVALID
    assert after["Bs/Cw"].status is Status.VALID
    assert after["speed_mps"].status is Status.INVALID
