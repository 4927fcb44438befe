"""Columns of a dataset hold every estimate of its estimators, whatever sensor and configuration a recording has."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.errors import OutputError
from gateway.core.estimates.registry import CAMPAIGN_ESTIMATORS, ESTIMATORS, make_estimator
from gateway.core.estimates.wheel_setup import LoadCalibration, TireData
from gateway.fleet.dataset import Description, opened
from gateway.fleet.history_reading import read_histories
from gateway.fleet.recording_estimation import estimate_names
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.forces.belt_laminate import BeltLaminate, StatedPly
from gateway.forces.side_force_calibration import LinearLaw, SideForceCalibration
from gateway.forces.slip_calibration import SlipCalibration
from tests.core.estimates.test_estimator_contract import CASES
from tests.fleet.conftest import DAY_NS
from tests.fleet.test_campaign_run import rows
from tests.testkit.campaign_recordings import START_NS, write_recording

COLUMN_PREFIX = "estimated_"
# The numbers do not matter, only that they are stated.
EVERYTHING_STATED = TireData(
    load_calibration=LoadCalibration(4000.0, 0.2, 220e3, 2.0, 0.0, 1.0, 0.02, (0.1, 0.3), (150e3, 300e3)),
    added=(
        BeltLaminate((StatedPly(0.4, 1e-3, 1e10, 0.2), StatedPly(-0.4, 1e-3, 1e10, 0.2)), 5e6),
        SlipCalibration(0.5, 0.05, 0.0, 0.01, 0.0, 0.1, 0.0, 0.0, (-0.1, 0.1), (0.1, 0.3), (150e3, 300e3)),
        SideForceCalibration(LinearLaw(1e5, 1e3, 0.0, 10.0), LinearLaw(1e4, 1e2, 0.0, 1.0), (0.1, 0.3), (150e3, 300e3)),
    ),
)


@pytest.mark.parametrize("name", list(ESTIMATORS))
def test_every_estimate_of_an_estimator_has_a_column(name: str) -> None:
    columns = [column.removeprefix(COLUMN_PREFIX) for column in estimate_names((name,))]
    # The contract of estimators: names are those of a good revolution.
    revolution, average, conditions = CASES["good"]
    wave = revolution.radial_mps2
    for axes in (revolution.axes_mps2, np.stack([0.1 * wave, 0.01 * wave, wave])):
        for stated in (conditions, replace(conditions, tire=EVERYTHING_STATED)):
            result = make_estimator(name).update(replace(revolution, axes_mps2=axes), average, stated)
            given = [estimate.name for estimate in result]
            # A dataset is continued by columns in the same order only.
            assert given == [column for column in columns if column in given]


@pytest.mark.parametrize("name", ["ply-steer", "slip-angle", "side-force"])
def test_estimates_of_the_lateral_axis_have_columns(name: str) -> None:
    assert len(estimate_names((name,))) >= 4


def test_left_against_right_goes_from_campaign_to_a_number(campaign, tmp_path):
    folder = tmp_path / "axle"
    folder.mkdir()
    keys = "load_n = 4000\n[wheel.tire]\ncord_angle_deg = {}\n"
    for number in range(4):
        write_recording(
            folder / f"drive{number}.mcap",
            "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 80\n",
            wheels=(keys.format(-26), keys.format(26)),
            positions=("FL", "FR"),
            duration_s=2.5,
            seed=number + 1,
            start_ns=START_NS + number * DAY_NS,
            change=lambda toml: toml.replace('name = ""', 'name = "van 7"'),
        )
    campaign(folder, estimators=CAMPAIGN_ESTIMATORS)
    result = rows(tmp_path, "recordings")
    assert all(math.isfinite(row["ply_steer_contact_line_rad"]) for row in result)
    assert all(row["other_estimates"] is None for row in result)
    (pair,) = analyse(read_histories(tmp_path / "dataset").tires, recordings=4).pairs
    steer = next(number for number in pair.numbers if number.quantity == "ply_steer_asymmetry")
    assert steer.count == 4
    assert abs(steer.value) > 3.0 * steer.std  # the belts have opposite cord angles
    by_path = {(row["path"], row["position"]): row["ply_steer_contact_line_rad"] for row in result}
    paths = {path for path, _ in by_path}
    mean = np.mean([by_path[path, "FL"] - by_path[path, "FR"] for path in paths])
    assert steer.value == pytest.approx(math.degrees(mean), abs=2.0 * steer.std)


def test_a_dataset_of_an_older_version_is_told_with_what_to_do(tmp_path):
    older = Description(("ply-steer",), ("gain", "old_number"), "second")
    with opened(tmp_path / "dataset", older, lambda _: False):
        pass
    newer = replace(older, estimates=("gain", "ply_steer_peak_rad"))
    with (
        pytest.raises(OutputError, match="another version of treadlink") as caught,
        opened(tmp_path / "dataset", newer, lambda _: False),
    ):
        pass
    assert "no columns for ply_steer_peak_rad" in str(caught.value)
    assert "gives no old_number" in str(caught.value)
    assert "new folder" in caught.value.remedy
