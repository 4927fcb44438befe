"""Correction of known effects in the pipeline, and its limits."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.config.validation import parse_document
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.wheel_setup import CorrectedEffect, CorrectionTable, ReferenceNumbers, TireData, WheelSetup
from gateway.core.links.source import Chunk
from gateway.core.reasons import codes_of
from gateway.core.revolutions.effect_correction import EffectParameter
from gateway.core.revolutions.reasons import RevolutionCode
from gateway.core.session.core import SessionCore
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from gateway.core.text.wording import notice_text
from gateway.core.trust.reasons import TrustCode
from gateway.diagnosis.data.revolution_orders import waveform_orders
from gateway.simulator.scenario import vehicle_toml
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate
from tests.testkit.agreement import assert_agree
from tests.testkit.simulated_wheel import simulated

STEADY = "[motion]\nspeed_kmh = 70.0"
EFFECT = "[wheel.edge_waves]\namplitude_percent = 8.0\norder_before = 20.0\norder_after = 26.0"
SETUP = WheelSetup("FL", 0, 0, 0.32, load_n=5000.0, pressure_pa=2.1e5)
OMEGA = 70 / 3.6 / 0.32
ESTIMATORS = ("kinematic", "weak-form")


def mean_orders(results):
    good = [result.revolution for result in results if not result.revolution.faults][5:]
    return waveform_orders(np.mean([item.axes_mps2 for item in good], axis=0))


@pytest.fixture(scope="module")
def table():
    """Return the contribution of the effect as the difference of two otherwise identical simulated wheels."""
    without, _ = simulated(STEADY, 8.0, SETUP, ("kinematic",))
    having, _ = simulated(STEADY, 8.0, SETUP, ("kinematic",), wheel=EFFECT)
    added = mean_orders(having) - mean_orders(without)
    speeds = OMEGA * np.array([0.5, 1.0, 1.5])
    return CorrectionTable(
        position="FL",
        omega_radps=speeds,
        orders_mps2=np.stack([added * (speed / OMEGA) ** 2 for speed in speeds]),
        effects=(CorrectedEffect("edge waves", (EffectParameter("share", 0.08, 0.001),)),),
        radius_m=0.32,
        omega_range_radps=(0.8 * OMEGA, 1.2 * OMEGA),
        load_range_n=(4900.0, 5100.0),
        pressure_range_pa=(2.0e5, 2.2e5),
    )


def numbers(results):
    return {estimate.name: estimate for estimate in results[-1].estimates}


class TestTable:
    def test_table_interpolates_in_squared_speed(self, table):
        position = table.contribution_mps2(OMEGA)
        assert position.shape == (3, 1024)
        np.testing.assert_allclose(table.contribution_mps2(1.2 * OMEGA), 1.44 * position, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(table.contribution_mps2(9 * OMEGA), 2.25 * position, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(table.contribution_mps2(0.1 * OMEGA), 0.25 * position, rtol=1e-9, atol=1e-9)

    def test_contribution_has_the_tables_orders(self, table):
        orders = waveform_orders(table.contribution_mps2(OMEGA))
        np.testing.assert_allclose(
            orders, np.where(np.arange(111) == 0, table.orders_mps2[1].real, table.orders_mps2[1]), atol=1e-9
        )

    def test_ac_coupled_contribution_has_no_order_zero(self, table):
        assert np.abs(table.contribution_mps2(OMEGA, ac_coupled=True).mean(axis=1)).max() < 1e-9

    def test_table_with_one_speed(self, table):
        single = replace(table, omega_radps=table.omega_radps[1:2], orders_mps2=table.orders_mps2[1:2])
        np.testing.assert_allclose(single.contribution_mps2(0.9 * OMEGA), table.contribution_mps2(OMEGA), atol=1e-9)

    @pytest.mark.parametrize(
        ("omega", "load", "pressure", "code"),
        [
            (1.3, 5e3, 2.1e5, RevolutionCode.EFFECTS_OUTSIDE_RANGE),
            (0.7, 5e3, 2.1e5, RevolutionCode.EFFECTS_OUTSIDE_RANGE),
            (1, 4e3, 2.1e5, RevolutionCode.EFFECTS_OUTSIDE_RANGE),
            (1, 5e3, 2.5e5, RevolutionCode.EFFECTS_OUTSIDE_RANGE),
        ],
    )
    def test_table_reports_why_it_does_not_apply(self, table, omega, load, pressure, code):
        assert table.refusal(omega * OMEGA, load, pressure).code is code

    def test_unknown_conditions_are_accepted(self, table):
        assert table.refusal(OMEGA, None, None) is None
        assert replace(table, load_range_n=None).refusal(OMEGA, 1.0, 2.1e5) is None

    @pytest.mark.parametrize(
        "wrong",
        [
            {"omega_radps": np.array([1.0, 1.0, 2.0])},
            {"omega_radps": np.array([1.0, 2.0])},
            {"omega_radps": np.array([-1.0, 1.0, 2.0])},
            {"orders_mps2": np.zeros((3, 2, 20), complex)},
            {"orders_mps2": np.zeros((3, 3, 1), complex)},
            {"orders_mps2": np.full((3, 3, 20), complex(math.nan))},
        ],
    )
    def test_invalid_table_raises(self, table, wrong):
        with pytest.raises(ValueError, match="table"):
            replace(table, **wrong)


class TestTakenOff:
    def test_corrected_wheel_matches_wheel_without_effect(self, table):
        clean, _ = simulated(STEADY, 10.0, SETUP, ESTIMATORS, seed=9)
        having, _ = simulated(STEADY, 10.0, SETUP, ESTIMATORS, wheel=EFFECT, seed=9)
        corrected, _ = simulated(STEADY, 10.0, replace(SETUP, correction=table), ESTIMATORS, wheel=EFFECT, seed=9)
        assert all(not item.revolution.uncorrected for item in corrected)
        before = np.abs(mean_orders(having) - mean_orders(clean))[2]
        after = np.abs(mean_orders(corrected) - mean_orders(clean))[2]
        assert np.linalg.norm(after[:61]) < 0.05 * np.linalg.norm(before[:61])
        for name in ("Bs", "Cw"):
            truth, wrong, right = (numbers(results)[name] for results in (clean, having, corrected))
            assert abs(right.value - truth.value) < 0.15 * abs(wrong.value - truth.value), name
            assert right.status is truth.status

    def test_correction_keeps_contact_times(self, table):
        having, _ = simulated(STEADY, 10.0, SETUP, ESTIMATORS, wheel=EFFECT, seed=9)
        corrected, _ = simulated(STEADY, 10.0, replace(SETUP, correction=table), ESTIMATORS, wheel=EFFECT, seed=9)
        for first, other in zip(having[5:], corrected[5:], strict=True):
            assert other.revolution.start_s == pytest.approx(first.revolution.start_s, abs=2e-6)

    def test_uncorrected_revolutions_mark_estimates(self, table):
        narrow = replace(table, omega_range_radps=(0.9 * OMEGA, 1.1 * OMEGA))
        ramp = "[motion]\nspeed_kmh = [[0.0, 70.0], [5.0, 70.0], [8.0, 90.0], [12.0, 90.0], [15.0, 70.0], [20.0, 70.0]]"
        results, _ = simulated(ramp, 20.0, replace(SETUP, correction=narrow), ESTIMATORS, wheel=EFFECT)
        outside = [result for result in results if result.revolution.uncorrected]
        inside = [result for result in results if not result.revolution.uncorrected]
        assert len(outside) > 30
        assert len(inside) > 80
        for item in outside:
            assert item.revolution.uncorrected.code is RevolutionCode.EFFECTS_OUTSIDE_RANGE
            if 8.2 < item.revolution.start_s < 11.5:
                assert item.revolution.uncorrected["value"] == pytest.approx(90 / 3.6, rel=5e-3)
        of_shape = numbers(outside)["Bs"]
        assert of_shape.status is not Status.VALID
        assert TrustCode.EFFECTS_NOT_SUBTRACTED in codes_of(of_shape.reasons)
        assert numbers(outside)["speed_mps"].status is Status.VALID
        assert TrustCode.EFFECTS_NOT_SUBTRACTED not in codes_of(numbers(inside)["Bs"].reasons)
        # Corrected and uncorrected revolutions are averaged separately.
        steady, _ = simulated(STEADY, 10.0, replace(SETUP, correction=table), ESTIMATORS, wheel=EFFECT)
        assert numbers(inside)["Bs"].value == pytest.approx(numbers(steady)["Bs"].value, rel=0.1)

    def test_derived_estimate_repeats_no_reason(self, table):
        elsewhere = replace(table, load_range_n=(3000.0, 4000.0))
        new = TireData(ring_thickness_m=0.015, reference=ReferenceNumbers(Bs=3.0e-3, pressure_pa=2.1e5))
        setup = replace(SETUP, correction=elsewhere, tire=new)
        results, _ = simulated(STEADY, 6.0, setup, (*ESTIMATORS, "wear"))
        wear = numbers(results)["wear_mm"]
        assert math.isfinite(wear.value)
        assert codes_of(wear.reasons).count(TrustCode.EFFECTS_NOT_SUBTRACTED) == 1

    def test_other_sensor_is_not_corrected(self, table):
        other = replace(table, sensor_id=0xDEAD)
        results, _ = simulated(STEADY, 3.0, replace(SETUP, correction=other), ESTIMATORS)
        assert all(result.revolution.uncorrected["found_on"] == "0000dead" for result in results)


def test_live_and_batch_apply_the_same_correction(table):
    text = f"[scenario]\nseed = 3\n{STEADY}\n[[wheel]]\nposition = 'FL'\nwheel = 0\n{EFFECT}\n"
    scenario = parse_document(Scenario, text, "test")
    vehicle = parse_vehicle(vehicle_toml(scenario), "test")
    chunks = list(simulate(scenario, duration_s=5.0).chunks("link", 10**18))
    core = SessionCore(vehicle, estimators=ESTIMATORS, effects=(table,))
    live = [result for chunk in chunks for result in core.take(chunk)] + core.finish()

    class Items:
        def items(self):
            yield from (Chunk(chunk.link, chunk.host_ns, chunk.data) for chunk in chunks)

    batch = list(RecordingPass(OpenedRecording(Items(), vehicle, (table,)), ESTIMATORS))
    assert len(live) > 20
    assert_agree(batch, live)
    plain = list(RecordingPass(OpenedRecording(Items(), vehicle), ESTIMATORS))
    assert np.abs(plain[-1].revolution.axes_mps2 - batch[-1].revolution.axes_mps2).max() > 10
    assert any("edge waves" in notice_text(notice) for notice in core.snapshot(0.0).notices)
