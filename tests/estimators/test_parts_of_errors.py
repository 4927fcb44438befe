"""The constant and the scattering part of every estimate's error, at every estimator of the catalogue."""

import math
from dataclasses import replace

import pytest

from gateway.estimators.estimator import Estimate, Status
from gateway.estimators.registry import estimator_names
from gateway.estimators.sensor_claims import SensorClaims
from gateway.estimators.tire_data import ReferenceNumbers, TireData
from gateway.pipeline.own_drift import OwnDrift
from gateway.pipeline.wheel_setup import WheelSetup
from gateway.views.tables.result_table import row_of
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
    for name, cells in row_of(results[-1])[1].items():
        whole, constant, scatter = (cells[part] for part in ("_std", "_constant_std", "_scatter_std"))
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
