"""Errors of estimates: constant and scattering part, covariance, and what a disagreement adds."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.api.covariance import covariance, scatter_correlation
from gateway.core.estimates.disagreement import CONTRADICTION, disagreement_std
from gateway.core.estimates.estimator import Estimate, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.registry import estimator_names
from gateway.core.estimates.result_block import ResultBlock
from gateway.core.estimates.sensor_claims import SensorClaims
from gateway.core.estimates.tire_data import ReferenceNumbers, TireData
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.reasons import codes_of
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.text.result_columns import result_columns, values_of
from gateway.core.trust.qualification import OwnDrift
from gateway.ring.determination import FittedNumbers, number_estimates
from tests.testkit.simulated_wheel import simulated

NEW = TireData(0.015, reference=ReferenceNumbers(3.08e-3, 0.195, 2.97, 2.53, pressure_pa=210e3, temperature_degc=25.0))
STATED = WheelSetup("FL", 0, 0, 0.32, load_n=4000.0, pressure_pa=210e3, tire=NEW)
# Contradicted, so that errors are widened: load, depth, and the band of the sensor.
MISSTATED = replace(STATED, load_n=4600.0, sensor=SensorClaims(offset_m=0.0, bandwidth_hz=300.0))
TABLES = "[motion]\nspeed_kmh = [[0, 60], [3, 60], [5, 95]]\n[sensor]\noffset_mm = 3\n"
SWEPT = "load_n = 4000\nslip_angle_deg = [[0, 0], [2, 1], [4, -1]]\n"


def parts_hold(estimate: Estimate) -> bool:
    constant, scatter, std = estimate.constant_std, estimate.scatter_std, estimate.std
    if not math.isfinite(std):
        return scatter == 0.0
    return constant >= 0.0 and scatter >= 0.0 and math.isclose(math.hypot(constant, scatter), std, rel_tol=1e-9)


@pytest.mark.parametrize("setup", [STATED, MISSTATED], ids=["stated", "misstated"])
def test_parts_add_up_to_the_error(setup: WheelSetup) -> None:
    # The fit of the exact ring is slow and gives no scattering part.
    results, _ = simulated(TABLES, 5.0, setup, tuple(name for name in estimator_names() if name != "forward"), SWEPT)
    estimates = [estimate for result in results for estimate in result.estimates]
    assert [estimate for estimate in estimates if not parts_hold(estimate)] == []
    scattering = {estimate.name for estimate in estimates if estimate.scatter_std > 0.0}
    assert {"speed_mps", "Bs", "Bs/Cw", "wear_mm", "load_n"} <= scattering
    for name, cells in result_columns(ResultBlock(results[-1:])).named.items():
        whole, constant, scatter = (values_of(cells[part])[0] for part in ("_std", "_constant_std", "_scatter_std"))
        assert (whole is None) == (constant is None) == (scatter is None), name
        assert whole is None or math.hypot(constant, scatter) == pytest.approx(whole), name


def test_what_widens_an_error_is_constant() -> None:
    drift = OwnDrift("weak-form")
    before, after = (
        drift.widened((Estimate("Bs", value, 1e-4, Status.VALID, (), 6e-5),))[0] for value in (3.0e-3, 3.3e-3)
    )
    assert before.constant_std == pytest.approx(8e-5)
    assert after.std > before.std
    assert after.scatter_std == 6e-5
    assert parts_hold(after)


NAMES = ("speed_mps", "contact_length_m", "Bs", "contact_fraction")
VALUES = np.array([20.0, 0.15, 3e-3, 0.08])
# Of radius, rate, gain, load and pressure.
ERRORS = np.array([0.01, 0.002, 0.015, 0.03, 0.02])


def relative(draw: np.ndarray) -> np.ndarray:
    """Return the relative errors of the quantities of NAMES, (n, 4), from those of the causes, (n, 5)."""
    radius, rate, _, load, pressure = draw.T
    return np.stack([radius + rate, radius, load - pressure - 2.0 * radius, 0.0 * radius], axis=1)


def test_shared_causes_connect_quantities_as_random_errors_do() -> None:
    rng = np.random.default_rng(1)
    drawn = np.cov((relative(rng.normal(0.0, ERRORS, (200_000, 5))) * VALUES).T)
    constant = np.sqrt(np.diagonal(drawn))
    stated = covariance(NAMES, VALUES, constant, np.zeros(4), ERRORS, np.eye(4))
    scale = np.multiply.outer(VALUES, VALUES)
    np.testing.assert_allclose(stated / scale, drawn / scale, atol=2e-6)


def test_errors_beyond_the_causes_and_scatter_weaken_the_correlation() -> None:
    constant, scatter = 0.02 * VALUES, 0.01 * VALUES
    stated = covariance(NAMES, VALUES, constant, scatter, ERRORS, np.eye(4))
    assert np.diagonal(stated) == pytest.approx(constant**2 + scatter**2)
    assert (np.linalg.eigvalsh(stated / np.multiply.outer(VALUES, VALUES)) >= 0.0).all()
    assert stated[0, 1] == pytest.approx(0.01**2 * VALUES[0] * VALUES[1])
    # Bs is better known than load, pressure and radius together, by the belt width of the new tire.
    assert abs(stated[0, 2]) < 0.01 * 0.02 * VALUES[0] * VALUES[2]


def test_scatter_is_correlated_by_what_changes_neither_steadily_nor_alone() -> None:
    rng = np.random.default_rng(2)
    common, drive = rng.normal(size=(2, 4000)), np.linspace(0.0, 500.0, 4000)
    series = np.stack([common[0] + drive, 3.0 * common[0] - drive, common[1] + drive], axis=1)
    correlation = scatter_correlation(series)
    assert correlation[0, 1] == pytest.approx(1.0, abs=1e-6)
    assert abs(correlation[0, 2]) < 0.1
    assert (scatter_correlation(series[:5]) == np.eye(3)).all()


NUMBERS_OF_SETS = np.array([3e-3, 0.195, 2.97, 2.5])


def numbers(width: float) -> dict[str, Estimate]:
    """Return numbers whose Cw is `width` times that of the new tire."""
    reference = ReferenceNumbers(Cw=0.195 / width, Cw_std=0.01 * 0.195, estimator="weak-form")
    conditions = TireConditions(
        0.32, 5000.0, 210e3, load_std_n=50.0, pressure_std_pa=1e3, tire=TireData(reference=reference)
    )
    fitted = FittedNumbers(
        NUMBERS_OF_SETS, np.ones(4, dtype=np.bool_), np.diag((0.002 * NUMBERS_OF_SETS) ** 2), np.zeros((4, 4))
    )
    return {
        number_estimate.name: number_estimate
        for number_estimate in number_estimates("weak-form", fitted, conditions, ())
    }


def test_disagreement_grows_towards_a_contradiction() -> None:
    results = [disagreement_std(errors * 0.02, 0.02) for errors in (1.01, 1.5, 2.0, 2.9)]
    assert results == sorted(results)
    assert results[0] < 0.02 * 0.02
    assert results[2] == pytest.approx(0.24 * 0.04, rel=0.02)


def test_disagreement_within_one_error_adds_nothing() -> None:
    assert disagreement_std(-0.02, 0.02) == 0.0
    assert disagreement_std(0.0, 0.0) == 0.0


def test_disagreement_at_the_limit_is_as_likely_wrong_as_right() -> None:
    assert disagreement_std(CONTRADICTION, 1.0) ** 2 == pytest.approx(0.5 * (CONTRADICTION**2 - 1.0))
    assert disagreement_std(-30.0, 1.0) == pytest.approx(30.0 / 2.0**0.5, rel=1e-3)


def test_width_near_a_contradiction_widens_the_numbers() -> None:
    """A load stated 4 % too low, with an error of 1 %, is within three errors of the new tire's width."""
    plain, off = numbers(1.0), numbers(1.04)
    for name in RING_NUMBERS:
        assert off[name].status is Status.VALID
        assert codes_of(off[name].reasons) == (EstimateCode.WIDTH_DISAGREES,)
        assert 3.0 * off[name].std > 0.04 * off[name].value > 3.0 * plain[name].std
    assert off["Bs/Cw"] == plain["Bs/Cw"]


def test_width_that_agrees_changes_no_error() -> None:
    for name in RING_NUMBERS:
        assert numbers(1.01)[name].std == numbers(1.0)[name].std
        assert numbers(1.01)[name].reasons == ()
