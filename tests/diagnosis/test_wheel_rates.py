"""Turning wheel and camber rate: their sizes by recording, and revolutions without them."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from independent_tire.driving import MARGIN, OVERSAMPLED, Course, DrivenTire
from independent_tire.sideways import Sides
from independent_tire.steady import roll_steadily
from independent_tire.tires import TIRES

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.reasons import codes_of
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.data.revolution_orders import COLUMNS, RevolutionStore, RevolutionTable
from gateway.diagnosis.data.wheel_rates import WheelRate, without_rates
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import LATERAL
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.remainder.wheel_rate_sizes import rate_findings
from gateway.diagnosis.result import Verdict
from tools.generators.lateral_signals import Sensor, disturbed, through_pipeline

RADIUS_M, OMEGA_RADPS, COUNT = 0.32, 45.0, 240
SPEED_MPS = RADIUS_M * OMEGA_RADPS
DRIVEN_MPS = 18.0
SLALOM = 0.25 * np.sin(np.arange(COUNT) / 6.0) * (np.arange(COUNT) % 120 > 50)


def table(turn: np.ndarray, camber: np.ndarray, *, mean: float = 1.0, valid: float = 1.0) -> RevolutionTable:
    """Return revolutions whose lateral mean has `mean` times what their turn makes of it."""
    values = dict.fromkeys(COLUMNS, np.ones(COUNT)) | {
        "index": np.arange(COUNT),
        "omega_radps": np.full(COUNT, OMEGA_RADPS),
        "period_s": np.full(COUNT, 2.0 * math.pi / OMEGA_RADPS),
        "turn_radps": turn,
        "turn_shared_radps": np.full(COUNT, 0.006),
        "turn_scatter_radps": np.full(COUNT, 0.008),
        "turn_valid": np.full(COUNT, valid),
        "camber_radps": camber,
        "camber_shared_radps": np.full(COUNT, 0.003),
        "camber_scatter_radps": np.full(COUNT, 0.004),
    }
    orders = np.zeros((COUNT, 3, ORDERS), np.complex64)
    noise = np.random.default_rng(5).normal(0.0, 0.1, (2, COUNT))
    orders[:, LATERAL, 0] = 1.5 + mean * SPEED_MPS * turn + noise[0]
    orders[:, LATERAL, 1] = 3.0 - 2.0 * SPEED_MPS * (turn - 1j * camber) + noise[1]
    angle = np.linspace(-math.pi, math.pi, 256, endpoint=False)
    waveform = np.zeros((3, 256), np.float32)
    waveform[LATERAL] = orders[70, LATERAL, 0].real + (orders[70, LATERAL, 1] * np.exp(1j * angle)).real
    return RevolutionTable(np.stack([values[name] for name in COLUMNS], axis=1), orders, {70: waveform})


def rates(revolutions: RevolutionTable, *, ac_coupled: bool = False) -> tuple[WheelRate, WheelRate]:
    turn, camber = without_rates(revolutions, RADIUS_M, ac_coupled=ac_coupled, least_evidence=7.5)
    return turn, camber


def test_turn_that_the_mean_follows_is_removed() -> None:
    revolutions = table(SLALOM, 0.0 * SLALOM)
    turn, camber = rates(revolutions)
    assert turn.shown
    assert not camber.shown
    assert turn.rms_radps == pytest.approx(math.sqrt(np.mean(SLALOM**2)), rel=0.01)
    assert turn.after_mps2 == pytest.approx(0.1, rel=0.2)
    assert turn.before_mps2 > 10.0 * turn.after_mps2
    assert np.std(revolutions.orders_mps2[:, LATERAL, :2], axis=0) == pytest.approx([0.1, 0.1], rel=0.2)
    assert np.ptp(revolutions.waveforms_mps2[70][LATERAL]) == pytest.approx(6.0, abs=0.8)


def test_camber_rate_within_its_bounds_is_removed() -> None:
    wobble = 0.05 * np.sin(np.arange(COUNT) / 3.0)
    revolutions = table(0.0 * SLALOM, wobble)
    turn, camber = rates(revolutions)
    assert camber.shown
    assert not turn.shown
    assert np.std(revolutions.orders_mps2[:, LATERAL, 1]) == pytest.approx(0.1, rel=0.2)


@pytest.mark.parametrize(
    ("revolutions", "ac_coupled", "code"),
    [
        (table(SLALOM, 0.0 * SLALOM, mean=0.3), False, DiagnosisCode.TURN_WITHOUT_ACCELERATION),
        (table(SLALOM, 0.0 * SLALOM, valid=0.0), False, DiagnosisCode.STRAIGHTS_NOT_SEEN),
        (table(0.0 * SLALOM, np.full(COUNT, 0.03)), False, DiagnosisCode.CAMBER_TOO_LARGE),
        (table(SLALOM, 0.3 * np.roll(SLALOM, 9), mean=0.0), False, DiagnosisCode.CAMBER_BESIDE_TURN),
        (table(SLALOM, 0.0 * SLALOM), True, None),
        (table(0.01 * np.cos(np.arange(COUNT)), 0.003 * np.sin(np.arange(COUNT)), mean=0.0), False, None),
    ],
)
def test_what_is_no_rate_of_the_wheel_stays(
    revolutions: RevolutionTable, ac_coupled: bool, code: DiagnosisCode | None
) -> None:
    original = revolutions.orders_mps2.copy()
    listed = rates(revolutions, ac_coupled=ac_coupled)
    assert not any(rate.shown for rate in listed)
    assert np.array_equal(revolutions.orders_mps2, original)
    if code is not None:
        assert code in codes_of([rate.objection for rate in listed if rate.objection is not None])


STEADY = roll_steadily(replace(TIRES[1], elements=240, friction=0.8, slip_scale=0.04), 4000.0)
TIRE = DrivenTire(
    STEADY,
    Sides(1.6e6, 1e3, 2.5e5, 8e6, 1.0, coupling_m=1.2e-3),
    np.radians([-4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0]),
    4e-3,
)


def driven(amplitude_mps2: float, seconds: float) -> tuple[RevolutionTable, float]:
    """Return revolutions of a slalom, its wheel's positions differentiated twice, and the rms of the true turn rate."""
    sensor = Sensor(noise_mg=5.0, roll_rad=0.01, lateral_offset_mps2=0.4, road_mps2=0.5, seed=2)
    step = 1.0 / (sensor.rate_hz * OVERSAMPLED)
    time = step * np.arange(round(seconds / step) + 2 * MARGIN)
    inside = np.clip(np.minimum(time - 4.0, seconds - 4.0 - time), 0.0, 1.0)
    acceleration = amplitude_mps2 * np.sin(0.5 * math.pi * (time - 4.0)) * inside**2 * (3.0 - 2.0 * inside)
    forces = TIRE.forces_n - np.interp(0.0, np.radians([-4, -2, -1, 0, 1, 2, 4]), TIRE.forces_n)
    slip = np.interp(4000.0 / STANDARD_GRAVITY_MPS2 * acceleration, forces, np.radians([-4, -2, -1, 0, 1, 2, 4]))
    heading, none = np.cumsum(acceleration / DRIVEN_MPS) * step, 0.0 * time
    course = Course(step, DRIVEN_MPS + none, heading, slip, 0.03 * acceleration / STANDARD_GRAVITY_MPS2, none, none)
    felt, _, yaw = TIRE.felt(course, 0.0)
    store = RevolutionStore()
    for result in through_pipeline(disturbed(felt, sensor), sensor, ["turning"], load_n=4000.0):
        store.take(result.revolution, result.conditions, result.host_ns, result.estimates)
    return store.table(), float(np.sqrt(np.mean(yaw**2)))


def test_slalom_by_positions_is_named_with_its_size_by_recording() -> None:
    groups, truths = [], []
    for recording, amplitude in enumerate((0.0, 3.0)):
        revolutions, truth = driven(amplitude, 24.0 if amplitude else 8.0)
        of_recording = without_rates(revolutions, TIRE.steady.belt.radius_m, ac_coupled=False, least_evidence=7.5)
        groups.append(SimpleNamespace(recording=recording, rates=of_recording))
        truths.append(truth)
    campaign = SimpleNamespace(recordings=("straight", "slalom"), groups=groups)
    finding, *others = rate_findings(cast("Campaign", campaign))
    assert (finding.name, finding.verdict, finding.lock) == ("turning wheel", Verdict.NAMED, "revolution")
    assert not [other for other in others if other.verdict is Verdict.NAMED]
    of_straight, of_slalom = finding.single_sizes
    assert of_straight.value < 0.01
    assert of_slalom.value == pytest.approx(truths[1], rel=0.12)
    assert abs(of_slalom.value - truths[1]) < 2.5 * of_slalom.std
    # The path follows the wheel by its slip angle.
    assert finding.rms_after_mps2 < 0.4 * finding.rms_before_mps2
